// Connected patches as a forest of row runs: flags as bits, so that long runs cost next to nothing.
//
// For evidence_cpu.cpp alone, which is compiled once per instruction set: everything is local to it.
#pragma once

#include <string.h>

#include "evidence_sweeps.hpp"
#include "flags.hpp"

namespace stereomend {
namespace {

int lowest(uint64_t word) { return __builtin_ctzll(word); }
int ones(uint64_t word) { return __builtin_popcountll(word); }

// Bits from `width` bytes of 0 or 1, of which 64 words_of(width) can be written.
void pack(uint8_t* flags, int width, uint64_t* words) {
    const size_t count = words_of(width);
    memset(flags + width, 0, 64 * count - width);
    for (size_t w = 0; w < count; ++w) words[w] = packed(flags + 64 * w);
}

// Pixels of a row that the map joins with those `back` pixels before, `width` of them from i on.
void flag_joined(const Steps& in, size_t i, size_t back, int width, uint8_t* out) {
    const float *u = in.u + i, *other = u - back;
    const uint8_t *valid = bytes_of(in.valid) + i, *other_valid = valid - back;
    const float step = in.step;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x)
        out[x] = static_cast<uint8_t>((fabsf(u[x] - other[x]) <= step ? 1 : 0) & valid[x] & other_valid[x]);
    if (in.soft == nullptr) return;
    const uint8_t *soft = bytes_of(in.soft) + i, *other_soft = soft - back;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) out[x] |= (soft[x] | other_soft[x]) & valid[x] & other_valid[x];
}

void flag_row(const Steps& in, const Patches& patches, int y, uint8_t* scratch) {
    const int width = in.size.width;
    const size_t words = words_of(width) * y;
    const size_t o = static_cast<size_t>(y) * width;
    memcpy(scratch, bytes_of(in.valid) + o, width);
    pack(scratch, width, patches.valid + words);
    scratch[0] = 0;
    flag_joined(in, o + 1, 1, width - 1, scratch + 1);
    pack(scratch, width, patches.left + words);
    if (y == 0) return;
    flag_joined(in, o, width, width, scratch);
    pack(scratch, width, patches.above + words);
}

// Calls with the number, first column and the one after the last of each run of a row.
template <class Function>
void each_run(const Patches& patches, int width, int y, Function function) {
    const size_t count = words_of(width);
    const uint64_t* valid = patches.valid + count * y;
    const uint64_t* left = patches.left + count * y;
    int number = 0;
    int begin = -1;
    for (size_t w = 0; w < count; ++w) {
        const uint64_t after = w + 1 < count ? left[w + 1] : 0;
        uint64_t starts = valid[w] & ~left[w];
        uint64_t ends = valid[w] & ~(left[w] >> 1 | after << 63);
        const int column = static_cast<int>(64 * w);
        while (begin >= 0 || starts) {
            if (begin < 0) {
                begin = column + lowest(starts);
                starts &= starts - 1;
            }
            if (!ends) break;
            function(number++, begin, column + lowest(ends) + 1);
            ends &= ends - 1;
            begin = -1;
        }
    }
}

int root_of(const Run* runs, int i) {
    while (runs[i].parent != i) i = runs[i].parent;
    return i;
}

// The same, and the way there is shorter the next time.
int shortened_root_of(Run* runs, int i) {
    while (runs[i].parent != i) i = runs[i].parent = runs[runs[i].parent].parent;
    return i;
}

// The upper left run becomes the root, so that the outcome does not depend on the order.
void unite(Run* runs, int a, int b) {
    a = shortened_root_of(runs, a);
    b = shortened_root_of(runs, b);
    if (a == b) return;
    const int root = a < b ? a : b;
    const int other = a < b ? b : a;
    runs[other].parent = root;
    runs[root].pixels += runs[other].pixels;
    runs[root].sides |= runs[other].sides;
}

// Counts the starts of runs of a row.
struct Counter {
    const uint64_t* valid;
    const uint64_t* left;
    int before;  // run in front of the word at hand

    int run_at(size_t w, uint64_t upto) const { return before + ones(valid[w] & ~left[w] & upto); }
    void pass(size_t w) { before += ones(valid[w] & ~left[w]); }
};

Counter counter_of(const Patches& patches, int width, int y) {
    const size_t o = words_of(width) * y;
    return {patches.valid + o, patches.left + o, y * width - 1};
}

void join(const Patches& patches, int width, int y) {
    const uint64_t* above = patches.above + words_of(width) * y;
    Counter upper = counter_of(patches, width, y - 1);
    Counter lower = counter_of(patches, width, y);
    uint64_t carried = 0;
    for (size_t w = 0; w < words_of(width); ++w) {
        // Where the pixel on the left has joined the same two runs, nothing is new.
        uint64_t fresh = above[w] & ~((above[w] << 1 | carried) & upper.left[w] & lower.left[w]);
        carried = above[w] >> 63;
        for (; fresh; fresh &= fresh - 1) {
            const uint64_t upto = fresh ^ (fresh - 1);
            unite(patches.runs, upper.run_at(w, upto), lower.run_at(w, upto));
        }
        upper.pass(w);
        lower.pass(w);
    }
}

void label(const Steps& in, const Patches& patches, Rows rows, uint8_t* scratch) {
    const int width = in.size.width;
    for (int y = rows.begin; y < rows.end; ++y) {
        flag_row(in, patches, y, scratch);
        const int sides = (y == 0 ? 1 : 0) | (y == in.size.height - 1 ? 2 : 0);
        each_run(patches, width, y, [&](int number, int begin, int end) {
            const int run = y * width + number;
            patches.runs[run] = {run, end - begin, sides | (begin == 0 ? 4 : 0) | (end == width ? 8 : 0)};
        });
        if (y > rows.begin) join(patches, width, y);
    }
}

// Pixels of a patch; what the frame cuts off counts as if the picture were mirrored there.
long pixels_of_patch(const Run& root) { return static_cast<long>(root.pixels) << ones(root.sides); }

void flag_small(const Patches& patches, int width, int y, int largest, bool* flags) {
    each_run(patches, width, y, [&](int number, int begin, int end) {
        const int root = root_of(patches.runs, y * width + number);
        if (pixels_of_patch(patches.runs[root]) <= largest) memset(flags + begin, 1, end - begin);
    });
}

}  // namespace
}  // namespace stereomend
