// The mathematics of one pixel: no layout, no threads. Shared by the CPU sweeps and the GPU kernels.
//
// Symbols are those of Yang, Simon, Linte, J. Med. Imaging 10(4), 045001, 2023; disparities are in
// pixels of the level, grey levels run from 0 to 255. x_right = x_left - u.
#pragma once

#include <math.h>

#ifdef __CUDACC__
#define PIXEL_FN static __host__ __device__ __forceinline__
#else
#define PIXEL_FN static inline __attribute__((always_inline))
#endif

namespace stereomend {

constexpr int kNeighbours = 8;

// Descriptors of less contrast are 0 [grey levels]: below, float32 and float64 part ways.
constexpr float kMinNorm = 1e-3f;

// Beyond this a disparity is outside of every image, and its conversion to int is still safe.
constexpr float kFarAway = 1e6f;

struct SolverParams {
    float data_weight;    // lambda [1]
    float huber_epsilon;  // epsilon [px/px]
    float tau;            // primal step [1]
    float sigma;          // dual step [1]
    int warps;            // linearisations
    int iterations;       // primal-dual iterations per warp
    bool absolute;        // descriptors of absolute differences (Eq. 10 as printed)
};

// Unlike fmaxf and fminf these need no library call for NaN, which never comes here.
PIXEL_FN float larger(float a, float b) { return a > b ? a : b; }
PIXEL_FN float smaller(float a, float b) { return a < b ? a : b; }

PIXEL_FN int clamp_index(int i, int size) { return i < 0 ? 0 : (i >= size ? size - 1 : i); }

// The value of a row at x - u, linear in between, borders repeated.
// u is split into whole and fraction first: x - u itself would lose digits of u.
PIXEL_FN float sample_row(const float* row, int width, int x, float u) {
    const float safe = smaller(larger(u, -kFarAway), kFarAway);
    const float whole = floorf(safe);
    const float fraction = safe - whole;
    const int at = x - static_cast<int>(whole);
    const float here = row[clamp_index(at, width)];
    const float before = row[clamp_index(at - 1, width)];
    return here + fraction * (before - here);
}

// Differences to the 3 x 3 neighbours, not yet normalised (Eq. 10).
// above, centre, below: three neighbouring rows; x - 1 and x + 1 must be readable.
PIXEL_FN void differences(const float* above, const float* centre, const float* below, int x, float v[kNeighbours]) {
    const float c = centre[x];
    v[0] = above[x - 1] - c;
    v[1] = above[x] - c;
    v[2] = above[x + 1] - c;
    v[3] = centre[x - 1] - c;
    v[4] = centre[x + 1] - c;
    v[5] = below[x - 1] - c;
    v[6] = below[x] - c;
    v[7] = below[x + 1] - c;
}

// 1 / |v|, or 0 where the contrast is too small to have a direction.
PIXEL_FN float inverse_norm(const float v[kNeighbours]) {
    float square = 0.0f;
    for (int k = 0; k < kNeighbours; ++k) square += v[k] * v[k];
    const float norm = sqrtf(square);
    return norm > kMinNorm ? 1.0f / norm : 0.0f;
}

// p <- proj_1((p + sigma grad u_bar) / (1 + sigma epsilon)); shrink is 1 / (1 + sigma epsilon).
PIXEL_FN void dual_step(float gradient_x, float gradient_y, float sigma, float shrink, float* p_x, float* p_y) {
    const float x = (*p_x + sigma * gradient_x) * shrink;
    const float y = (*p_y + sigma * gradient_y) * shrink;
    const float scale = 1.0f / sqrtf(larger(1.0f, x * x + y * y));
    *p_x = x * scale;
    *p_y = y * scale;
}

// u <- (u + tau div p - 2 lambda tau B) / (1 + 2 lambda tau A); weight is 2 lambda tau.
PIXEL_FN float primal_step(float u, float divergence, float a, float b, float tau, float weight) {
    return (u + tau * divergence - weight * b) / (1.0f + weight * a);
}

}  // namespace stereomend
