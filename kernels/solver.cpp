#include "solver.hpp"

#include <stdexcept>

#include "team.hpp"

namespace stereomend {
namespace {

struct Candidate {
    const char* name;
    const Sweeps* sweeps;
    bool (*supported)();
};

#ifdef HAVE_SWEEPS_v3
bool has_v3() {
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
           __builtin_cpu_supports("bmi2") && __builtin_cpu_supports("lzcnt") && __builtin_cpu_supports("movbe") &&
           __builtin_cpu_supports("f16c");
}

bool has_v2() { return __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt"); }

const Candidate kCandidates[] = {{"x86-64-v3", &sweeps_v3, has_v3}, {"x86-64-v2", &sweeps_v2, has_v2}};
#else
bool always() { return true; }

const Candidate kCandidates[] = {{"generic", &sweeps_generic, always}};
#endif

// The planes of one solve, all zero at first.
class Planes {
public:
    Planes(const Level& level, float* u)
        : size_(static_cast<size_t>(level.width) * level.height), memory_(5 * size_, 0.0f), u_(u) {}

    State state() {
        float* at = memory_.data();
        return {u_, at, at + size_, at + 2 * size_, at + 3 * size_, at + 4 * size_};
    }

private:
    size_t size_;
    std::vector<float> memory_;
    float* u_;
};

void warp_once(const Sweeps& sweeps, const Level& level, const State& state, const SolverParams& params, Rows rows,
               float* scratch, Barrier& barrier) {
    sweeps.linearise(level, state, params, rows, scratch);
    barrier.wait();
    for (int iteration = 0; iteration < params.iterations; ++iteration) {
        sweeps.dual(level, state, params, rows);
        barrier.wait();
        sweeps.primal(level, state, params, rows);
        barrier.wait();
    }
}

}  // namespace

std::vector<std::string> instruction_sets() {
    std::vector<std::string> names;
    for (const Candidate& candidate : kCandidates)
        if (candidate.supported()) names.emplace_back(candidate.name);
    return names;
}

const Sweeps& choose_sweeps(const std::string& name) {
    for (const Candidate& candidate : kCandidates)
        if (candidate.supported() && (name.empty() || name == candidate.name)) return *candidate.sweeps;
    throw std::invalid_argument("instruction set '" + name + "' is not available on this machine");
}

void solve_level(const Sweeps& sweeps, const Level& level, const SolverParams& params, float* u, int threads) {
    Planes planes(level, u);
    const State state = planes.state();
    const int scratch_size = scratch_floats(level.width);
    std::vector<float> scratch(static_cast<size_t>(scratch_size) * threads);
    run_team(threads, [&](int member, int size, Barrier& barrier) {
        const Rows rows = band(level.height, member, size);
        float* own = scratch.data() + static_cast<size_t>(scratch_size) * member;
        for (int warp = 0; warp < params.warps; ++warp)
            warp_once(sweeps, level, state, params, rows, own, barrier);
    });
}

void descriptor_distance(const Sweeps& sweeps, const Level& level, const float* u, bool absolute, float* out,
                         int threads) {
    const int scratch_size = scratch_floats(level.width);
    std::vector<float> scratch(static_cast<size_t>(scratch_size) * threads);
    run_team(threads, [&](int member, int size, Barrier&) {
        float* own = scratch.data() + static_cast<size_t>(scratch_size) * member;
        sweeps.distance(level, u, absolute, out, band(level.height, member, size), own);
    });
}

}  // namespace stereomend
