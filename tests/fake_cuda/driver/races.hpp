// Two accesses to a word, one of them a write, by threads that nothing orders: a race.
//
// Time is counted in stamps: one per launch, per block and per barrier of a block. Blocks run one after the other, so
// what was touched since the launch but before this block was touched by another block.
#pragma once

#include "memory.hpp"

namespace fake {

enum class Race { none, within_block, between_blocks };

// Bits of Record::who. Accesses to parts of words by several threads lose their bytes: they are never reported.
constexpr uint32_t kThreadBits = 0x3ff;
constexpr int kWarpEpochShift = 10;
constexpr uint32_t kWarpEpochBits = 0xfff;
constexpr int kBytesShift = 22;
constexpr uint32_t kManyThreads = 1u << 26;
constexpr uint32_t kManyWarps = 1u << 27;
constexpr uint32_t kStrong = 1u << 28;
constexpr uint32_t kOtherBlock = 1u << 29;

// Who makes an access, and since when what others did is ordered before it.
struct Visitor {
    uint32_t launch;  // the launch's first stamp; of shared memory the block's
    uint32_t block;   // the block's first stamp
    uint32_t now;     // since the last barrier
    uint32_t thread;
    uint32_t warp_epoch;  // bar.warp.sync passed
    bool strong;          // volatile or atomic
    bool synchronised;    // the block waited for others through an atomic
};

inline uint32_t bytes_of(uint32_t who) { return who >> kBytesShift & 0xf; }

inline uint32_t signature(const Visitor& v, uint32_t bytes) {
    return v.thread | (v.warp_epoch & kWarpEpochBits) << kWarpEpochShift | bytes << kBytesShift |
           (v.strong ? kStrong : 0);
}

inline bool harmless(uint32_t who, const Visitor& v, uint32_t bytes) {
    return !(bytes_of(who) & bytes) || (v.strong && (who & kStrong));
}

// Whether an access of the same interval between barriers is by a thread that nothing orders before this one.
inline bool unordered(uint32_t who, const Visitor& v, uint32_t bytes) {
    if (harmless(who, v, bytes)) return false;
    if (who & kManyWarps) return true;
    if ((who & kThreadBits) / 32 != v.thread / 32) return true;
    if ((who >> kWarpEpochShift & kWarpEpochBits) != (v.warp_epoch & kWarpEpochBits)) return false;
    return (who & kManyThreads) || (who & kThreadBits) != v.thread;
}

inline Race conflict(Record record, const Visitor& v, uint32_t bytes) {
    if (record.stamp < v.launch) return Race::none;
    const bool other_block = record.stamp < v.block || (record.who & kOtherBlock);
    if (other_block && !v.synchronised && !harmless(record.who, v, bytes)) return Race::between_blocks;
    if (record.stamp == v.now && unordered(record.who, v, bytes)) return Race::within_block;
    return Race::none;
}

// The record of this access and of those of the same interval before it.
inline uint32_t merged(uint32_t who, uint32_t mine, const Visitor& v, uint32_t bytes) {
    if (((who ^ mine) & (kThreadBits | kWarpEpochBits << kWarpEpochShift)) == 0)
        return ((who | bytes << kBytesShift) & ~kStrong) | (who & mine & kStrong);
    const bool same_warp = (who & kThreadBits) / 32 == v.thread / 32;
    const bool ordered = same_warp && ((who ^ mine) >> kWarpEpochShift & kWarpEpochBits) && !(who & kManyWarps);
    if (ordered) return mine | (who & kOtherBlock);
    uint32_t both = (mine & ~kStrong) | (who & mine & kStrong) | (who & (kOtherBlock | kManyWarps)) | kManyThreads;
    if (!same_warp) both |= kManyWarps;
    if (bytes_of(who) != bytes) both &= ~(0xfu << kBytesShift);
    return both;
}

inline Race note_read(Region& region, uint64_t word, const Visitor& v, uint32_t bytes) {
    const Race race = conflict(region.writers[word], v, bytes);
    if (race != Race::none) return race;
    Record& last = region.readers[word];
    const uint32_t mine = signature(v, bytes);
    if (last.stamp < v.launch) {
        last = {v.now, mine};
    } else if (last.stamp < v.block) {
        last = {v.now, mine | (bytes_of(last.who) & bytes ? kOtherBlock : 0)};
    } else if (last.stamp < v.now) {
        last = {v.now, mine | (last.who & kOtherBlock)};
    } else if (last.who != mine) {
        last.who = merged(last.who, mine, v, bytes);
    }
    return Race::none;
}

// `changes`: two threads that write the same value do no harm.
inline Race note_write(Region& region, uint64_t word, const Visitor& v, uint32_t bytes, bool changes) {
    Record& last = region.writers[word];
    Race race = changes ? conflict(last, v, bytes) : Race::none;
    if (race == Race::none) race = conflict(region.readers[word], v, bytes);
    if (race != Race::none) return race;
    const uint32_t mine = signature(v, bytes);
    last.who = last.stamp == v.now ? merged(last.who, mine, v, bytes) : mine;
    last.stamp = v.now;
    return Race::none;
}

}  // namespace fake
