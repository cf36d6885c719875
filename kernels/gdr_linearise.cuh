// The data term around u (Eq. 9 to 11, R5): warp, descriptors and their derivative in one pass.
#pragma once

#include "gdr_device.cuh"

namespace stereomend {

struct DataTerm {
    const float* left;   // [in] grey levels
    const float* right;  // [in]
    const float* u;      // [in, px]
    const float* share;  // [in] weight of the data term, 0 to 1; null for 1 everywhere
    float* first;        // [out] of `linearise` 1 / (1 + 2 lambda tau A), of `gather` the sum of g^2
    float* second;       // [out] of `linearise` 2 lambda tau B, of `gather` the sum of g (D2 - D1)
    int width;
    int height;
    int absolute;  // descriptors of absolute differences
    float step;    // 2 lambda tau
};

// The outermost lanes of a row only describe: the derivative needs both neighbours.
constexpr int kLinearised = kLanes - 2;

struct Sums {
    float gg;
    float gr;
};

DEVICE_FN void normalise(float v[kNeighbours], bool absolute) {
    const float scale = inverse_norm(v);
    for (int k = 0; k < kNeighbours; ++k) v[k] = (absolute ? fabsf(v[k]) : v[k]) * scale;
}

// All lanes of a warp, each with both descriptors of its pixel, x being its column.
DEVICE_FN Sums sum_neighbours(const float own[kNeighbours], const float warped[kNeighbours], int x, int width) {
    const bool first = x <= 0;
    const bool last = x >= width - 1;
    const float scale = first || last ? 1.0f : 0.5f;
    Sums sums{0.0f, 0.0f};
    for (int k = 0; k < kNeighbours; ++k) {
        const float before = __shfl_up_sync(kAllLanes, warped[k], 1);
        const float after = __shfl_down_sync(kAllLanes, warped[k], 1);
        const float g = -scale * ((last ? warped[k] : after) - (first ? warped[k] : before));
        sums.gg += g * g;
        sums.gr += g * (warped[k] - own[k]);
    }
    return sums;
}

template <bool Gathered>
DEVICE_FN void linearise_block(const DataTerm& in) {
    __shared__ float left[kGreyPixels];
    __shared__ float base[kGreyPixels];
    __shared__ float rest[kGreyPixels];
    const Greys greys{left, base, rest};
    const int x = blockIdx.x * kLinearised + threadIdx.x - 1;
    const int y = blockIdx.y * kBlockRows + threadIdx.y;
    load_greys({in.left, in.right, in.u, {in.width, in.height}}, blockIdx.x * kLinearised - 2,
               blockIdx.y * kBlockRows - 1, greys);
    __syncthreads();
    float own[kNeighbours];
    float warped[kNeighbours];
    differ(greys, own, warped);
    normalise(own, in.absolute);
    normalise(warped, in.absolute);
    const Sums sums = sum_neighbours(own, warped, x, in.width);
    if (threadIdx.x < 1 || threadIdx.x > kLinearised || x >= in.width || y >= in.height) return;
    const long i = static_cast<long>(y) * in.width + x;
    const float share = in.share ? in.share[i] : 1.0f;
    const float step = in.step * share;
    in.first[i] = Gathered ? share * sums.gg : 1.0f / (1.0f + step * sums.gg);
    in.second[i] = Gathered ? share * sums.gr : step * (sums.gr - sums.gg * in.u[i]);
}

// The coefficients that the iterations take. A thread per pixel, blocks of kLanes x kBlockRows threads for
// kLinearised x kBlockRows pixels.
KERNEL linearise(DataTerm in) { linearise_block<false>(in); }

// The sums that `average` makes coefficients of; threads as `linearise`.
KERNEL gather(DataTerm in) { linearise_block<true>(in); }

// Half of a symmetric window that sums to 1: taps[0] is the centre.
constexpr int kMostRadius = 8;

struct Averaged {
    const float* sum_gg;  // [in] by `gather`
    const float* sum_gr;  // [in]
    const float* u;       // [in, px]
    float* a;             // [out] as `linearise`
    float* b;             // [out]
    int width;
    int height;
    int radius;  // of the window [px]
    float step;  // 2 lambda tau
    float taps[kMostRadius + 1];
};

constexpr int kAveragedRows = 32;
constexpr int kWindowWidth = kLanes + 2 * kMostRadius;
constexpr int kWindowRows = kAveragedRows + 2 * kMostRadius;

// By constant indices: others would need the parameters in local memory.
DEVICE_FN void share_taps(const Averaged& in, float* taps) {
    if (threadIdx.y > 0 || threadIdx.x > 0) return;
#pragma unroll
    for (int k = 0; k <= kMostRadius; ++k) taps[k] = in.taps[k];
}

// One plane around a block, mirrored at the borders, averaged along its rows.
DEVICE_FN void average_rows(const Averaged& in, const float* plane, const float* taps, float* window, float* rows) {
    const int thread = threadIdx.y * kLanes + threadIdx.x;
    const int width = kLanes + 2 * in.radius;
    const int height = kAveragedRows + 2 * in.radius;
    for (int i = thread; i < width * height; i += kLanes * kBlockRows) {
        const int x = mirrored(blockIdx.x * kLanes + i % width - in.radius, in.width);
        const int y = mirrored(blockIdx.y * kAveragedRows + i / width - in.radius, in.height);
        window[i / width * kWindowWidth + i % width] = plane[static_cast<long>(y) * in.width + x];
    }
    __syncthreads();
    for (int y = threadIdx.y; y < height; y += kBlockRows) {
        const float* centre = window + y * kWindowWidth + threadIdx.x + in.radius;
        float sum = taps[0] * centre[0];
        for (int k = 1; k <= in.radius; ++k) sum += taps[k] * (centre[-k] + centre[k]);
        rows[y * kLanes + threadIdx.x] = sum;
    }
}

DEVICE_FN float average_column(const float* centre, const float* taps, int radius) {
    float sum = taps[0] * centre[0];
    for (int k = 1; k <= radius; ++k) sum += taps[k] * (centre[-k * kLanes] + centre[k * kLanes]);
    return sum;
}

// Averages both sums over the window and makes coefficients of them. As functions of the step from u, not of u itself,
// so that a slope stays a slope. Blocks of kLanes x kBlockRows threads for kLanes x kAveragedRows pixels.
KERNEL average(Averaged in) {
    __shared__ float window[kWindowWidth * kWindowRows];
    __shared__ float rows_gg[kLanes * kWindowRows];
    __shared__ float rows_gr[kLanes * kWindowRows];
    __shared__ float taps[kMostRadius + 1];
    share_taps(in, taps);
    average_rows(in, in.sum_gg, taps, window, rows_gg);
    __syncthreads();
    average_rows(in, in.sum_gr, taps, window, rows_gr);
    __syncthreads();
    const int x = blockIdx.x * kLanes + threadIdx.x;
    for (int k = threadIdx.y; k < kAveragedRows; k += kBlockRows) {
        const int y = blockIdx.y * kAveragedRows + k;
        if (x >= in.width || y >= in.height) continue;
        const long i = static_cast<long>(y) * in.width + x;
        const int centre = (k + in.radius) * kLanes + threadIdx.x;
        const float gg = average_column(rows_gg + centre, taps, in.radius);
        const float gr = average_column(rows_gr + centre, taps, in.radius);
        in.a[i] = 1.0f / (1.0f + in.step * gg);
        in.b[i] = in.step * (gr - gg * in.u[i]);
    }
}

}  // namespace stereomend
