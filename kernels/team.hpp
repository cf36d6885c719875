// A few threads that stay, work on one job together, and meet inside it.
#pragma once

#include <sched.h>

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

#include "sweeps.hpp"

namespace stereomend {

// Waits inside a job: soon over, but cores may be fewer than threads.
template <class Condition>
void wait_until(const Condition& holds) {
    for (int spin = 0; !holds(); ++spin)
        if (spin > 64) std::this_thread::yield();
}

// Lets nobody pass before all have come.
class Barrier {
public:
    void resize(int size) { size_ = size; }

    void wait() {
        const int turn = turn_.load(std::memory_order_acquire);
        if (arrived_.fetch_add(1, std::memory_order_acq_rel) + 1 == size_) {
            arrived_.store(0, std::memory_order_relaxed);
            turn_.store(turn + 1, std::memory_order_release);
            return;
        }
        wait_until([&] { return turn_.load(std::memory_order_acquire) != turn; });
    }

private:
    int size_ = 1;
    std::atomic<int> arrived_{0};
    std::atomic<int> turn_{0};
};

// The rows of one member: contiguous, disjoint, together all of [0, height).
inline Rows band(int height, int member, int size) {
    const auto edge = [&](int i) { return static_cast<int>(static_cast<long>(height) * i / size); };
    return {edge(member), edge(member + 1)};
}

// Between jobs the threads wait for a moment, then sleep. Where the system gives fewer threads than wanted, fewer work.
class Team {
public:
    explicit Team(int wanted);
    ~Team();
    Team(const Team&) = delete;
    Team& operator=(const Team&) = delete;

    // Of those who are to work: all, or the caller alone.
    int size() const { return size_; }

    // Says who is to work from now on; not inside a body.
    void muster(bool alone);

    // How long a member has computed in its life, the caller being member 0.
    std::chrono::nanoseconds busy(int member) const;

    // Runs body(member) once for each member, the caller being member 0. The body must not throw.
    void run(const std::function<void(int)>& body);

    // Runs body(member, piece) once for each of `count` pieces, begun in their order by whoever has nothing to do. Who
    // comes too late is not waited for: its core may be busy with something else. The body must not throw or meet().
    void share(int count, const std::function<void(int, int)>& body);

    // For use inside a body: waits until all members have come here.
    void meet() { barrier_.wait(); }

private:
    void serve(int member);
    void linger(long done) const;
    void spread();
    void begin(const std::function<void(int)>& body, bool open);

    cpu_set_t allowed_;
    std::vector<int> cores_;
    bool lingers_ = false;  // there is a core for each
    std::vector<std::thread> others_;
    int size_ = 1;
    Barrier barrier_;
    std::mutex mutex_;
    std::condition_variable wake_;
    const std::function<void(int)>* body_ = nullptr;
    bool open_ = false;  // to those that come in time, while body_ is there; else all are waited for
    std::atomic<long> job_{0};
    int asleep_ = 0;
    bool ending_ = false;
    std::atomic<int> busy_{0};
};

}  // namespace stereomend
