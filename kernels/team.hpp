// A few threads that work on bands of rows and meet between sweeps.
#pragma once

#include <atomic>
#include <system_error>
#include <thread>
#include <vector>

#include "sweeps.hpp"

namespace stereomend {

// Lets nobody pass before all have come. Waiting threads yield: cores may be fewer than threads.
class Barrier {
public:
    explicit Barrier(int size) : size_(size) {}

    void wait() {
        const int turn = turn_.load(std::memory_order_acquire);
        if (arrived_.fetch_add(1, std::memory_order_acq_rel) + 1 == size_) {
            arrived_.store(0, std::memory_order_relaxed);
            turn_.store(turn + 1, std::memory_order_release);
            return;
        }
        while (turn_.load(std::memory_order_acquire) == turn) std::this_thread::yield();
    }

private:
    const int size_;
    std::atomic<int> arrived_{0};
    std::atomic<int> turn_{0};
};

// The rows of one member: contiguous, disjoint, together all of [0, height).
inline Rows band(int height, int member, int size) {
    const auto edge = [&](int i) { return static_cast<int>(static_cast<long>(height) * i / size); };
    return {edge(member), edge(member + 1)};
}

// Runs body(member, size, barrier) on up to `wanted` threads, the caller's own among them, and waits for all.
// Where the system gives fewer threads, fewer work. The body must not throw.
template <class Body>
void run_team(int wanted, const Body& body) {
    std::atomic<Barrier*> gate{nullptr};
    std::atomic<int> size{0};
    const auto join_in = [&](int member) {
        Barrier* barrier = nullptr;
        while (!(barrier = gate.load(std::memory_order_acquire))) std::this_thread::yield();
        body(member, size.load(), *barrier);
    };
    std::vector<std::thread> others;
    others.reserve(wanted > 1 ? wanted - 1 : 0);
    try {
        for (int member = 1; member < wanted; ++member) others.emplace_back(join_in, member);
    } catch (const std::system_error&) {
    }
    size = static_cast<int>(others.size()) + 1;
    Barrier barrier(size);
    gate.store(&barrier, std::memory_order_release);
    join_in(0);
    for (std::thread& other : others) other.join();
}

}  // namespace stereomend
