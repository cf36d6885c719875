// The row loops of evidence, patches and edges (R1, R4), and what they are given. Planes are row-major (height, width).
#pragma once

#include <stdint.h>

#include "ldr_sweeps.hpp"

namespace stereomend {

constexpr int kMostMaps = 2;  // that one sweep looks at

// Grey levels, 0 to 255.
struct Pair {
    Size size;
    const float* left;
    const float* right;
};

// Disparities [px] of one left image, and where the evidence for each goes, (height, width).
struct Maps {
    int count;
    const float* u[kMostMaps];
    float* found[kMostMaps];
};

struct TrustParams {
    float least;     // evidence up to here counts for nothing [1]
    float full;      // and from here on in full [1]
    float smallest;  // disparities up to this say nothing [px]
};

// Valid pixels whose disparity changes by at most `step` [px] to the pixel on their left and above, or of which either
// is soft; null: none is.
struct Steps {
    Size size;
    const float* u;
    const bool* valid;
    float step;
    const bool* soft;
};

// A run of a patch in one row, as part of a forest: its parent, and of a root the number of pixels below it and the
// sides of the picture that these touch, one bit each.
struct Run {
    int parent;
    int pixels;
    int sides;
};

// Patches of a map. A row of flags takes words_of(width) words, with 0 after its end; the runs of row y begin at
// y * width.
struct Patches {
    uint64_t* valid;
    uint64_t* left;   // joined to the pixel on the left
    uint64_t* above;  // joined to the one above
    Run* runs;
};

constexpr size_t words_of(int width) { return static_cast<size_t>(width) / 64 + 1; }

// When another map replaces the one at hand: where its evidence is larger by `margin` and over `least` [1], and the two
// differ by over `apart` [px].
struct ReuseRule {
    float margin;
    float least;
    float apart;
};

// Half of a side, rounded up [px].
constexpr int half_of(int side) { return side / 2 + side % 2; }

struct EdgeParams {
    float level;  // gradient at which the weight is 1 / e [grey levels]
    float power;  // of the gradient [1]
    float floor;  // least weight [1]
};

// One to three planes of levels, 0 to 255.
struct Channels {
    Size size;
    int count;
    const float* levels[3];
};

// Floats of scratch that a member needs: the rows around one of both images, of their similarity and of its sums.
constexpr size_t evidence_floats(int width) {
    return (5 + kMostMaps * (6 + 1 + 5)) * (static_cast<size_t>(width) + 4);
}

// What is bright and colourless: its largest level is over `bright`, and exceeds its smallest by less than `saturation`
// times itself. What is nearly as bright is over `nearly` [grey levels].
struct GlintRule {
    float saturation;
    float bright;
    float nearly;
};

struct EvidenceSweeps {
    // Writes n of each map for the rows: the 5 x 5 mean of the inner product of the signed descriptors, borders
    // mirrored, -1 to 1.
    void (*evidence)(const Pair&, const Maps&, Rows, float* scratch);
    // Makes row y of n [in/out] the confidence c: by the ramp, the distance from the median, and 0 where the pixel is
    // hidden, or not both valid and matte. Scratch as above.
    void (*trust)(const ConfidenceInput&, const TrustParams&, int y, const bool* hidden, float* scratch, float* row);
    // Writes flags and runs of the rows, and joins runs above each other inside of them. Scratch: 64 words_of(width).
    void (*label)(const Steps&, const Patches&, Rows, uint8_t* scratch);
    // Joins the runs of row y with those of row y - 1.
    void (*join)(const Patches&, int width, int y);
    // Flags also those pixels of row y that belong to patches of at most so many pixels [in/out].
    void (*flag_small)(const Patches&, int width, int y, int largest, bool* flags);
    // Writes row y of the weights of the smoothness.
    void (*edge_row)(const Channels&, const EdgeParams&, int y, float* out);
    // Writes row y of what is bright and colourless, and of what is nearly as bright.
    void (*glint_row)(const Channels&, const GlintRule&, int y, bool* glints, bool* nearly);
    // Writes a row of u or of the other map [out], which may not be taken where it is hidden; n: evidence for u.
    void (*better_row)(const float* u, const float* n, const float* other, const float* other_n, const bool* hidden,
                       int width, const ReuseRule&, float* out);
    // Writes row y of a plane at half of its size, the area mean; scratch: width + 2.
    void (*halve_row)(const float* plane, Size from, int y, float* scratch, float* out);
    // The same of disparities, in pixels of the smaller plane, averaged with a weight; and of the weight.
    void (*halve_weighed_row)(const float* u, const float* weight, Size from, int y, float* scratch, float* out,
                              float* out_weight);
};

extern const EvidenceSweeps evidence_sweeps_v2;
extern const EvidenceSweeps evidence_sweeps_v3;
extern const EvidenceSweeps evidence_sweeps_generic;

}  // namespace stereomend
