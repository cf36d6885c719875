// The mathematics of one pixel: no layout, no threads. Shared by the CPU sweeps and the GPU kernels.
//
// Symbols are those of Yang, Simon, Linte, J. Med. Imaging 10(4), 045001, 2023; disparities are in
// pixels of the level, grey levels run from 0 to 255. x_right = x_left - u.
#pragma once

#ifndef __CUDACC_RTC__  // which has its own
#include <math.h>
#endif

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
    bool observed_only;   // no data term where the right image does not show the pixel
    float averaging;      // standard deviation of the window of the data term, 0 for none [px]
};

// Unlike fmaxf and fminf these need no library call for NaN, which never comes here.
PIXEL_FN float larger(float a, float b) { return a > b ? a : b; }
PIXEL_FN float smaller(float a, float b) { return a < b ? a : b; }

// 1 / sqrt(x) of x over 0.
PIXEL_FN float inverse_root(float x) {
#ifdef __CUDA_ARCH__
    return rsqrtf(x);  // one instruction, off by two units in the last place at most
#else
    return 1.0f / sqrtf(x);
#endif
}

// A grey level as the sum of a pixel's own level and a rest. The sum itself would round away the rest's last
// digits, and with them the contrast of smooth tissue; differences of both parts keep them.
struct Grey {
    float base;
    float rest;
};

// Where x - u lies in a row: `at` of 0 to width, and how far left of pixel `at`. Beyond the row the border repeats,
// so between -1 and 0 as between width - 1 and width both neighbours are the border pixel.
struct Place {
    int at;
    float fraction;
};

// u is split into whole and fraction first: x - u itself would lose digits of u.
PIXEL_FN Place place_of(int width, int x, float u) {
    const float safe = smaller(larger(u, -kFarAway), kFarAway);
    const float whole = floorf(safe);
    const int at = x - static_cast<int>(whole);
    return {at < 0 ? 0 : (at > width ? width : at), safe - whole};
}

// Linear between a pixel and the one before it.
PIXEL_FN Grey interpolate(float here, float before, float fraction) { return {here, fraction * (before - here)}; }

// The value of a row at x - u, borders repeated.
PIXEL_FN float sample_row(const float* row, int width, int x, float u) {
    const Place place = place_of(width, x, u);
    const float here = row[place.at < width ? place.at : width - 1];
    const float before = row[place.at > 0 ? place.at - 1 : 0];
    const Grey grey = interpolate(here, before, place.fraction);
    return grey.base + grey.rest;
}

// Pointers to a row of grey levels; x - 1 and x + 1 must be readable.
struct GreyRow {
    const float* base;
    const float* rest;
};

PIXEL_FN float difference(GreyRow a, int x_a, GreyRow b, int x_b) {
    return (a.base[x_a] - b.base[x_b]) + (a.rest[x_a] - b.rest[x_b]);
}

// The left image is not interpolated: its grey levels have no rest.
PIXEL_FN float difference(const float* a, int x_a, const float* b, int x_b) { return a[x_a] - b[x_b]; }

// Differences to the 3 x 3 neighbours in three neighbouring rows, not yet normalised (Eq. 10).
template <class Row>
PIXEL_FN void differences(Row above, Row centre, Row below, int x, float v[kNeighbours]) {
    v[0] = difference(above, x - 1, centre, x);
    v[1] = difference(above, x, centre, x);
    v[2] = difference(above, x + 1, centre, x);
    v[3] = difference(centre, x - 1, centre, x);
    v[4] = difference(centre, x + 1, centre, x);
    v[5] = difference(below, x - 1, centre, x);
    v[6] = difference(below, x, centre, x);
    v[7] = difference(below, x + 1, centre, x);
}

// 1 / |v|, or 0 where the contrast is too small to have a direction.
PIXEL_FN float inverse_norm(const float v[kNeighbours]) {
    float square = 0.0f;
    for (int k = 0; k < kNeighbours; ++k) square += v[k] * v[k];
    const float norm = sqrtf(square);
    return norm > kMinNorm ? 1.0f / norm : 0.0f;
}

PIXEL_FN float product(const float a[kNeighbours], const float b[kNeighbours]) {
    float sum = 0.0f;
    for (int k = 0; k < kNeighbours; ++k) sum += a[k] * b[k];
    return sum;
}

// The inner product of two descriptors (R1), of their differences, -1 to 1; 0 where either has no direction.
PIXEL_FN float similarity_of(const float v[kNeighbours], const float w[kNeighbours]) {
    constexpr float kMinSquare = kMinNorm * kMinNorm;
    const float a = product(v, v);
    const float b = product(w, w);
    const float value = product(v, w) / sqrtf(larger(a, kMinSquare) * larger(b, kMinSquare));
    return smaller(a, b) > kMinSquare ? value : 0.0f;
}

// p <- proj_1((p + sigma grad u_bar) / (1 + sigma epsilon)); shrink is 1 / (1 + sigma epsilon).
PIXEL_FN void dual_step(float gradient_x, float gradient_y, float sigma, float shrink, float* p_x, float* p_y) {
    const float x = (*p_x + sigma * gradient_x) * shrink;
    const float y = (*p_y + sigma * gradient_y) * shrink;
    const float scale = inverse_root(larger(1.0f, x * x + y * y));
    *p_x = x * scale;
    *p_y = y * scale;
}

// The same with the unit ball replaced by one of radius `edge`; shrink is edge / (edge + sigma epsilon).
PIXEL_FN void weighted_dual_step(float gradient_x, float gradient_y, float sigma, float shrink, float edge, float* p_x,
                                 float* p_y) {
    const float x = (*p_x + sigma * gradient_x) * shrink;
    const float y = (*p_y + sigma * gradient_y) * shrink;
    const float scale = edge / sqrtf(larger(edge * edge, x * x + y * y));
    *p_x = x * scale;
    *p_y = y * scale;
}

// The prox of threshold |u - prior| after the step of the data term.
PIXEL_FN float towards(float u, float prior, float threshold) {
    const float away = u - prior;
    return prior + (larger(away - threshold, 0.0f) + smaller(away + threshold, 0.0f));
}

// u <- (u + tau div p - 2 lambda tau B) / (1 + 2 lambda tau A), with
// inverse = 1 / (1 + 2 lambda tau A) and shift = 2 lambda tau B.
PIXEL_FN float primal_step(float u, float divergence, float tau, float inverse, float shift) {
    return (u + tau * divergence - shift) * inverse;
}

}  // namespace stereomend
