// Flags as numbers and as bits, for row loops.
//
// For files that are compiled once per instruction set: everything is local to them.
#pragma once

#include <stdint.h>
#include <string.h>

namespace stereomend {
namespace {

// As numbers, for comparisons of bools are not vectorised.
inline const uint8_t* bytes_of(const bool* flags) { return reinterpret_cast<const uint8_t*>(flags); }
inline uint8_t* bytes_of(bool* flags) { return reinterpret_cast<uint8_t*>(flags); }

// 64 bytes of 0 or 1 as bits, the first the lowest.
inline uint64_t packed(const uint8_t* flags) {
    uint64_t word = 0;
    for (int i = 0; i < 8; ++i) {
        uint64_t eight;
        memcpy(&eight, flags + 8 * i, sizeof eight);
        // Each byte's bit to its place in the highest byte.
        word |= (eight * 0x0102040810204080u >> 56) << (8 * i);
    }
    return word;
}

// And back.
inline void unpack(uint64_t word, uint8_t* flags) {
    for (int i = 0; i < 8; ++i) {
        // One bit is left in each byte, and what is not 0 carries into the highest.
        const uint64_t bits = (word >> (8 * i) & 0xff) * 0x0101010101010101u & 0x8040201008040201u;
        const uint64_t eight = (bits + 0x7f7f7f7f7f7f7f7fu) >> 7 & 0x0101010101010101u;
        memcpy(flags + 8 * i, &eight, sizeof eight);
    }
}

}  // namespace
}  // namespace stereomend
