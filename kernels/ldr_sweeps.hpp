// The row loops of LDR, and what they are given. All planes are row-major (height, width).
#pragma once

#include "pixel.cuh"
#include "sweeps.hpp"

namespace stereomend {

struct Size {
    int width;
    int height;
};

struct ConfidenceParams {
    int window;                // side of the window of the local mean, odd [px]
    float smoothness_weight;   // alpha_s [1]
    int smoothness_power;      // exponent of C_s, 1 to 4 [1]
    float photometric_weight;  // alpha_p [1]
};

struct ConfidenceInput {
    Size size;
    const float* left;   // grey levels, 0 to 255
    const float* right;
    const float* u;      // disparity [px]
    const bool* valid;   // u is known
    const bool* matte;   // no specular highlight
};

// Sums over the window along each row and the number of their values, (height, width); scratch: 4 rows of width + 2.
struct WindowSums {
    float* sums;
    float* counts;
    float* scratch;
};

// Stands for "nothing known": in a hole of a map, and where a search met nothing.
constexpr float kNone = __builtin_inff();

constexpr int kWays = 3;  // straight and along both diagonals

// What a search across rows has met when it gets to a row, way by way, and after how many steps; `values` have kNone on
// both sides.
struct Front {
    float* values[kWays];
    float* steps[kWays];
};

// When a run of unknown pixels is an occlusion: the value on its right exceeds the one on its left by more than `step`
// [px], and it is no longer than `stretch` [1] times that difference plus `slack` [px].
struct OcclusionRule {
    float step;
    float stretch;
    float slack;
};

// A map that can be walked on: from a pixel to the next if that is passing, and the disparity [px] changes by at most
// `step`, or either of the two is soft.
struct Terrain {
    Size size;
    const float* u;
    const bool* passing;
    const bool* soft;
    float step;
};

struct LdrSweeps {
    // Which pixels of a row of disparities [px] the right image does not show: their match lies outside of it, or a
    // pixel further right lands at least 1 px left of it [out].
    void (*unobserved_row)(const float* u, int width, bool* out);
    // Which pixels of a row of disparities the right image shows, of those that are valid; and which of them it does not,
    // or on half as many pixels [out].
    void (*shown_row)(const float* u, const bool* valid, int width, bool* shown, bool* hidden);
    // Writes row y of the sums and counts [out].
    void (*sum_along)(const ConfidenceInput&, int radius, int y, const WindowSums&);
    // Writes row y of C_f [out] from the sums of the rows around it.
    void (*confidence_row)(const ConfidenceInput&, const ConfidenceParams&, int y, const WindowSums&, float* out);
    // What is met in the pixels of a row [out] from what was met in the row before; w: the map's row.
    void (*look)(const float* w, const Front& before, float limit, int width, const Front& now);
    // What is met by the holes of a row to their right (east) and left (west) [out; elsewhere nothing is written].
    void (*look_along)(const float* w, int limit, int width, float* east, float* west);
    // Whether a row has any.
    bool (*has_hole)(const float* w, int begin, int end);
    // Replaces holes of w by the median of what was met in eight directions; returns whether any hole remains.
    bool (*fill_row)(const float* const met[8], int width, float* w);
    // Replaces the occlusions of a row of u [in/out] by the value on their left; says which pixels those are [out].
    void (*fill_occlusions)(float* u, const bool* known, int width, const OcclusionRule&, bool* filled);
    // Spreads what is reached [in/out] along row y, to the right and then to the left.
    void (*reach_along)(const Terrain&, int y, bool* reached);
    // Spreads it from row y - 1 or y + 1 (`from`) into row y, for the columns of [begin, end).
    void (*reach_across)(const Terrain&, int from, int y, Rows columns, bool* reached);
};

extern const LdrSweeps ldr_sweeps_v2;
extern const LdrSweeps ldr_sweeps_v3;
extern const LdrSweeps ldr_sweeps_generic;

}  // namespace stereomend
