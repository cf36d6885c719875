#include "ldr.hpp"

#include <algorithm>
#include <functional>

namespace stereomend {
namespace {

long offset_of(Size size, int y) { return static_cast<long>(y) * size.width; }

bool is_known(float w) { return w < kNone; }

// Memory of one fill: the map with kNone in its holes, and what is met below each pixel.
struct Search {
    Size size;
    float* w;               // (height, width)
    float* below[kWays];    // (height, width + 2)
    float* memory;          // rows of width + 2, so many for each member
    int reach;              // most steps

    static constexpr int kFronts = 4 * kWays;  // of two fronts that take turns
    static constexpr int kRows = kFronts + 2;

    int stride() const { return size.width + 2; }
    float* row(int member, int i) const { return memory + static_cast<size_t>(stride()) * (kRows * member + i); }
    Front front(int member, int turn) const {
        Front front;
        for (int k = 0; k < kWays; ++k) {
            front.values[k] = row(member, (2 * turn) * kWays + k) + 1;
            front.steps[k] = row(member, (2 * turn + 1) * kWays + k) + 1;
        }
        return front;
    }
};

Search make_search(const Holes& map, int steps, const Crew& crew) {
    const size_t stride = map.size.width + 2;
    const size_t plane = stride * map.size.height;
    const size_t rows = Search::kRows * stride * crew.team.size();
    std::vector<float>& planes = crew.buffers.planes;
    planes.resize(std::max(planes.size(), (kWays + 1) * plane + rows));
    float* at = planes.data();
    Search search{map.size, at, {}, at + (kWays + 1) * plane, steps};
    for (int k = 0; k < kWays; ++k) search.below[k] = at + (k + 1) * plane;
    return search;
}

// Where nothing has been met yet.
Front fresh_front(const Search& search, int member) {
    float* first = search.row(member, 0);
    std::fill(first, first + static_cast<size_t>(Search::kFronts) * search.stride(), kNone);
    return search.front(member, 0);
}

// For the pixels of some rows what is met below them. Farther than `reach` nothing has to be looked for, so that no
// member waits for another.
void look_below(const Search& search, Rows rows, int member, const LdrSweeps& sweeps) {
    Front before = fresh_front(search, member);
    int turn = 1;
    for (int y = std::min(rows.end - 1 + search.reach, search.size.height - 1); y >= rows.begin; --y, turn = 1 - turn) {
        Front now = search.front(member, turn);
        for (int k = 0; y < rows.end && k < kWays; ++k) {
            now.values[k] = search.below[k] + static_cast<long>(y) * search.stride() + 1;
            now.values[k][-1] = now.values[k][search.size.width] = kNone;
        }
        sweeps.look(search.w + offset_of(search.size, y), before, search.reach, search.size.width, now);
        before = now;
    }
}

// A search down the picture, row by row.
class LookAbove {
public:
    // Comes to the row in front of `y`.
    LookAbove(const Search& search, int y, int member, const LdrSweeps& sweeps)
        : search_(search), member_(member), sweeps_(sweeps), before_(fresh_front(search, member)) {
        for (int row = std::max(0, y - search.reach); row < y; ++row) pass(row);
    }

    const Front& pass(int y) {
        const Front now = search_.front(member_, turn_);
        sweeps_.look(search_.w + offset_of(search_.size, y), before_, search_.reach, search_.size.width, now);
        turn_ = 1 - turn_;
        return before_ = now;
    }

private:
    const Search& search_;
    const int member_;
    const LdrSweeps& sweeps_;
    Front before_;
    int turn_ = 1;
};

// Fills the holes of some rows from all eight directions; returns from which to which row any remains.
Rows fill_rows(const Search& search, Rows rows, int member, LookAbove& look, const LdrSweeps& sweeps) {
    const int width = search.size.width;
    float* east = search.row(member, Search::kFronts);
    float* west = east + search.stride();
    Rows open{rows.end, rows.end};
    for (int y = rows.begin; y < rows.end; ++y) {
        const Front& above = look.pass(y);
        float* w = search.w + offset_of(search.size, y);
        if (!sweeps.has_hole(w, 0, width)) continue;
        const float* met[8] = {east, west};
        for (int k = 0; k < kWays; ++k) {
            met[2 + k] = above.values[k];
            met[2 + kWays + k] = search.below[k] + static_cast<long>(y) * search.stride() + 1;
        }
        sweeps.look_along(w, search.reach, width, east, west);
        if (sweeps.fill_row(met, width, w)) open = {std::min(open.begin, y), y + 1};
    }
    return open;
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
        Rows holes = rows;
        for (int pass = 0; pass < passes && open[(pass + 1) % 2]; ++pass) {
            look_below(search, holes, member, crew.sweeps);
            LookAbove look(search, holes.begin, member, crew.sweeps);
            if (member == 0) open[pass % 2] = false;
            crew.team.meet();
            holes = fill_rows(search, holes, member, look, crew.sweeps);
            if (holes.begin < holes.end) open[pass % 2] = true;
            crew.team.meet();
        }
        if (holes.begin < holes.end) incomplete = true;
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
