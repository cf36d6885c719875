// The row loops of the choice between two maps (R8 to R10), and what they are given. Planes are row-major (height,
// width).
#pragma once

#include <stdint.h>

#include "ldr_sweeps.hpp"

namespace stereomend {

// Two maps of the same pair: the upload's samples and what GDR found.
struct Rivals {
    Size size;
    const float* upload;  // disparity [px], 0 where it is not valid
    const float* u;
    const float* for_upload;  // evidence, -1 to 1
    const float* for_u;
    const bool* valid;
    const bool* upload_shown;  // valid, and the right image shows it
    const bool* u_shown;
};

// Who votes, and how.
struct PollRule {
    float tolerance;  // difference at which the maps disagree [px]
    float near;       // difference up to which they say nearly the same [px]
    float lack;       // evidence that the upload lacks where a vote against it counts in full [1]
    float most;       // lead of a pixel's evidence that counts at most, either way [1]
    float least;      // evidence for u from which a pixel votes [1]
    float full;       // and from which it votes in full [1]
    float frame;      // votes have their match farther inside of the right image's left end [px]
};

// No glint; beside what spoils a comparison of evidence.
struct PollMarks {
    const bool* matte;
    const bool* spoilt;
};

constexpr int kCell = 8;   // side of a cell [px]
constexpr int kPolls = 8;  // voted, agreed, fair, lead, level, shown, of u, of its square

constexpr int cells_of(int side) { return side / kCell + (side % kCell > 0); }

// What the choice is made on, besides the maps.
struct Grounds {
    const float* level;  // trust, 0 to 1
    const float* equal;  // where both say nearly the same, the upload is as good: 0 to 1
    const float* usual;  // evidence for u where both agree
    const float* edge;   // weight of the smoothness, over 0 to 1
    const bool* glints;
    const bool* beside;  // of what the upload hides
};

// Lengths in px, the rest without unit; see docs/robust.md.
struct ChoiceRule {
    float near;
    float enough;
    float full_trust;
    float high_trust;
    float win_margin;
    float trusted_margin;
    float weak_share;
    float spike;
    float rough_share;
    float step;
    float soft_edge;
    int largest_patch;  // [px]
};

// What is known on the way to a choice, (height, width).
struct Choice {
    uint8_t* uneven;  // how many of the 15 pixels around in the row are spikes or holes
    bool* even;       // a slope goes on as it came
    bool* smeared;    // u leads over a jump of the upload
    bool* soft;
    bool* passing;
    bool* reached;
    bool* kept;  // valid and not contradicted; in the end, of no small patch
    bool* along;  // bridges along rows
    bool* across;  // and along columns
    float* share;  // of the upload; below 0 where it is to be reached
};

// The right half of a symmetric window over cells, its middle included.
struct Taps {
    int radius;
    const double* weight;  // radius + 1
};

// Doubles of scratch that it takes to blur.
constexpr size_t blur_doubles(Size cells, const Taps& taps) {
    return static_cast<size_t>(cells.width) * (cells.height + 1) + 2 * static_cast<size_t>(taps.radius);
}

// What is known of the plane around each cell.
struct PlaneFit {
    const double* value;     // of the plane at the cell [px]
    const double* residual;  // mean square of what it leaves [px^2]
    const double* support;   // weight of what it was fitted to, 0 to 1
};

// How far a map is bent towards a plane beyond the right image's frame.
struct BendRule {
    double window;  // of the fit [px]
    float bend;     // at most this share of the disparity [1]
    float flat;     // a residual from which half of it is left [px]
};

// Floats of scratch that it takes to bring `planes` rows of cells to pixels.
constexpr size_t widened_floats(int width, int planes) {
    return planes * (static_cast<size_t>(width) + 3 * kCell) + 2 * (static_cast<size_t>(width) / kCell + 2);
}

// A row, or a part of it.
struct Stretch {
    int y;
    Rows columns;
};

struct FusionSweeps {
    // Writes row `row` of the cells' means [out, kPolls planes of `plane` cells each]; scratch: kPolls * width.
    void (*poll)(const Rivals&, const PollMarks&, const PollRule&, int row, float* scratch, long plane, double* out);
    // Writes row y of `uneven`, `even` and `smeared`; scratch: 2 * (width + 8).
    void (*look)(const Rivals&, const ChoiceRule&, int y, float* scratch, const Choice&);
    // Writes row y of `soft`, `passing`, `reached` (its seeds), `kept` and `share`; scratch: 4 * (width + 4).
    void (*settle)(const Rivals&, const Grounds&, const ChoiceRule&, int y, float* scratch, const Choice&);
    // Leaves passing in row y only what neither map shows.
    void (*narrow)(const Rivals&, int y, const Choice&);
    // Leaves in row y of `kept` and `reached` no small patches.
    void (*sift)(const Rivals&, int y, const bool* small, const Choice&);
    // Sets bridges [out] that begin in a stretch and follow a row (`step` 1) or a column (`step` width): pixels that
    // are passing and lead from one reached pixel to another only up or only down. Scratch: width.
    void (*bridge)(const Terrain&, const Stretch&, int step, const bool* reached, uint8_t* scratch, bool* out);
    // Completes row y of the share [in/out]: what is reached or a bridge, without small patches.
    void (*conclude)(const Rivals&, int y, const Choice&);
    // Averages the first columns of cells under a window [out]; borders are mirrored.
    void (*blur)(const double* plane, Size cells, int columns, const Taps&, double* scratch, double* out);
    // Writes row y of the pixels of a picture, linear between the centres of its cells.
    void (*widen)(const double* plane, Size cells, int y, int width, float* scratch, float* out);
    // Writes row y of a map bent towards the planes where its match lies left of the right image, px: never right of so
    // many columns.
    void (*bend)(const float* u, Size size, int columns, const PlaneFit&, const BendRule&, int y, float* scratch,
                 float* out);
};

extern const FusionSweeps fusion_sweeps_v2;
extern const FusionSweeps fusion_sweeps_v3;
extern const FusionSweeps fusion_sweeps_generic;

}  // namespace stereomend
