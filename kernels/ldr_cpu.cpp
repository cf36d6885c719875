// The steps of LDR as row loops that the compiler vectorises.
//
// Compiled once per instruction set, like gdr_cpu.cpp: everything but the table is local to the file.
#include "flags.hpp"
#include "ldr_sweeps.hpp"

namespace stereomend {
namespace {

constexpr float kMinGrey = 1.0f;  // floor of I_s in Eq. 2 [grey levels]
constexpr int kDirections = 8;

long offset_of(Size size, int y) { return static_cast<long>(y) * size.width; }

// Differences of prefix sums: in double, what was added leaves no trace when it is taken away.
void sum_along(const ConfidenceInput& in, int radius, int y, const WindowSums& window) {
    const int width = in.size.width;
    const long offset = offset_of(in.size, y);
    const float* u = in.u + offset;
    const bool* valid = in.valid + offset;
    double* prefix = reinterpret_cast<double*>(window.scratch);
    int* number = reinterpret_cast<int*>(prefix + width + 1);
    prefix[0] = 0.0;
    number[0] = 0;
    for (int x = 0; x < width; ++x) {
        prefix[x + 1] = prefix[x] + (valid[x] ? static_cast<double>(u[x]) : 0.0);
        number[x + 1] = number[x] + valid[x];
    }
    for (int x = 0; x < width; ++x) {
        const int end = x + radius + 1 < width ? x + radius + 1 : width;
        const int begin = x > radius ? x - radius : 0;
        window.sums[offset + x] = static_cast<float>(prefix[end] - prefix[begin]);
        window.counts[offset + x] = static_cast<float>(number[end] - number[begin]);
    }
}

// Adds the rows of the window around y; a running sum would depend on where a thread's band begins.
void sum_down(const float* plane, Size size, int y, int radius, float* out) {
    const int first = y > radius ? y - radius : 0;
    const int last = y + radius < size.height ? y + radius : size.height - 1;
    for (int x = 0; x < size.width; ++x) out[x] = 0.0f;
    for (int row = first; row <= last; ++row) {
        const float* source = plane + offset_of(size, row);
#pragma GCC ivdep
        for (int x = 0; x < size.width; ++x) out[x] += source[x];
    }
}

PIXEL_FN float power_of(float base, int power) {
    const float square = base * base;
    const float low = power == 1 ? base : square;
    const float high = power == 3 ? square * base : square * square;
    return power <= 2 ? low : high;
}

// C_s (Eq. 1), 0 where the mean is not positive or of nothing.
PIXEL_FN float smoothness(float u, float sum, float count, const ConfidenceParams& params) {
    const float mean = sum / larger(count, 1.0f);
    const float deviation = fabsf(u - mean) / (mean > 0.0f ? mean : 1.0f);
    const float value = power_of(larger(0.0f, 1.0f - params.smoothness_weight * deviation), params.smoothness_power);
    return mean > 0.0f ? value : 0.0f;
}

// C_p (Eq. 2).
PIXEL_FN float photometric(float source, float target, float weight) {
    return larger(0.0f, 1.0f - weight * fabsf(source - target) / larger(source, kMinGrey));
}

void confidence_row(const ConfidenceInput& in, const ConfidenceParams& params, int y, const WindowSums& window,
                    float* out) {
    const int width = in.size.width;
    const long offset = offset_of(in.size, y);
    const float* left = in.left + offset;
    const float* u = in.u + offset;
    float* sum = window.scratch;
    float* count = sum + width + 2;
    float* match = count + width + 2;
    sum_down(window.sums, in.size, y, params.window / 2, sum);
    sum_down(window.counts, in.size, y, params.window / 2, count);
    for (int x = 0; x < width; ++x) match[x] = sample_row(in.right + offset, width, x, u[x]);
    const ConfidenceParams constants = params;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const float place = static_cast<float>(x);
        const bool inside = (u[x] <= place) & (u[x] >= place - static_cast<float>(width - 1));
        const float value = smoothness(u[x], sum[x], count[x], constants) *
                            photometric(left[x], match[x], constants.photometric_weight);
        out[x] = inside ? value : 0.0f;
    }
    for (int x = 0; x < width; ++x)
        if (!(in.valid[offset + x] & in.matte[offset + x])) out[x] = 0.0f;
}

// Here, or else what came so far, if that was not too many steps ago.
PIXEL_FN void pass_on(float w, float before, float taken, float limit, float* met, float* steps) {
    const bool known = w < kNone;
    *met = known ? w : (taken <= limit ? before : kNone);
    *steps = known ? 0.0f : taken;
}

void look(const float* w, const Front& before, float limit, int width, const Front& now) {
    const float *straight = before.values[0], *right = before.values[1] - 1, *left = before.values[2] + 1;
    const float *ago = before.steps[0], *right_ago = before.steps[1] - 1, *left_ago = before.steps[2] + 1;
    float *met0 = now.values[0], *met1 = now.values[1], *met2 = now.values[2];
    float *steps0 = now.steps[0], *steps1 = now.steps[1], *steps2 = now.steps[2];
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        pass_on(w[x], straight[x], ago[x] + 1.0f, limit, met0 + x, steps0 + x);
        pass_on(w[x], right[x], right_ago[x] + 1.0f, limit, met1 + x, steps1 + x);
        pass_on(w[x], left[x], left_ago[x] + 1.0f, limit, met2 + x, steps2 + x);
    }
}

