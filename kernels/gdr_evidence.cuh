// What the pair says for two maps, and the better of them (R1, R6).
#pragma once

#include "gdr_device.cuh"

namespace stereomend {

struct Rivals {
    const float* left;   // [in] grey levels
    const float* right;  // [in]
    const float* u;      // [in, px]
    const float* other;  // [in, px]
    float* similar;      // [out] (2, height, width) inner products of the descriptors, -1 to 1
    int width;
    int height;
};

// A thread per pixel, a layer of blocks of kLanes x kBlockRows per map.
KERNEL similarity(Rivals in) {
    __shared__ float left[kGreyPixels];
    __shared__ float base[kGreyPixels];
    __shared__ float rest[kGreyPixels];
    const Greys greys{left, base, rest};
    const int x = blockIdx.x * kLanes + threadIdx.x;
    const int y = blockIdx.y * kBlockRows + threadIdx.y;
    const float* u = blockIdx.z ? in.other : in.u;
    load_greys({in.left, in.right, u, {in.width, in.height}}, blockIdx.x * kLanes - 1, blockIdx.y * kBlockRows - 1,
               greys);
    __syncthreads();
    if (x >= in.width || y >= in.height) return;
    float v[kNeighbours];
    float w[kNeighbours];
    differ(greys, v, w);
    in.similar[(static_cast<long>(blockIdx.z) * in.height + y) * in.width + x] = similarity_of(v, w);
}

struct Choice {
    const float* similar;  // [in] by `similarity`
    const float* other;    // [in, px]
    const float* shown;    // [in] 1 where the other map is seen, else 0
    float* u;              // [in/out, px]
    int width;
    int height;
    float margin;
    float least;
    float apart;
};

// n: the mean over 5 x 5 pixels, mirrored at the borders.
DEVICE_FN float evidence_of(const float* similar, Extent size, int x, int y) {
    constexpr int kAround = 2;
    float sum = 0.0f;
    for (int dy = -kAround; dy <= kAround; ++dy) {
        const float* row = similar + static_cast<long>(mirrored(y + dy, size.height)) * size.width;
        float of_row = 0.0f;
        for (int dx = -kAround; dx <= kAround; ++dx) of_row += row[mirrored(x + dx, size.width)];
        sum += of_row;
    }
    return sum * (1.0f / 25.0f);
}

// u, or the other map where the pair speaks for it far more. A thread per pixel.
KERNEL better(Choice in) {
    const int x = blockIdx.x * kLanes + threadIdx.x;
    const int y = blockIdx.y * kBlockRows + threadIdx.y;
    if (x >= in.width || y >= in.height) return;
    const Extent size{in.width, in.height};
    const long i = static_cast<long>(y) * in.width + x;
    if (in.shown[i] == 0.0f || !(fabsf(in.other[i] - in.u[i]) > in.apart)) return;
    const float found = evidence_of(in.similar, size, x, y);
    const float claimed = evidence_of(in.similar + static_cast<long>(in.width) * in.height, size, x, y);
    if (claimed > larger(found + in.margin, in.least)) in.u[i] = in.other[i];
}

}  // namespace stereomend
