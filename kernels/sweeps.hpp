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
    const float* weight = nullptr;  // of the data term, 0 to 1; null for 1 everywhere
    const float* edge = nullptr;    // of the Huber norm, over 0 to 1; null for 1 everywhere
    const float* prior = nullptr;   // [px]; null for none
    const float* trust = nullptr;   // weight of |u - prior| [1]; null exactly if prior is
};

// Half of a symmetric window that sums to 1: taps[0] is the centre. The data term is averaged over it.
constexpr int kMostTaps = 9;
struct Window {
    int radius;  // 0 for none
    float taps[kMostTaps];
};

// The solver's state at one level, each plane row-major (height, width).
struct State {
    float* u;      // disparity [px]
    float* u_bar;  // extrapolated disparity [px]
    float* p_x;    // dual variable [1]
    float* p_y;
    float* a;      // of the linearised data term A u + B: 1 / (1 + 2 lambda tau A), so that no iteration divides
    float* b;      // and 2 lambda tau B
    float* shrink;     // edge / (edge + sigma epsilon)
    float* threshold;  // tau trust / (1 + 2 lambda tau A) [px]
    float* sum_gg;     // of the data term, averaged along rows
    float* sum_gr;
};

struct Rows {
    int begin;
    int end;
};

// Floats that the descriptors of both images, three rows of the left one and of the two parts of the warped one, and
// a row of places take.
constexpr size_t descriptor_floats(int width) {
    return (2 * kNeighbours + 3 * 3 + 1) * (static_cast<size_t>(width) + 2);
}

// Floats of scratch that a member needs: descriptors, and three rows with room for the window.
constexpr size_t scratch_floats(int width) {
    return descriptor_floats(width) + 3 * (static_cast<size_t>(width) + 2 * kMostTaps);
}

// Floats that the descriptors of so many rows of one image take.
constexpr size_t descriptors_of_rows(int width, int rows) {
    return static_cast<size_t>(kNeighbours) * rows * (static_cast<size_t>(width) + 2);
}

// Floats of scratch that a member needs to compare so many rows: descriptors of the left image with three of its rows;
// of the warped right one three rows of both parts, their places, and a row with its ends repeated; a descriptor.
constexpr size_t distance_floats(int width, int rows) {
    return descriptors_of_rows(width, rows + 1) + (3 + 8) * (static_cast<size_t>(width) + 2);
}

// Row loops.
struct Sweeps {
    // Warps the right image by u [in], describes both, writes a and b [out].
    void (*linearise)(const Level&, const State&, const SolverParams&, Rows, float* scratch);
    // The same for a data term that is masked and averaged, in two steps: `gather` writes sum_gg and sum_gr [out];
    // `settle`, when all rows are there, writes a, b and threshold [out] from the rows around its own.
    void (*gather)(const Level&, const State&, const SolverParams&, const Window&, Rows, float* scratch);
    void (*settle)(const Level&, const State&, const SolverParams&, const Window&, Rows);
    // Writes shrink [out] once per level.
    void (*prepare_edges)(const Level&, const State&, const SolverParams&, Rows);
    // Dual step of row y: reads rows y and y + 1 of the extrapolated plane (u in a warp's first iteration, else u_bar)
    // as the iteration before left them; updates p of row y [in/out].
    void (*dual)(const Level&, const State&, const SolverParams&, const float* extrapolated, int y);
    // Primal step of row y: reads p_y of row y - 1 and p of row y as this iteration left them; updates u of row y
    // [in/out] and writes its u_bar [out].
    void (*primal)(const Level&, const State&, const SolverParams&, int y);
    // Writes the signed descriptors of some rows of the left image [out, (rows, 8, width + 2), and room for 3 rows].
    void (*describe)(const Level&, Rows, float* out);
    // Writes for each of these rows the sum of the Euclidean distances, each 0 to 2, to the descriptors of the right
    // image, here (height, width), warped by u (height, width), over the pixels that are `seen` (rows, width) [out, one
    // for each of the rows].
    void (*distance)(const Level&, const float* u, const float* described, const bool* seen, Rows, float* scratch,
                     double* sums);
};

extern const Sweeps sweeps_v2;
extern const Sweeps sweeps_v3;
extern const Sweeps sweeps_generic;

}  // namespace stereomend
