// What the sweeps are given, and the table through which the solver calls the ones for this machine.
#pragma once

#include <stddef.h>

#include "pixel.cuh"

namespace stereomend {

// One level: images of grey levels, row-major (height, width), not changed.
struct Level {
    int width;
    int height;
    const float* left;
    const float* right;   // (height, width + 2): each row with its ends repeated
    const float* weight;  // of the data term, 0 to 1; null for 1 everywhere
};

// The solver's state at one level, each plane row-major (height, width).
struct State {
    float* u;      // disparity [px]
    float* u_bar;  // extrapolated disparity [px]
    float* p_x;    // dual variable [1]
    float* p_y;
    float* a;      // of the linearised data term A u + B: 1 / (1 + 2 lambda tau A), so that no iteration divides
    float* b;      // and 2 lambda tau B
};

struct Rows {
    int begin;
    int end;
};

// Floats of scratch that `linearise` and `distance` need: the descriptors of both images, three rows of the left one
// and of the two parts of the warped one, and a row of places.
constexpr size_t scratch_floats(int width) {
    return (2 * kNeighbours + 3 * 3 + 1) * (static_cast<size_t>(width) + 2);
}

// Row loops.
struct Sweeps {
    // Warps the right image by u [in], describes both, writes a and b [out].
    void (*linearise)(const Level&, const State&, const SolverParams&, Rows, float* scratch);
    // Dual step of row y: reads rows y and y + 1 of the extrapolated plane (u in a warp's first iteration, else u_bar)
    // as the iteration before left them; updates p of row y [in/out].
    void (*dual)(const Level&, const State&, const SolverParams&, const float* extrapolated, int y);
    // Primal step of row y: reads p_y of row y - 1 and p of row y as this iteration left them; updates u of row y
    // [in/out] and writes its u_bar [out].
    void (*primal)(const Level&, const State&, const SolverParams&, int y);
    // Writes for each of the rows the sum of the Euclidean distances of the signed descriptors, each 0 to 2, over the
    // pixels that are `seen` (height, width) [out, (height)].
    void (*distance)(const Level&, const float* u, const bool* seen, Rows, float* scratch, double* sums);
};

extern const Sweeps sweeps_v2;
extern const Sweeps sweeps_v3;
extern const Sweeps sweeps_generic;

}  // namespace stereomend
