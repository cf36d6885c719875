// Runs the loops of the ceilings on some threads, against the clock.
#include "ceilings.hpp"

#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <future>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "engine.hpp"

namespace stereomend {
namespace {

constexpr int kPasses = 5;
constexpr long kRounds = 1L << 22;
constexpr long kLeastBytes = 64L << 20;
constexpr long kMostBytes = 256L << 20;

const CeilingLoops& best_loops() {
#ifdef HAVE_SWEEPS_generic
    return ceilings_generic;
#else
    const std::vector<std::string> sets = instruction_sets();
    if (sets.empty()) throw std::runtime_error("this processor lacks the instructions that the kernels need");
    return sets.front() == "x86-64-v3" ? ceilings_v3 : ceilings_v2;
#endif
}

// Elements of each of the three arrays: four times the last cache, as is usual, within bounds.
long triad_count() {
    long cache = 0;
#ifdef _SC_LEVEL3_CACHE_SIZE
    cache = sysconf(_SC_LEVEL3_CACHE_SIZE);
#endif
    return std::clamp(4 * cache, kLeastBytes, kMostBytes) / static_cast<long>(sizeof(float));
}

// Seconds from the moment all threads are there until body(member) has returned in all of them.
template <class Body>
double seconds(int threads, const Body& body) {
    std::atomic<int> waiting{0};
    std::atomic<bool> open{false};
    const auto member_runs = [&](int member) {
        ++waiting;
        while (!open) std::this_thread::yield();
        body(member);
    };
    std::vector<std::future<void>> members;
    try {
        for (int member = 0; member < threads; ++member)
            members.push_back(std::async(std::launch::async, member_runs, member));
    } catch (...) {
        open = true;
        throw;
    }
    while (waiting < threads) std::this_thread::yield();
    const auto began = std::chrono::steady_clock::now();
    open = true;
    for (std::future<void>& member : members) member.get();
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
}

template <class Body>
double best_seconds(int threads, const Body& body) {
    double best = seconds(threads, body);
    for (int pass = 1; pass < kPasses; ++pass) best = std::min(best, seconds(threads, body));
    return best;
}

}  // namespace

double triad(int threads) {
    const CeilingLoops& loops = best_loops();
    const long count = triad_count();
    const auto edge = [&](int member) { return count * member / threads; };
    const std::unique_ptr<float[]> a(new float[count]), b(new float[count]), c(new float[count]);
    seconds(threads, [&](int member) {
        for (float* array : {a.get(), b.get(), c.get()})
            std::fill(array + edge(member), array + edge(member + 1), 1.0f);
    });
    const double best = best_seconds(threads, [&](int member) {
        const long begin = edge(member);
        loops.triad(b.get() + begin, c.get() + begin, 3.0f, a.get() + begin, edge(member + 1) - begin);
    });
    return 3.0 * sizeof(float) * count / best * 1e-9;
}

double multiply_add(int threads) {
    const CeilingLoops& loops = best_loops();
    std::vector<float> sums(threads);
    // The chains approach 1: neither overflow nor subnormal numbers, which some processors slow down for.
    volatile float factor = 0.999f;
    const float multiplier = factor;
    const double best = best_seconds(
        threads, [&](int member) { sums[member] = loops.multiply_add(multiplier, 1.0f - multiplier, kRounds); });
    volatile float used = sums[0];
    (void)used;
    return 2.0 * loops.chains * kRounds * threads / best * 1e-9;
}

}  // namespace stereomend
