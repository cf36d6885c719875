// What the GPU kernels share: where a thread stands, and pixels at the border.
//
// All planes are row-major (height, width) float32 in device memory. Where a kernel takes one struct, the host packs
// its members one after the other, each aligned to its own size.
#pragma once

#include "pixel.cuh"

namespace stereomend {

#define KERNEL extern "C" __global__ void

#define DEVICE_FN static __device__ __forceinline__

constexpr int kLanes = 32;
constexpr unsigned kAllLanes = 0xffffffffu;

// Rows that a block of kLanes columns looks at.
constexpr int kBlockRows = 8;

struct Extent {
    int width;
    int height;
};

DEVICE_FN int clamped(int i, int side) { return i < 0 ? 0 : (i >= side ? side - 1 : i); }

// The pixel that mirrors pixel i at the borders: the border itself is repeated.
DEVICE_FN int mirrored(int i, int side) {
    return clamped(i < 0 ? -1 - i : (i >= side ? 2 * side - 1 - i : i), side);
}

// Grey levels of a block and the pixels around it, borders repeated: of the left image, and of the right one at x - u
// in two parts (see pixel.cuh). Descriptors are made from it on the fly, none is ever stored.
constexpr int kGreyWidth = kLanes + 2;
constexpr int kGreyRows = kBlockRows + 2;
constexpr int kGreyPixels = kGreyWidth * kGreyRows;

struct Greys {
    float* left;
    float* base;
    float* rest;
};

struct Images {
    const float* left;
    const float* right;
    const float* u;
    Extent size;
};

// All threads of the block; (x, y) is the pixel at the upper left, one out of the block along both axes.
DEVICE_FN void load_greys(const Images& images, int x, int y, const Greys& greys) {
    const Extent size = images.size;
    for (int i = threadIdx.y * kLanes + threadIdx.x; i < kGreyPixels; i += kLanes * kBlockRows) {
        const int column = clamped(x + i % kGreyWidth, size.width);
        const long row = static_cast<long>(clamped(y + i / kGreyWidth, size.height)) * size.width;
        const Place place = place_of(size.width, column, images.u[row + column]);
        const float here = images.right[row + clamped(place.at, size.width)];
        const float before = images.right[row + clamped(place.at - 1, size.width)];
        const Grey grey = interpolate(here, before, place.fraction);
        greys.left[i] = images.left[row + column];
        greys.base[i] = grey.base;
        greys.rest[i] = grey.rest;
    }
}

// Differences to the neighbours of the thread's own pixel, of both images.
DEVICE_FN void differ(const Greys& greys, float left[kNeighbours], float right[kNeighbours]) {
    const int above = threadIdx.y * kGreyWidth;
    const int centre = above + kGreyWidth;
    const int below = centre + kGreyWidth;
    const int x = threadIdx.x + 1;
    const auto warped = [&](int row) { return GreyRow{greys.base + row, greys.rest + row}; };
    const auto own = [&](int row) { return static_cast<const float*>(greys.left + row); };
    differences(own(above), own(centre), own(below), x, left);
    differences(warped(above), warped(centre), warped(below), x, right);
}

}  // namespace stereomend
