#include "engine.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <functional>

#include "instruction_sets.hpp"

namespace stereomend {
namespace {

// Rows of state that should stay in the cache of one core while a lap passes [bytes].
constexpr long kCacheBytes = 512 << 10;
constexpr int kPlanes = 6;

// Levels below this number of pixels are faster on one thread than with any meeting [px].
constexpr long kAlone = 3000;

// From this number of pixels on several threads follow each other down the image; below, the state of each one's rows
// stays in its core's cache, and rows that change hands cost more than the sweeps through memory they save [px].
constexpr long kFollow = 300000;

// Iterations that one member takes down the image together.
int lap_length(const Level& level, const SolverParams& params, int crew) {
    const long in_cache = kCacheBytes / (kPlanes * static_cast<long>(sizeof(float)) * level.width);
    const long fair = (params.iterations + crew - 1) / crew;
    return static_cast<int>(std::max(1L, std::min({fair, in_cache, level.height / (4L * crew)})));
}

// A Gaussian cut off at twice its standard deviation [px].
Window window_of(float deviation) {
    Window window{0, {1.0f}};
    if (deviation <= 0.0f) return window;
    window.radius = std::min(kMostTaps - 1, static_cast<int>(std::ceil(2.0f * deviation)));
    float sum = 0.0f;
    for (int i = 0; i <= window.radius; ++i) {
        window.taps[i] = std::exp(-0.5f * i * i / (deviation * deviation));
        sum += i == 0 ? window.taps[i] : 2.0f * window.taps[i];
    }
    for (int i = 0; i <= window.radius; ++i) window.taps[i] /= sum;
    return window;
}

// Rows that are taken at a time where members take them as they come.
constexpr int kPiece = 8;

// Readings of these rows that are compared at once.
constexpr size_t kTogether = 6;

int pieces_of(int height) { return (height + kPiece - 1) / kPiece; }

Rows piece_of(int height, int piece) { return {piece * kPiece, std::min((piece + 1) * kPiece, height)}; }

// Runs body(offset) for every row, by whoever is free.
template <class Body>
void each_row(Team& team, Size size, const Body& body) {
    team.share(pieces_of(size.height), [&](int, int piece) {
        const Rows rows = piece_of(size.height, piece);
        for (int y = rows.begin; y < rows.end; ++y) body(static_cast<size_t>(y) * size.width);
    });
}

Laps plan_laps(const Level& level, const SolverParams& params, int crew) {
    const int length = lap_length(level, params, crew);
    return {length, (params.iterations + length - 1) / length, crew};
}

// Room for a plane of so many floats, such that the same pixel of the next ones lies elsewhere in a page: caches have
// too few ways for ten of them, and sizes of pictures are round.
size_t staggered(size_t pixels) {
    constexpr size_t kPage = 4096 / sizeof(float);
    constexpr size_t kApart = 7 * 64 / sizeof(float);
    return (pixels + kPage - 1) / kPage * kPage + kApart;
}

// Copies rows of an image, each with its ends repeated.
void pad(const float* source, int width, Rows rows, float* out) {
    for (int y = rows.begin; y < rows.end; ++y) {
        const float* from = source + static_cast<size_t>(y) * width;
        float* row = out + static_cast<size_t>(y) * (width + 2);
        std::copy(from, from + width, row + 1);
        row[0] = row[1];
        row[width + 1] = row[width];
    }
}

}  // namespace

std::vector<std::string> instruction_sets() {
    std::vector<std::string> names;
    for (const Candidate& candidate : kCandidates)
        if (candidate.supported()) names.emplace_back(candidate.name);
    return names;
}

Engine::Engine(int threads, const std::string& instruction_set, bool wary)
    : sweeps_(*best(instruction_set).gdr),
      team_(threads),
      crowd_(team_, wary),
      ldr_{team_, ldr_buffers_, *best(instruction_set).ldr},
      evidence_{team_, evidence_buffers_, *best(instruction_set).evidence, ldr_.sweeps},
      fusion_{evidence_, *best(instruction_set).fusion, cell_buffers_},
      resize_{team_, resize_buffers_, *best(instruction_set).resize} {}

// Room for so many rows of the right image, and for the descriptors of each member.
void Engine::reserve(int width, size_t rows) {
    right_.resize(std::max(right_.size(), rows * (width + 2)));
    scratch_.resize(std::max(scratch_.size(), scratch_floats(width) * team_.size()));
}

Level Engine::padded(const Level& level) {
    reserve(level.width, level.height);
    pad(level.right, level.width, {0, level.height}, right_.data());
    return {level.width, level.height, level.left, right_.data(), level.weight, level.edge, level.prior, level.trust};
}

void Engine::prepare(const Level& level, float* u) {
    const size_t pitch = staggered(static_cast<size_t>(level.width) * level.height);
    planes_.resize(std::max(planes_.size(), 9 * pitch));
    float* at = planes_.data();
    state_ = {u, at, at + pitch, at + 2 * pitch, at + 3 * pitch, at + 4 * pitch,
              at + 5 * pitch, at + 6 * pitch, at + 7 * pitch, at + 8 * pitch};
    std::fill(state_.p_x, state_.p_x + 2 * pitch, 0.0f);
}

void Engine::solve(const Level& unpadded, const SolverParams& params, float* u, const GoOn& go_on) {
    const Turn turn(*this);
    const Level level = padded(unpadded);
    prepare(level, u);
    const long pixels = static_cast<long>(level.width) * level.height;
    const int crew = pixels < kAlone ? 1 : team_.size();
    const Laps planned = plan_laps(level, params, crew);
    const Window window = window_of(params.averaging);
    if (progress_.size() < static_cast<size_t>(planned.count)) progress_ = std::vector<Progress>(planned.count);
    // Written by the caller's member before a meeting, read by all after it.
    bool stopped = false;
    bool crowded = false;
    const auto body = [&](int member) {
        if (member >= crew) return;
        Laps laps = planned;
        Rows rows = band(level.height, member, crew);
        if (level.edge) sweeps_.prepare_edges(level, state_, params, rows);
        for (int warp = 0; warp < params.warps; ++warp) {
            if (member == 0 && go_on && !go_on()) stopped = true;
            for (int lap = member; lap < laps.count; lap += laps.crew)
                progress_[lap].rows.store(0, std::memory_order_relaxed);
            linearise(level, params, window, {rows, member, laps.crew});
            if (stopped) return;
            if (laps.crew == 1 || pixels >= kFollow) wave(level, params, laps, member);
            else sweep(level, params, member);
            if (laps.crew == 1) continue;
            if (member == 0) crowded = crowd_.seen();
            team_.meet();
            if (!crowded) continue;
            if (member > 0) return;
            laps = plan_laps(level, params, 1);
            rows = {0, level.height};
        }
    };
    if (crew == 1) return body(0);
    crowd_.begin();
    team_.run(std::ref(body));
}

// Ends with a meeting.
void Engine::linearise(const Level& level, const SolverParams& params, const Window& window, const Part& part) {
    float* own = scratch_.data() + scratch_floats(level.width) * part.member;
    if (level.prior || params.observed_only || params.averaging > 0.0f) {
        sweeps_.gather(level, state_, params, window, part.rows, own);
        if (part.crew > 1) team_.meet();
        sweeps_.settle(level, state_, params, window, part.rows);
    } else {
        sweeps_.linearise(level, state_, params, part.rows, own);
    }
    if (part.crew > 1) team_.meet();
}

// Each member keeps its rows; all meet between the steps.
void Engine::sweep(const Level& level, const SolverParams& params, int member) {
    const Rows rows = band(level.height, member, team_.size());
    for (int iteration = 0; iteration < params.iterations; ++iteration) {
        const float* extrapolated = iteration == 0 ? state_.u : state_.u_bar;
        for (int y = rows.begin; y < rows.end; ++y) sweeps_.dual(level, state_, params, extrapolated, y);
        team_.meet();
        for (int y = rows.begin; y < rows.end; ++y) sweeps_.primal(level, state_, params, y);
        team_.meet();
    }
}

// Iteration k of row y needs only iteration k - 1 of row y + 1 and iteration k of row y - 1. So the iterations of a
// lap go down the image as a diagonal of rows, in place, and laps follow each other a row behind.
void Engine::wave(const Level& level, const SolverParams& params, const Laps& laps, int member) {
    for (int lap = member; lap < laps.count; lap += laps.crew) {
        const int count = std::min(laps.length, params.iterations - lap * laps.length);
        for (int front = 0; front < level.height + count - 1; ++front) {
            if (lap > 0 && front < level.height) {
                const int needed = std::min(front + 2, level.height);
                wait_until([&] { return progress_[lap - 1].rows.load(std::memory_order_acquire) >= needed; });
            }
            for (int k = std::max(0, front - level.height + 1); k < std::min(count, front + 1); ++k) {
                const float* extrapolated = lap == 0 && k == 0 ? state_.u : state_.u_bar;
                sweeps_.dual(level, state_, params, extrapolated, front - k);
                sweeps_.primal(level, state_, params, front - k);
            }
            const int done = front - count + 2;
            if (done > 0) progress_[lap].rows.store(done, std::memory_order_release);
        }
    }
}

// Rows are taken by whoever is free, for one core may be busy with something else; the left image is described once for
// a few readings.
std::vector<Mismatch> Engine::mismatch(Size size, const float* left, const std::vector<Reading>& readings) {
    const Turn turn(*this);
    const size_t height = size.height;
    const size_t floats = distance_floats(size.width, kPiece);
    scratch_.resize(std::max(scratch_.size(), floats * team_.size()));
    seen_.resize(std::max(seen_.size(), static_cast<size_t>(kPiece) * size.width * team_.size()));
    sums_.assign(height * readings.size(), 0.0);
    counts_.assign(height * readings.size(), 0);
    const int groups = static_cast<int>((readings.size() + kTogether - 1) / kTogether);
    team_.share(groups * pieces_of(size.height), [&](int member, int piece) {
        const Rows rows = piece_of(size.height, piece / groups);
        const size_t begin = piece % groups * kTogether;
        float* described = scratch_.data() + floats * member;
        float* own = described + descriptors_of_rows(size.width, kPiece) + 3 * (size.width + 2);
        bool* seen = reinterpret_cast<bool*>(seen_.data()) + static_cast<size_t>(kPiece) * size.width * member;
        bool known = false;
        for (size_t k = begin; k < std::min(begin + kTogether, readings.size()); ++k) {
            const size_t first = k * height + rows.begin;
            if (see(size.width, readings[k], rows, seen, counts_.data() + first) == 0) continue;
            const Level level{size.width, size.height, left, readings[k].right};
            if (!known) sweeps_.describe(level, rows, described);
            known = true;
            sweeps_.distance(level, readings[k].u, described, seen, rows, own, sums_.data() + first);
        }
    });
    // In the order of the rows, whoever summed them.
    std::vector<Mismatch> found(readings.size(), {0.0, 0});
    for (size_t row = 0; row < sums_.size(); ++row) {
        found[row / height].sum += sums_[row];
        found[row / height].count += counts_[row];
    }
    return found;
}

// Finds the pixels of some rows that are valid and that the right image shows; returns their number, also by row.
long Engine::see(int width, const Reading& reading, Rows rows, bool* seen, long* counts) {
    long total = 0;
    for (int y = rows.begin; y < rows.end; ++y, seen += width) {
        const size_t o = static_cast<size_t>(y) * width;
        const bool* valid = reading.valid + o;
        // Most rows of a sample are not in it.
        if (!memchr(valid, true, width)) {
            std::fill(seen, seen + width, false);
            *counts++ = 0;
            continue;
        }
        ldr_.sweeps.unobserved_row(reading.u + o, width, seen);
        for (int x = 0; x < width; ++x) seen[x] = valid[x] & !seen[x];
        total += *counts++ = std::count(seen, seen + width, true);
    }
    return total;
}

void Engine::unobserved(Size size, const float* u, bool* out) {
    const Turn turn(*this);
    each_row(team_, size, [&](size_t o) { ldr_.sweeps.unobserved_row(u + o, size.width, out + o); });
}

void Engine::shown(Size size, const float* u, const bool* valid, bool* shown, bool* hidden) {
    const Turn turn(*this);
    each_row(team_, size,
             [&](size_t o) { ldr_.sweeps.shown_row(u + o, valid + o, size.width, shown + o, hidden + o); });
}

void Engine::confidence(const ConfidenceInput& input, const ConfidenceParams& params, float* out) {
    const Turn turn(*this);
    stereomend::confidence(input, params, out, ldr_);
}

void Engine::fill(const Holes& map, int steps, int passes) {
    const Turn turn(*this);
    stereomend::fill(map, steps, passes, ldr_);
}

void Engine::fill_occlusions(const Holes& map, const OcclusionRule& rule, bool* filled) {
    const Turn turn(*this);
    stereomend::fill_occlusions(map, rule, filled, ldr_);
}

void Engine::reach(const Terrain& terrain, bool* reached) {
    const Turn turn(*this);
    stereomend::reach(terrain, reached, ldr_);
}

void Engine::evidence(const Pair& pair, const std::vector<const float*>& maps, const std::vector<float*>& found) {
    const Turn turn(*this);
    stereomend::evidence(pair, maps, found, evidence_);
}

void Engine::trust(const ConfidenceInput& input, const TrustParams& params, const SpeckleRule& rule, float* out) {
    const Turn turn(*this);
    stereomend::trust(input, params, rule, out, evidence_);
}

void Engine::speckles(const Steps& map, int largest, bool* out) {
    const Turn turn(*this);
    stereomend::speckles(map, largest, out, evidence_);
}

void Engine::edge_weights(const Channels& channels, const EdgeParams& params, float* out) {
    const Turn turn(*this);
    stereomend::edge_weights(channels, params, out, evidence_);
}

void Engine::glints(const Channels& channels, const GlintRule& rule, bool* found, bool* nearly) {
    const Turn turn(*this);
    stereomend::glints(channels, rule, found, nearly, evidence_);
}

void Engine::better(const Pair& pair, const float* u, const float* other, const ReuseRule& rule, float* out) {
    const Turn turn(*this);
    stereomend::better(pair, u, other, rule, out, evidence_);
}

void Engine::halve(Size from, const std::vector<const float*>& planes, const std::vector<float*>& out) {
    const Turn turn(*this);
    stereomend::halve(from, planes, out, evidence_);
}

void Engine::halve_weighed(Size from, const Weighed& map) {
    const Turn turn(*this);
    stereomend::halve_weighed(from, map, evidence_);
}

void Engine::poll(const Rivals& rivals, const PollMarks& marks, const PollRule& rule, double* out) {
    const Turn turn(*this);
    stereomend::poll(rivals, marks, rule, out, fusion_);
}

void Engine::choose(const Rivals& rivals, const Grounds& grounds, const ChoiceRule& rule, float* out) {
    const Turn turn(*this);
    stereomend::choose(rivals, grounds, rule, out, fusion_);
}

void Engine::ground(Size size, const double* polls, const GroundRule& rule, float* const out[3]) {
    const Turn turn(*this);
    stereomend::ground(size, polls, rule, out, fusion_);
}

void Engine::bend(Size size, const float* u, const double* polls, const BendRule& rule, float* out) {
    const Turn turn(*this);
    stereomend::bend(size, u, polls, rule, out, fusion_);
}

void Engine::shrink(const Samples& from, Size to, const Shrunk& out) {
    const Turn turn(*this);
    stereomend::shrink(from, to, out, resize_);
}

void Engine::merge(const Offer& offer, float* out) {
    const Turn turn(*this);
    stereomend::merge(offer, out, resize_);
}

void Engine::shrink_sparse(const Sparse& from, Size to, float half, float* u, bool* valid) {
    const Turn turn(*this);
    stereomend::shrink_sparse(from, to, half, u, valid, resize_);
}

void Engine::sample_sparse(const Sparse& from, Size to, float* u, bool* valid) {
    const Turn turn(*this);
    stereomend::sample_sparse(from, to, u, valid, resize_);
}

void Engine::tell(const Origins& origins, const float* u, Kinds& out) {
    const Turn turn(*this);
    stereomend::tell(origins, u, ldr_.sweeps, out, resize_);
}

}  // namespace stereomend
