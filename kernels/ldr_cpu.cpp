#include "ldr.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <vector>

#include "team.hpp"

namespace stereomend {
namespace {

constexpr float kMinGrey = 1.0f;  // floor of I_s in Eq. 2 [grey levels]
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

struct Direction {
    int dx;
    int dy;
};
constexpr int kDirections = 8;
constexpr Direction kCompass[kDirections] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {-1, -1}, {1, -1}, {-1, 1}};

long offset_of(Size size, int y) { return static_cast<long>(y) * size.width; }

// Sums of known values and their number over a row's window, by a running sum.
void sum_along_row(const float* u, const bool* valid, int width, int radius, float* sums, float* counts) {
    double sum = 0.0;
    int count = 0;
    const auto add = [&](int x, int sign) {
        if (x < 0 || x >= width || !valid[x]) return;
        sum += sign * static_cast<double>(u[x]);
        count += sign;
    };
    for (int x = 0; x < radius; ++x) add(x, 1);
    for (int x = 0; x < width; ++x) {
        add(x + radius, 1);
        sums[x] = static_cast<float>(sum);
        counts[x] = static_cast<float>(count);
        add(x - radius, -1);
    }
}

// Adds the rows of the window around y; a running sum would depend on where a thread's band begins.
void sum_down_columns(const std::vector<float>& rows, Size size, int y, int radius, float* out) {
    std::fill(out, out + size.width, 0.0f);
    for (int row = std::max(0, y - radius); row <= std::min(size.height - 1, y + radius); ++row) {
        const float* source = rows.data() + offset_of(size, row);
        for (int x = 0; x < size.width; ++x) out[x] += source[x];
    }
}

float smoothness(float u, float sum, float count, const ConfidenceParams& params) {
    const float mean = sum / count;
    if (!(mean > 0.0f)) return 0.0f;
    const float base = std::max(0.0f, 1.0f - params.smoothness_weight * std::fabs(u - mean) / mean);
    float value = base;
    for (int i = 1; i < params.smoothness_power; ++i) value *= base;
    return value;
}

float photometric(float source, float target, float weight) {
    return std::max(0.0f, 1.0f - weight * std::fabs(source - target) / std::max(source, kMinGrey));
}

void confidence_row(const ConfidenceInput& in, const ConfidenceParams& params, int y, const float* sums,
                    const float* counts, float* out) {
    const long offset = offset_of(in.size, y);
    const float* right = in.right + offset;
    for (int x = 0; x < in.size.width; ++x) {
        const float u = in.u[offset + x];
        const bool inside = u >= x - (in.size.width - 1) && u <= x;
        if (!in.valid[offset + x] || !in.matte[offset + x] || !inside) {
            out[x] = 0.0f;
            continue;
        }
        const Grey match = sample_row(right, in.size.width, x, u);
        out[x] = smoothness(u, sums[x], counts[x], params) *
                 photometric(in.left[offset + x], match.base + match.rest, params.photometric_weight);
    }
}

// What is met at (x, y) when the pixel before it, seen from the hole, is `from`.
struct Met {
    float value;
    int steps;
};

Met step(bool known, float u, Met from, int limit) {
    if (known) return {u, 0};
    return from.steps + 1 <= limit ? Met{from.value, from.steps + 1} : Met{kNone, limit};
}

// For every pixel the first known value met along one direction, or NaN, in one sweep against the direction.
// scratch: two rows of width + 2.
void look_along(Direction d, Size size, const float* u, const bool* known, int limit, float* out, Met* scratch) {
    Met* behind = scratch;
    Met* row = scratch + size.width + 2;
    std::fill(scratch, scratch + 2 * (size.width + 2), Met{kNone, limit});
    const int first_x = d.dx > 0 ? size.width - 1 : 0;
    const int step_x = d.dx > 0 ? -1 : 1;
    for (int i = 0; i < size.height; ++i) {
        const int y = d.dy > 0 ? size.height - 1 - i : i;
        const long offset = offset_of(size, y);
        const Met* source = d.dy == 0 ? row : behind;
        for (int n = 0, x = first_x; n < size.width; ++n, x += step_x) {
            row[x + 1] = step(known[offset + x], u[offset + x], source[x + 1 + d.dx], limit);
            out[offset + x] = row[x + 1].value;
        }
        std::swap(behind, row);
    }
}

// The median of what is not NaN, the mean of the two middle ones for an even number; NaN for none.
float median_of(const float* const planes[kDirections], long at) {
    float values[kDirections];
    int count = 0;
    for (int k = 0; k < kDirections; ++k)
        if (!std::isnan(planes[k][at])) values[count++] = planes[k][at];
    if (count == 0) return kNone;
    std::sort(values, values + count);
    return count % 2 ? values[count / 2] : 0.5f * (values[count / 2 - 1] + values[count / 2]);
}

// One pass of the search; returns whether holes remain.
bool search_pass(Size size, float* u, bool* known, int steps, int threads, std::vector<float>& memory) {
    const size_t pixels = static_cast<size_t>(size.width) * size.height;
    float* planes[kDirections];
    for (int k = 0; k < kDirections; ++k) planes[k] = memory.data() + k * pixels;
    const size_t scratch_size = 2 * (static_cast<size_t>(size.width) + 2);
    std::vector<Met> scratch(scratch_size * threads);
    std::atomic<bool> holes{false};
    run_team(threads, [&](int member, int members, Barrier& barrier) {
        for (int k = member; k < kDirections; k += members)
            look_along(kCompass[k], size, u, known, steps, planes[k], &scratch[scratch_size * member]);
        barrier.wait();
        const Rows rows = band(size.height, member, members);
        for (long at = offset_of(size, rows.begin); at < offset_of(size, rows.end); ++at) {
            if (known[at]) continue;
            const float median = median_of(planes, at);
            known[at] = !std::isnan(median);
            if (known[at]) u[at] = median;
            else holes = true;
        }
    });
    return holes;
}

// For every pixel the nearest known row of its column, the upper of two; -1 where the column has none.
std::vector<int> nearest_in_columns(Size size, const bool* known) {
    std::vector<int> nearest(static_cast<size_t>(size.width) * size.height, -1);
    for (int x = 0; x < size.width; ++x) {
        int last = -1;
        for (int y = 0; y < size.height; ++y) {
            if (known[offset_of(size, y) + x]) last = y;
            nearest[offset_of(size, y) + x] = last;
        }
        last = -1;
        for (int y = size.height - 1; y >= 0; --y) {
            int& best = nearest[offset_of(size, y) + x];
            if (known[offset_of(size, y) + x]) last = y;
            if (last >= 0 && (best < 0 || last - y < y - best)) best = last;
        }
    }
    return nearest;
}

// Squared distance from (x, y) to the column's nearest known pixel [px^2].
long squared_distance(int x, int y, int column, const int* nearest) {
    const long dx = x - column;
    const long dy = y - nearest[column];
    return dx * dx + dy * dy;
}

// The lower envelope of the columns' parabolas along row y (Meijster, Roerdink, Hesselink 2000):
// columns[i] is the nearest from starts[i] to starts[i + 1] - 1.
struct Envelope {
    std::vector<int> columns, starts;

