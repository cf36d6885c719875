// Runs the kernels on awkward sizes, and on the scene of a file if one is named, with several numbers of threads and
// every instruction set; results must be finite and, for one instruction set, equal bit for bit. Made to be built
// with sanitizers.
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <thread>

#include "../../kernels/exponential.cuh"
#include "scenes.hpp"

using stereomend::Engine;
using stereomend::SolverParams;

namespace {

const SolverParams kPaper{0.5f, 0.1f, 0.25f, 0.5f, 4, 5, false, false, 0.0f};
const SolverParams kReleased{0.375f, 0.1f, 0.25f, 0.5f, 2, 30, false, false, 0.0f};
const SolverParams kAbsolute{0.5f, 0.1f, 0.25f, 0.5f, 1, 1, true, false, 0.0f};
const SolverParams kRobust{0.9f, 0.1f, 0.25f, 0.5f, 3, 10, false, true, 3.5f};
const SolverParams kWidest{0.9f, 0.1f, 0.25f, 0.5f, 1, 3, true, false, 4.0f};

bool all_finite(const std::vector<float>& values) {
    for (const float value : values)
        if (!std::isfinite(value)) return false;
    return true;
}

bool check(const Scene& scene, const std::string& instruction_set, const SolverParams& params) {
    std::vector<float> first;
    for (const int threads : {1, 2, 5}) {
        Engine engine(threads, instruction_set, false);
        for (int repeat = 0; repeat < 2; ++repeat) {
            const std::vector<float> found = run_all(engine, scene, params);
            if (first.empty()) first = found;
            if (!all_finite(found) || std::memcmp(found.data(), first.data(), found.size() * sizeof(float)) != 0) {
                std::printf("%d x %d, %s, %d threads: differs or is not finite\n", scene.size.width, scene.size.height,
                            instruction_set.c_str(), threads);
                return false;
            }
        }
    }
    return true;
}

// Whether a solve that is asked before each warp finds the same, and one that is ended early leaves the engine sound.
bool check_stops(const Scene& scene) {
    for (const int threads : {1, 2, 5}) {
        Engine engine(threads, "", false);
        std::vector<float> whole = scene.u, watched = scene.u, cut = scene.u, again = scene.u;
        engine.solve(scene.level(), kPaper, whole.data());
        int asked = 0;
        engine.solve(scene.level(), kPaper, watched.data(), [&] { return ++asked > 0; });
        for (const SolverParams& params : {kPaper, kRobust}) {
            int left = 2;
            engine.solve(scene.level(), params, cut.data(), [&] { return left-- > 0; });
        }
        engine.solve(scene.level(), kPaper, again.data());
        if (asked == kPaper.warps && watched == whole && again == whole) continue;
        std::printf("%d x %d, %d threads: a watched or ended solve differs\n", scene.size.width, scene.size.height,
                    threads);
        return false;
    }
    return true;
}

// Whether solves find the same that are left to one thread on the way, as more threads than cores are busy.
bool check_crowded(const Scene& scene) {
    std::atomic<bool> over{false};
    std::vector<std::thread> others;
    for (unsigned i = 0; i < 2 * std::thread::hardware_concurrency(); ++i)
        others.emplace_back([&] { while (!over) continue; });
    SolverParams params = kRobust;
    params.warps = 20;
    Engine alone(1, ""), wary(4, "");
    std::vector<float> expected = scene.u;
    alone.solve(scene.level(), params, expected.data());
    bool same = true;
    for (int repeat = 0; repeat < 3; ++repeat) {
        std::vector<float> found = scene.u;
        wary.solve(scene.level(), params, found.data());
        same = same && found == expected;
    }
    over = true;
    for (std::thread& other : others) other.join();
    if (!same) std::printf("%d x %d: a crowded solve differs\n", scene.size.width, scene.size.height);
    return same;
}

// The largest relative error of fast_exp2, and of fast_log2 the error, relative where the logarithm is over 1.
bool check_exponentials() {
    double worst_exp = 0.0;
    double worst_log = 0.0;
    for (float x = -126.0f; x <= 126.0f; x += 0.00013f)
        worst_exp = std::max(worst_exp, std::abs(stereomend::fast_exp2(x) / std::exp2(static_cast<double>(x)) - 1.0));
    for (float x = 1.2e-38f; x < 1e38f; x *= 1.0001f) {
        const double exact = std::log2(static_cast<double>(x));
        worst_log = std::max(worst_log, std::abs(stereomend::fast_log2(x) - exact) / std::max(1.0, std::abs(exact)));
    }
    std::printf("errors up to %.2g of exp2, %.2g of log2\n", worst_exp, worst_log);
    return worst_exp < 2e-7 && worst_log < 2e-7;
}

}  // namespace

int main(int count, char** arguments) {
    if (!check_exponentials()) return 1;
    std::vector<Scene> scenes;
    // Beside the edges of cells and of words of flags, and on both sides of what one member does alone.
    const int sizes[][2] = {{1, 1},    {2, 1},    {1, 2},   {3, 3},   {8, 8},   {33, 1},  {1, 33},
                            {2000, 3}, {3, 2000}, {61, 47}, {64, 48}, {129, 4}, {131, 79}};
    for (const auto& size : sizes) scenes.push_back(noisy_scene(size[0], size[1], 7));
    for (int i = 1; i < count; ++i) scenes.push_back(read_scene(arguments[i]));
    for (const Scene& scene : scenes)
        if (!check_stops(scene)) return 1;
    if (!check_crowded(noisy_scene(320, 240, 7))) return 1;
    int checked = 0;
    for (const Scene& scene : scenes)
        for (const std::string& name : stereomend::instruction_sets())
            for (const SolverParams& params : {kPaper, kReleased, kAbsolute, kRobust, kWidest}) {
                if (!check(scene, name, params)) return 1;
                ++checked;
            }
    std::printf("%d combinations of scene, instruction set and parameters are clean\n", checked);
    return 0;
}
