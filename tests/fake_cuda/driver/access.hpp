// Every access of a thread to memory goes through here: bounds, alignment, what was never written, races, counters.
#pragma once

#include "interpreter.hpp"
#include "syntax.hpp"

namespace fake {

struct Access {
    uint64_t address = 0;
    uint32_t bytes = 0;
    Space space = Space::generic;  // never generic once resolved
};

// What a load or store of a lane touches.
Access access_of(Warp& w, const Instruction& i, int lane);

// Where the bytes are. A write tells what it will write, so that writing the same value twice is no race.
uint8_t* reach_read(Warp& w, const Instruction& i, int lane, const Access& access);
uint8_t* reach_write(Warp& w, const Instruction& i, int lane, const Access& access, const uint8_t* value);

// Decodes `[base+offset]` into r[4], width[1] and offset, and settles the space.
void take_address(Decoder& d, const Operand& operand);

// Modifiers that say how much others see of an access, and hints about caches.
void take_strength(Decoder& d);

}  // namespace fake
