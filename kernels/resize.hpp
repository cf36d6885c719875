// Changes of size on the CPU: from the input to the working size, and back.
#pragma once

#include <vector>

#include "resize_sweeps.hpp"
#include "team.hpp"

namespace stereomend {

// Memory that stays from one call to the next.
struct ResizeBuffers {
    std::vector<float> scratch;
    std::vector<int> places[2];
    std::vector<float> weights[2];
    std::vector<float> shares;
    std::vector<long> counts;
};

// Who works, where and with what.
struct ResizeCrew {
    Team& team;
    ResizeBuffers& buffers;
    const ResizeSweeps& sweeps;
};

// Samples at a size of no larger sides: each pixel the area mean of what it covers [out]. Levels of 16 bits are divided
// by 257.
void shrink(const Samples& from, Size to, const Shrunk& out, const ResizeCrew& crew);

// Both maps at input size, px, at least 0 [out, (height, width)]: blended where they are near, else one of them. A pixel
// of the upload that fits none of the chosen samples around was never judged.
void merge(const Offer& offer, float* out, const ResizeCrew& crew);

// A map at a size of no larger sides: the mean over the valid pixels, times the ratio of the widths; valid where a
// share of `half` is [out].
void shrink_sparse(const Sparse& from, Size to, float half, float* u, bool* valid, const ResizeCrew& crew);

// A map at a size of no larger sides without averaging: of each pixel the one that its centre falls on, times the ratio
// of the widths [out].
void sample_sparse(const Sparse& from, Size to, float* u, bool* valid, const ResizeCrew& crew);

// Where the values of a map at input size come from [out, (height, width)], and how many of each kind there are.
struct Kinds {
    uint8_t* kind;
    long counts[4];
};
void tell(const Origins& origins, const float* u, const LdrSweeps& ldr, Kinds& out, const ResizeCrew& crew);

}  // namespace stereomend