    void build(Size size, int y, const int* nearest) {
        columns.clear();
        starts.clear();
        for (int x = 0; x < size.width; ++x)
            if (nearest[x] >= 0) add(size, x, y, nearest);
    }

    void add(Size size, int x, int y, const int* nearest) {
        while (!columns.empty() &&
               squared_distance(starts.back(), y, columns.back(), nearest) >
                   squared_distance(starts.back(), y, x, nearest)) {
            columns.pop_back();
            starts.pop_back();
        }
        const long start = columns.empty() ? 0 : 1 + last_of(columns.back(), x, y, nearest);
        if (start >= size.width) return;
        columns.push_back(x);
        starts.push_back(static_cast<int>(start));
    }

    // The last place where column a is at least as near as column b, a < b.
    static long last_of(int a, int b, int y, const int* nearest) {
        const long at_a = squared_distance(0, y, a, nearest);
        const long at_b = squared_distance(0, y, b, nearest);
        const long above = at_b - at_a;
        const long below = 2L * (b - a);
        return above >= 0 ? above / below : -((-above + below - 1) / below);
    }
};

void fill_from_nearest(Size size, float* u, bool* known) {
    const std::vector<int> nearest = nearest_in_columns(size, known);
    const std::vector<float> source(u, u + offset_of(size, size.height));
    Envelope envelope;
    for (int y = 0; y < size.height; ++y) {
        const long offset = offset_of(size, y);
        envelope.build(size, y, nearest.data() + offset);
        if (envelope.columns.empty()) continue;
        size_t i = 0;
        for (int x = 0; x < size.width; ++x) {
            while (i + 1 < envelope.starts.size() && envelope.starts[i + 1] <= x) ++i;
            const int column = envelope.columns[i];
            if (!known[offset + x]) u[offset + x] = source[offset_of(size, nearest[offset + column]) + column];
            known[offset + x] = true;
        }
    }
}

}  // namespace

void confidence(const ConfidenceInput& input, const ConfidenceParams& params, float* out, int threads) {
    const Size size = input.size;
    const int radius = params.window / 2;
    const size_t pixels = static_cast<size_t>(size.width) * size.height;
    std::vector<float> sums(pixels), counts(pixels), scratch(2 * static_cast<size_t>(size.width) * threads);
    run_team(threads, [&](int member, int members, Barrier& barrier) {
        const Rows rows = band(size.height, member, members);
        for (int y = rows.begin; y < rows.end; ++y) {
            const long at = offset_of(size, y);
            sum_along_row(input.u + at, input.valid + at, size.width, radius, &sums[at], &counts[at]);
        }
        barrier.wait();
        float* sum = scratch.data() + 2 * static_cast<size_t>(size.width) * member;
        float* count = sum + size.width;
        for (int y = rows.begin; y < rows.end; ++y) {
            sum_down_columns(sums, size, y, radius, sum);
            sum_down_columns(counts, size, y, radius, count);
            confidence_row(input, params, y, sum, count, out + offset_of(size, y));
        }
    });
}

void fill(Size size, float* u, bool* known, int steps, int passes, int threads) {
    const size_t pixels = static_cast<size_t>(size.width) * size.height;
    const bool* end = known + pixels;
    if (std::find(static_cast<const bool*>(known), end, true) == end) return;
    if (std::find(static_cast<const bool*>(known), end, false) == end) return;
    std::vector<float> memory(kDirections * pixels);
    for (int pass = 0; pass < passes; ++pass)
        if (!search_pass(size, u, known, steps, threads, memory)) return;
    fill_from_nearest(size, u, known);
}

}  // namespace stereomend
