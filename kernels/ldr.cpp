#include "ldr.hpp"

#include <algorithm>
#include <functional>

namespace stereomend {
namespace {

// Directions in which a row depends on the row above (dy -1) or below it (dy 1).
struct Direction {
    int dx;
    int dy;
};
constexpr int kVertical = 6;
constexpr Direction kAcrossRows[kVertical] = {{0, -1}, {0, 1}, {-1, -1}, {1, 1}, {1, -1}, {-1, 1}};

long offset_of(Size size, int y) { return static_cast<long>(y) * size.width; }

bool is_known(float w) { return w < kNone; }

// Memory of one fill: the map with kNone in its holes, what is met in each direction, rows of steps and values.
struct Search {
    Size size;
    float* w;                  // (height, width)
    float* met[kVertical];     // (height, width + 2)
    float* memory;             // 4 rows of width + 2 for each direction and each member
    float limit;               // most steps

    int stride() const { return size.width + 2; }
    float* rows(int i) const { return memory + 4 * static_cast<size_t>(stride()) * i; }
};

Search make_search(const Holes& map, int steps, const Crew& crew) {
    const size_t stride = map.size.width + 2;
    const size_t plane = stride * map.size.height;
    const size_t rows = 4 * stride * std::max(kVertical, crew.team.size());
    std::vector<float>& planes = crew.buffers.planes;
    planes.resize(std::max(planes.size(), (kVertical + 1) * plane + rows));
    float* at = planes.data();
    Search search{map.size, at, {}, at + (kVertical + 1) * plane, static_cast<float>(steps)};
    for (int k = 0; k < kVertical; ++k) search.met[k] = at + (k + 1) * plane;
    return search;
}

// For every pixel the first known value met in one direction across rows, in one sweep against the direction.
void look_across(const Search& search, int k, const LdrSweeps& sweeps) {
    const Direction d = kAcrossRows[k];
    float* before = search.rows(k);
    float* steps = before + search.stride();
    float* steps_before = steps + search.stride();
    const float* values = before;
    std::fill(before, before + 3 * search.stride(), kNone);
    for (int i = 0; i < search.size.height; ++i) {
        const int y = d.dy < 0 ? i : search.size.height - 1 - i;
        float* out = search.met[k] + static_cast<long>(y) * search.stride();
        out[0] = out[search.size.width + 1] = kNone;
        sweeps.look(search.w + offset_of(search.size, y), values + 1 + d.dx, steps_before + 1 + d.dx, search.limit,
                    search.size.width, out + 1, steps + 1);
        values = out;
        std::swap(steps, steps_before);
    }
}

// Fills the holes of some rows from all eight directions; returns whether any remains.
bool fill_rows(const Search& search, Rows rows, int member, const LdrSweeps& sweeps) {
    float* east = search.rows(member);
    float* west = east + search.stride();
    bool holes = false;
    for (int y = rows.begin; y < rows.end; ++y) {
        const float* met[8] = {east, west};
        for (int k = 0; k < kVertical; ++k) met[k + 2] = search.met[k] + static_cast<long>(y) * search.stride() + 1;
        float* w = search.w + offset_of(search.size, y);
        sweeps.look_along(w, search.limit, search.size.width, east, west);
        holes |= sweeps.fill_row(met, search.size.width, w);
    }
    return holes;
}

// For every pixel the nearest known row of its column, the upper of two; -1 where the column has none.
std::vector<int> nearest_in_columns(Size size, const float* w) {
    std::vector<int> nearest(static_cast<size_t>(size.width) * size.height, -1);
    for (int x = 0; x < size.width; ++x) {
        int last = -1;
        for (int y = 0; y < size.height; ++y) {
            if (is_known(w[offset_of(size, y) + x])) last = y;
            nearest[offset_of(size, y) + x] = last;
        }
        last = -1;
        for (int y = size.height - 1; y >= 0; --y) {
            int& best = nearest[offset_of(size, y) + x];
            if (is_known(w[offset_of(size, y) + x])) last = y;
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

void fill_from_nearest(Size size, float* w) {
    const std::vector<int> nearest = nearest_in_columns(size, w);
    const std::vector<float> source(w, w + offset_of(size, size.height));
    Envelope envelope;
    for (int y = 0; y < size.height; ++y) {
        const long offset = offset_of(size, y);
        envelope.build(size, y, nearest.data() + offset);
        if (envelope.columns.empty()) continue;
        size_t i = 0;
        for (int x = 0; x < size.width; ++x) {
            while (i + 1 < envelope.starts.size() && envelope.starts[i + 1] <= x) ++i;
            const int column = envelope.columns[i];
            if (!is_known(w[offset + x])) w[offset + x] = source[offset_of(size, nearest[offset + column]) + column];
        }
    }
}

}  // namespace

void confidence(const ConfidenceInput& input, const ConfidenceParams& params, float* out, const Crew& crew) {
    const Size size = input.size;
    const size_t pixels = static_cast<size_t>(size.width) * size.height;
    const size_t own = 4 * (static_cast<size_t>(size.width) + 2);
    std::vector<float>& planes = crew.buffers.planes;
    planes.resize(std::max(planes.size(), 2 * pixels + own * crew.team.size()));
    float* sums = planes.data();
    float* counts = sums + pixels;
    const auto body = [&](int member) {
        const Rows rows = band(size.height, member, crew.team.size());
        float* scratch = counts + pixels + own * member;
        for (int y = rows.begin; y < rows.end; ++y)
            crew.sweeps.sum_along(input, params.window / 2, y, {sums, counts, scratch});
        crew.team.meet();
        for (int y = rows.begin; y < rows.end; ++y)
            crew.sweeps.confidence_row(input, params, y, {sums, counts, scratch}, out + offset_of(size, y));
    };
    crew.team.run(std::ref(body));
}

void fill(const Holes& map, int steps, int passes, const Crew& crew) {
    const size_t pixels = static_cast<size_t>(map.size.width) * map.size.height;
    const bool* end = map.known + pixels;
    if (std::find<const bool*>(map.known, end, true) == end) return;
    const Search search = make_search(map, steps, crew);
    std::atomic<bool> open[2] = {true, true};
    std::atomic<bool> incomplete{false};
    const auto body = [&](int member) {
        const int members = crew.team.size();
        const Rows rows = band(map.size.height, member, members);
        for (long at = offset_of(map.size, rows.begin); at < offset_of(map.size, rows.end); ++at)
            search.w[at] = map.known[at] ? map.u[at] : kNone;
        crew.team.meet();
        bool holes = true;
        for (int pass = 0; pass < passes && open[(pass + 1) % 2]; ++pass) {
            for (int k = member; k < kVertical; k += members) look_across(search, k, crew.sweeps);
            if (member == 0) open[pass % 2] = false;
            crew.team.meet();
            holes = fill_rows(search, rows, member, crew.sweeps);
            if (holes) open[pass % 2] = true;
            crew.team.meet();
        }
        if (holes) incomplete = true;
        std::copy(search.w + offset_of(map.size, rows.begin), search.w + offset_of(map.size, rows.end),
                  map.u + offset_of(map.size, rows.begin));
    };
    crew.team.run(std::ref(body));
    if (!incomplete) return;
    fill_from_nearest(map.size, search.w);
    std::copy(search.w, search.w + pixels, map.u);
}

void fill_occlusions(const Holes& map, const OcclusionRule& rule, bool* filled, const Crew& crew) {
    const auto body = [&](int member) {
        const Rows rows = band(map.size.height, member, crew.team.size());
        for (int y = rows.begin; y < rows.end; ++y) {
            const long o = offset_of(map.size, y);
            crew.sweeps.fill_occlusions(map.u + o, map.known + o, map.size.width, rule, filled + o);
        }
    };
    crew.team.run(std::ref(body));
}

void reach(const Terrain& terrain, bool* reached, const Crew& crew) {
    const auto body = [&](int member) {
        const Rows rows = band(terrain.size.height, member, crew.team.size());
        for (int y = rows.begin; y < rows.end; ++y) crew.sweeps.reach_along(terrain, y, reached);
        crew.team.meet();
        const Rows columns = band(terrain.size.width, member, crew.team.size());
        for (int y = 1; y < terrain.size.height; ++y) crew.sweeps.reach_across(terrain, y - 1, y, columns, reached);
        for (int y = terrain.size.height - 2; y >= 0; --y)
            crew.sweeps.reach_across(terrain, y + 1, y, columns, reached);
    };
    crew.team.run(std::ref(body));
}

}  // namespace stereomend
