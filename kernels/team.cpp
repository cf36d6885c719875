#include "team.hpp"

#include <system_error>

namespace stereomend {

Team::Team(int wanted) {
    others_.reserve(wanted > 1 ? wanted - 1 : 0);
    try {
        for (int member = 1; member < wanted; ++member) others_.emplace_back([this, member] { serve(member); });
    } catch (const std::system_error&) {
    }
    barrier_.resize(size());
}

Team::~Team() {
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        ending_ = true;
    }
    wake_.notify_all();
    for (std::thread& other : others_) other.join();
}

void Team::run(const std::function<void(int)>& body) {
    busy_.store(size() - 1, std::memory_order_relaxed);
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        body_ = &body;
        ++job_;
    }
    wake_.notify_all();
    body(0);
    wait_until([&] { return busy_.load(std::memory_order_acquire) == 0; });
}

void Team::serve(int member) {
    long done = 0;
    while (true) {
        const std::function<void(int)>* body = nullptr;
        {
            std::unique_lock<std::mutex> lock(mutex_);
            wake_.wait(lock, [&] { return ending_ || job_ != done; });
            if (ending_) return;
            done = job_;
            body = body_;
        }
        (*body)(member);
        busy_.fetch_sub(1, std::memory_order_release);
    }
}

}  // namespace stereomend
