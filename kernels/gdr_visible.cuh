// What the right image shows of the left one (R5, R6).
#pragma once

#include "gdr_device.cuh"

namespace stereomend {

// The smallest value of the lanes from this one on.
template <class Number>
DEVICE_FN Number least_from_here(Number value) {
    for (int apart = 1; apart < kLanes; apart *= 2) {
        const Number other = __shfl_down_sync(kAllLanes, value, apart);
        if (threadIdx.x + apart < kLanes) value = other < value ? other : value;
    }
    return value;
}

// One row by one warp, from right to left: a pixel is hidden by one further right that lands at least 1 px left of its
// column. `out` gets the weight where the pixel is seen, else 0.
template <class Number>
DEVICE_FN void see_row(const float* u, const float* weight, int width, float* out) {
    constexpr Number kBeyond = 1e30f;
    const int lane = threadIdx.x;
    Number leftmost = kBeyond;  // column that pixels right of these lanes land in
    for (int begin = (width - 1) / kLanes * kLanes; begin >= 0; begin -= kLanes) {
        const int x = begin + lane;
        const bool inside = x < width;
        const Number column = inside ? static_cast<Number>(x) - static_cast<Number>(u[x]) : kBeyond;
        const Number least = least_from_here(column);
        const Number further = __shfl_down_sync(kAllLanes, least, 1);
        const Number nearer = lane < kLanes - 1 && further < leftmost ? further : leftmost;
        const bool seen = column >= 0 && column <= width - 1 && nearer > column - 1;
        if (inside) out[x] = seen ? (weight ? weight[x] : 1.0f) : 0.0f;
        const Number all = __shfl_sync(kAllLanes, least, 0);
        leftmost = all < leftmost ? all : leftmost;
    }
}

template <class Number>
DEVICE_FN void see(const float* u, const float* weight, float* out, int width, int height) {
    const int y = blockIdx.x * blockDim.y + threadIdx.y;
    if (y >= height) return;  // the whole warp
    const long row = static_cast<long>(y) * width;
    see_row<Number>(u + row, weight ? weight + row : nullptr, width, out + row);
}

// The share of the data term at each pixel [out]: its weight (null for 1) where u [px] is seen. In float32, as u is at
// hand: a decision that flips with any step of the solver. A warp per row, blocks of kLanes x kBlockRows.
KERNEL observed(const float* u, const float* weight, float* share, int width, int height) {
    see<float>(u, weight, share, width, height);
}

// 1 where the map u [px] is seen, else 0 [out]; exact. Threads as `observed`.
KERNEL shown(const float* u, float* out, int width, int height) { see<double>(u, nullptr, out, width, height); }

}  // namespace stereomend