// Only in holes: elsewhere nobody asks.
void look_along(const float* w, int limit, int width, float* east, float* west) {
    for (int end = 0; end < width;) {
        int begin = end;
        while (begin < width && w[begin] < kNone) ++begin;
        end = begin;
        while (end < width && !(w[end] < kNone)) ++end;
        const int length = end - begin;
        const int far = length > limit ? length - limit : 0;
        const float before = begin > 0 ? w[begin - 1] : kNone;
        const float after = end < width ? w[end] : kNone;
        for (int k = 0; k < length; ++k) west[begin + k] = k < limit ? before : kNone;
        for (int k = 0; k < length; ++k) east[begin + k] = k >= far ? after : kNone;
    }
}

PIXEL_FN void order(float& a, float& b) {
    const float low = smaller(a, b);
    b = larger(a, b);
    a = low;
}

// Batcher's network; what was met nowhere sorts last.
PIXEL_FN void sort8(float v[kDirections]) {
    order(v[0], v[1]); order(v[2], v[3]); order(v[4], v[5]); order(v[6], v[7]);
    order(v[0], v[2]); order(v[1], v[3]); order(v[4], v[6]); order(v[5], v[7]);
    order(v[1], v[2]); order(v[5], v[6]);
    order(v[0], v[4]); order(v[1], v[5]); order(v[2], v[6]); order(v[3], v[7]);
    order(v[2], v[4]); order(v[3], v[5]);
    order(v[1], v[2]); order(v[3], v[4]); order(v[5], v[6]);
}

// The median of what is known, the mean of the two middle ones for an even number; kNone for none.
PIXEL_FN float median(float v[kDirections]) {
    sort8(v);
    float low = v[0];
    float high = v[0];
    for (int k = 1; k < kDirections; ++k) {
        const bool known = v[k] < kNone;
        low = known ? v[k / 2] : low;
        high = known ? v[(k + 1) / 2] : high;
    }
    return 0.5f * (low + high);
}

bool has_hole(const float* w, int begin, int end) {
    // A sum of integers is vectorised, the largest of floats is not.
    int holes = 0;
    for (int x = begin; x < end; ++x) holes += w[x] < kNone ? 0 : 1;
    return holes > 0;
}

