#include "team.hpp"

#include <pthread.h>
#include <time.h>

#include <algorithm>
#include <system_error>

namespace stereomend {
namespace {

// One call often follows another, and to wake a thread takes longer than many a job. Longer pauses are for others.
constexpr std::chrono::microseconds kLinger{300};

}  // namespace

Team::Team(int wanted) {
    CPU_ZERO(&allowed_);
    sched_getaffinity(0, sizeof allowed_, &allowed_);
    for (int core = 0; core < CPU_SETSIZE; ++core)
        if (CPU_ISSET(core, &allowed_)) cores_.push_back(core);
    lingers_ = wanted <= static_cast<int>(cores_.size());
    others_.reserve(wanted > 1 ? wanted - 1 : 0);
    try {
        for (int member = 1; member < wanted; ++member) others_.emplace_back([this, member] { serve(member); });
    } catch (const std::system_error&) {
    }
    muster(false);
}

Team::~Team() {
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        ending_ = true;
    }
    wake_.notify_all();
    for (std::thread& other : others_) other.join();
}

void Team::muster(bool alone) {
    size_ = alone ? 1 : static_cast<int>(others_.size()) + 1;
    barrier_.resize(size_);
}

std::chrono::nanoseconds Team::busy(int member) const {
    clockid_t clock = CLOCK_THREAD_CPUTIME_ID;
    if (member > 0) pthread_getcpuclockid(const_cast<std::thread&>(others_[member - 1]).native_handle(), &clock);
    timespec spent{};
    clock_gettime(clock, &spent);
    return std::chrono::seconds(spent.tv_sec) + std::chrono::nanoseconds(spent.tv_nsec);
}

// Has each other thread wake on a core of its own. Left alone, the scheduler often wakes it on the caller's, and it
// takes up to a tenth of a second until it moves away: longer than most jobs.
void Team::spread() {
    const size_t here = std::find(cores_.begin(), cores_.end(), sched_getcpu()) - cores_.begin();
    if (here == cores_.size() || others_.size() >= cores_.size()) return;
    for (size_t i = 0; i < others_.size(); ++i) {
        cpu_set_t one;
        CPU_ZERO(&one);
        CPU_SET(cores_[(here + 1 + i) % cores_.size()], &one);
        pthread_setaffinity_np(others_[i].native_handle(), sizeof one, &one);
    }
}

void Team::begin(const std::function<void(int)>& body, bool open) {
    bool asleep;
    busy_.store(open ? 0 : size() - 1, std::memory_order_relaxed);
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        body_ = &body;
        open_ = open;
        job_.store(job_.load(std::memory_order_relaxed) + 1, std::memory_order_release);
        asleep = asleep_ > 0;
    }
    if (!asleep) return;
    spread();
    wake_.notify_all();
}

// Returns when there is a job after `done`, or none came for a while.
void Team::linger(long done) const {
    const auto end = std::chrono::steady_clock::now() + kLinger;
    while (job_.load(std::memory_order_acquire) == done && std::chrono::steady_clock::now() < end)
        std::this_thread::yield();
}

void Team::run(const std::function<void(int)>& body) {
    if (size() == 1) return body(0);
    begin(body, false);
    body(0);
    wait_until([&] { return busy_.load(std::memory_order_acquire) == 0; });
}

void Team::share(int count, const std::function<void(int, int)>& body) {
    std::atomic<int> next{0};
    const std::function<void(int)> work = [&](int member) {
        for (int piece = next++; piece < count; piece = next++) body(member, piece);
    };
    if (size() == 1) return work(0);
    begin(work, true);
    work(0);
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        body_ = nullptr;
    }
    wait_until([&] { return busy_.load(std::memory_order_acquire) == 0; });
}

void Team::serve(int member) {
    long done = 0;
    while (true) {
        const std::function<void(int)>* body = nullptr;
        bool slept = false;
        if (lingers_) linger(done);
        {
            std::unique_lock<std::mutex> lock(mutex_);
            while (!ending_ && job_ == done) {
                slept = true;
                ++asleep_;
                wake_.wait(lock);
                --asleep_;
            }
            if (ending_) return;
            done = job_;
            body = body_;
            if (!body) continue;
            if (open_) busy_.fetch_add(1, std::memory_order_relaxed);
        }
        // Awake on its core, it may move again if others need that one.
        if (slept) pthread_setaffinity_np(pthread_self(), sizeof allowed_, &allowed_);
        (*body)(member);
        busy_.fetch_sub(1, std::memory_order_release);
    }
}

}  // namespace stereomend
