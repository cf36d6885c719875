#include "crowd.hpp"

#include <algorithm>

namespace stereomend {
namespace {

// Long beside the time it takes to wake a thread, and beside what the server needs of a core now and then: of windows of
// 2 ms one in 200 looked crowded on a quiet machine, and requests for a quarter of a second after it paid for that.
constexpr std::chrono::nanoseconds kWatched = std::chrono::milliseconds(8);

constexpr double kLeastShare = 0.65;

// Then the team is tried again; it costs a warp or two to find out that others are still there.
constexpr std::chrono::nanoseconds kShortest = std::chrono::milliseconds(250);
constexpr std::chrono::nanoseconds kLongest = std::chrono::seconds(4);

}  // namespace

Crowd::Crowd(const Team& team, bool wary) : team_(team), wary_(wary), busy_(team.size()), pause_(kShortest) {}

void Crowd::begin() {
    since_ = Clock::now();
    for (int member = 0; member < team_.size(); ++member) busy_[member] = team_.busy(member);
}

bool Crowd::seen() {
    const Clock::time_point now = Clock::now();
    const Span passed = now - since_;
    if (!wary_ || passed < kWatched) return false;
    bool crowded = false;
    for (int member = 0; member < team_.size(); ++member) {
        const Span busy = team_.busy(member);
        if (busy - busy_[member] < kLeastShare * passed) crowded = true;
        busy_[member] = busy;
    }
    since_ = now;
    if (crowded) until_ = now + pause_;
    pause_ = crowded ? std::min(2 * pause_, kLongest) : kShortest;
    return crowded;
}

}  // namespace stereomend