void fill_part(const float* const met[kDirections], int begin, int end, float* w) {
    const float *m0 = met[0], *m1 = met[1], *m2 = met[2], *m3 = met[3];
    const float *m4 = met[4], *m5 = met[5], *m6 = met[6], *m7 = met[7];
#pragma GCC ivdep
    for (int x = begin; x < end; ++x) {
        float v[kDirections] = {m0[x], m1[x], m2[x], m3[x], m4[x], m5[x], m6[x], m7[x]};
        const float found = median(v);
        w[x] = w[x] < kNone ? w[x] : found;
    }
}

// In parts, for most have no hole.
bool fill_row(const float* const met[kDirections], int width, float* w) {
    constexpr int kPart = 32;
    bool holes = false;
    for (int begin = 0; begin < width; begin += kPart) {
        const int end = begin + kPart < width ? begin + kPart : width;
        if (!has_hole(w, begin, end)) continue;
        fill_part(met, begin, end, w);
        holes |= has_hole(w, begin, end);
    }
    return holes;
}

// In double, for x - u would lose digits of u. The minimum waits for its neighbour's; all else does not, and is done
// beside it, part by part.
void unobserved_row(const float* u, int width, bool* out) {
    constexpr int kPart = 256;
    uint8_t* flags = bytes_of(out);
    double leftmost = static_cast<double>(kNone);
    for (int begin = (width - 1) / kPart * kPart; begin >= 0; begin -= kPart) {
        const int count = width - begin < kPart ? width - begin : kPart;
        double column[kPart];
        double nearer[kPart];
        for (int k = 0; k < count; ++k) column[k] = begin + k - static_cast<double>(u[begin + k]);
        for (int k = count - 1; k >= 0; --k) {
            nearer[k] = leftmost;
            leftmost = column[k] < leftmost ? column[k] : leftmost;
        }
        for (int k = 0; k < count; ++k)
            flags[begin + k] = static_cast<uint8_t>((column[k] < 0.0 ? 1 : 0) | (column[k] > width - 1 ? 1 : 0) |
                                                    (nearer[k] <= column[k] - 1.0 ? 1 : 0));
    }
}

constexpr int kAside = 2;       // pixels on each side that a rise is measured over
constexpr float kSteep = 2.0f;  // over 4 pixels: the right image shows them on 2

void shown_row(const float* u, const bool* valid, int width, bool* shown, bool* hidden) {
    const uint8_t* known = bytes_of(valid);
    uint8_t *seen = bytes_of(shown), *unseen = bytes_of(hidden);
    unobserved_row(u, width, hidden);
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        seen[x] = static_cast<uint8_t>(known[x] & (1 - unseen[x]));
        unseen[x] &= known[x];
    }
#pragma GCC ivdep
    for (int x = kAside; x < width - kAside; ++x)
        unseen[x] |= static_cast<uint8_t>((u[x + kAside] - u[x - kAside] >= kSteep ? 1 : 0) & known[x - kAside]);
}

// The first of the pixels from x on that is known, or not; the width if none is.
int next_of(const bool* known, bool sought, int x, int width) {
    const void* found = x < width ? memchr(known + x, sought, width - x) : nullptr;
    return found ? static_cast<int>(static_cast<const bool*>(found) - known) : width;
}

void fill_occlusions(float* u, const bool* known, int width, const OcclusionRule& rule, bool* filled) {
    memset(filled, 0, width);
    int end = next_of(known, true, 0, width);
    for (int begin; (begin = next_of(known, false, end, width)) < width;) {
        end = next_of(known, true, begin, width);
        const float left = u[begin - 1];
        const float jump = end < width ? u[end] - left : 0.0f;
        if (jump > rule.step && static_cast<float>(end - begin) <= rule.stretch * jump + rule.slack)
            for (int x = begin; x < end; ++x) {
                u[x] = left;
                filled[x] = true;
            }
    }
}

