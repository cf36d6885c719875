// Notices when other processes take the cores of a team whose members wait for each other.
#pragma once

#include <chrono>
#include <vector>

#include "team.hpp"

namespace stereomend {

// Members that meet after every iteration are as fast as the one who has least of its core, and whoever waits yields
// its own: beside two busy processes a solve takes many times what one thread takes. Such work is then better done by
// one for a while. For the caller's thread alone.
class Crowd {
public:
    // Sees nothing unless it is wary.
    Crowd(const Team& team, bool wary);

    // Whether it was crowded lately.
    bool expected() const { return Clock::now() < until_; }

    // Work of the whole team begins.
    void begin();

    // Whether a member had too little of its core lately, since the beginning at most.
    bool seen();

private:
    using Clock = std::chrono::steady_clock;
    using Span = std::chrono::nanoseconds;

    const Team& team_;
    bool wary_;
    Clock::time_point since_;
    std::vector<Span> busy_;  // of each member, at that time
    Clock::time_point until_;
    Span pause_;
};

}  // namespace stereomend