// Whether steps from the pixels `back` before lead onto `count` pixels from i on: 1 or 0. As numbers, for comparisons
// of bools are not vectorised.
void find_links(const Terrain& terrain, long i, long back, int count, uint8_t* links) {
    const float *u = terrain.u + i, *from = u - back;
    const uint8_t* passing = bytes_of(terrain.passing) + i;
    const uint8_t *soft = bytes_of(terrain.soft) + i, *soft_from = soft - back;
    const float step = terrain.step;
#pragma GCC ivdep
    for (int x = 0; x < count; ++x)
        links[x] = static_cast<uint8_t>(((fabsf(u[x] - from[x]) <= step ? 1 : 0) | soft[x] | soft_from[x]) & passing[x]);
}

// 64 pixels as bits of a number, the first the lowest. A bit of the links leads from its neighbour onto that pixel.
uint64_t flood_up(uint64_t reached, uint64_t links) {
    for (int way = 1; way < 64; way *= 2) {
        reached |= links & (reached << way);
        links &= links << way;
    }
    return reached;
}

uint64_t flood_down(uint64_t reached, uint64_t links) {
    for (int way = 1; way < 64; way *= 2) {
        reached |= links & (reached >> way);
        links &= links >> way;
    }
    return reached;
}

// Floods `count` pixels from column x of row y on; `entry`: whether the one beside them, on the side of `back`, is
// reached. Returns what is reached: at least the first of them as the lowest bit, the last as the highest.
uint64_t flood(const Terrain& terrain, int y, int x, int count, long back, bool entry, bool* reached) {
    const long i = offset_of(terrain.size, y) + x;
    if (!memchr(terrain.passing + i, true, count))
        return uint64_t{reached[i + count - 1]} << 63 | uint64_t{reached[i]};
    uint8_t links[64] = {};
    uint8_t flags[64] = {};
    const bool first = back > 0 && x == 0;
    const bool last = back < 0 && x + count == terrain.size.width;
    find_links(terrain, i + first, back, count - first - last, links + first);
    memcpy(flags, reached + i, count);
    const uint64_t beside = entry ? (back > 0 ? 1 : uint64_t{1} << 63) : 0;
    const uint64_t ways = packed(links);
    const uint64_t found = packed(flags) | (beside & ways);
    const uint64_t all = back > 0 ? flood_up(found, ways) : flood_down(found, ways);
    unpack(all, flags);
    memcpy(reached + i, flags, count);
    return all;
}

void reach_along(const Terrain& terrain, int y, bool* reached) {
    const int width = terrain.size.width;
    uint64_t beside = 0;
    for (int x = 0; x < width; x += 64) {
        const int count = width - x < 64 ? width - x : 64;
        beside = flood(terrain, y, x, count, 1, beside >> 63, reached);
    }
    beside = 0;
    for (int x = (width - 1) / 64 * 64; x >= 0; x -= 64) {
        const int count = width - x < 64 ? width - x : 64;
        beside = flood(terrain, y, x, count, -1, beside & 1, reached);
    }
}

void reach_across(const Terrain& terrain, int from, int y, Rows columns, bool* reached) {
    const long back = offset_of(terrain.size, y - from);
    const long i = offset_of(terrain.size, y) + columns.begin;
    const int count = columns.end - columns.begin;
    uint8_t* target = bytes_of(reached) + i;
    for (int x = 0; x < count; x += 64) {
        uint8_t links[64];
        const int some = count - x < 64 ? count - x : 64;
        if (!memchr(terrain.passing + i + x, true, some)) continue;
        find_links(terrain, i + x, back, some, links);
#pragma GCC ivdep
        for (int k = 0; k < some; ++k) target[x + k] |= target[x + k - back] & links[k];
    }
}

}  // namespace

extern const LdrSweeps LDR_SWEEPS = {unobserved_row, shown_row, sum_along, confidence_row, look, look_along, has_hole,
                                    fill_row, fill_occlusions, reach_along, reach_across};

}  // namespace stereomend
