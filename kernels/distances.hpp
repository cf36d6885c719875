// How far the descriptors of both images are from each other.
//
// For gdr_cpu.cpp alone, which is compiled once per instruction set: everything is local to it.
#pragma once

#include <stdint.h>
#include <string.h>

#include "descriptors.hpp"

namespace stereomend {
namespace {

void describe(const Level& level, Rows rows, float* out) {
    const int width = level.width;
    RowRing ring(out + descriptors_of_rows(width, rows.end - rows.begin), width);
    const auto load = [&](int y) {
        memcpy(ring.row(y), level.left + static_cast<long>(y) * width, sizeof(float) * width);
        ring.pad(y);
    };
    for (int y = rows.begin > 0 ? rows.begin - 1 : 0; y <= rows.begin; ++y) load(y);
    for (int y = rows.begin; y < rows.end; ++y) {
        const int above = y > 0 ? y - 1 : 0;
        const int below = y + 1 < level.height ? y + 1 : y;
        if (below > y) load(below);
        describe_row<false, const float*>(ring.row(above), ring.row(y), ring.row(below), width,
                                          out + descriptors_of_rows(width, y - rows.begin));
    }
}

// Of the descriptors `left` from those of three rows, which are nowhere stored: both images' would not stay in the
// nearest cache.
void distance_row(GreyRow above, GreyRow centre, GreyRow below, int width, const float* left, float* out) {
    const int stride = width + 2;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        float v[kNeighbours];
        differences(above, centre, below, x, v);
        const float scale = inverse_norm(v);
        float square = 0.0f;
        for (int k = 0; k < kNeighbours; ++k) {
            const float difference = v[k] * scale - left[k * stride + x];
            square += difference * difference;
        }
        out[x] = sqrtf(square);
    }
}

// Rows of the warped right image, made on the way down.
class Warped {
public:
    Warped(const Level& level, const float* u, float* scratch)
        : level_(level), u_(u), base_(scratch, level.width), rest_(scratch + 3 * stride(), level.width),
          places_(reinterpret_cast<int*>(scratch + 6 * stride())), padded_(scratch + 7 * stride()) {}

    void start(int y) {
        for (int row = y > 0 ? y - 1 : 0; row <= y; ++row) load(row);
    }

    // How far the descriptors of row y are from those of the left image; rows y - 1 and y have been loaded.
    void distance(int y, const float* left, float* out) {
        const int above = y > 0 ? y - 1 : 0;
        const int below = y + 1 < level_.height ? y + 1 : y;
        if (below > y) load(below);
        distance_row(grey(above), grey(y), grey(below), level_.width, left, out);
    }

private:
    long stride() const { return level_.width + 2; }
    GreyRow grey(int y) { return {base_.row(y), rest_.row(y)}; }

    void load(int y) {
        const int width = level_.width;
        const long o = static_cast<long>(y) * width;
        memcpy(padded_ + 1, level_.right + o, sizeof(float) * width);
        padded_[0] = padded_[1];
        padded_[width + 1] = padded_[width];
        warp_row(padded_ + 1, u_ + o, width, places_, base_.row(y), rest_.row(y));
        base_.pad(y);
        rest_.pad(y);
    }

    const Level& level_;
    const float* u_;
    RowRing base_;
    RowRing rest_;
    int* places_;
    float* padded_;
};

// 0 where `seen` is false.
void mask_row(const bool* seen, int width, float* values) {
    const uint8_t* flags = reinterpret_cast<const uint8_t*>(seen);
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) values[x] *= static_cast<float>(flags[x]);
}

// In four parts, so that no addition waits for the one before.
double sum_row(const float* values, int width) {
    double sums[4] = {};
    int x = 0;
    for (; x + 4 <= width; x += 4)
        for (int k = 0; k < 4; ++k) sums[k] += static_cast<double>(values[x + k]);
    for (; x < width; ++x) sums[0] += static_cast<double>(values[x]);
    return (sums[0] + sums[1]) + (sums[2] + sums[3]);
}

void distance(const Level& level, const float* u, const float* described, const bool* seen, Rows rows, float* scratch,
              double* sums) {
    const int width = level.width;
    float* own = scratch + 8 * (static_cast<size_t>(width) + 2);
    Warped warped(level, u, scratch);
    warped.start(rows.begin);
    for (int y = rows.begin; y < rows.end; ++y) {
        const int row = y - rows.begin;
        warped.distance(y, described + descriptors_of_rows(width, row), own);
        mask_row(seen + static_cast<long>(row) * width, width, own);
        sums[row] = sum_row(own, width);
    }
}

}  // namespace
}  // namespace stereomend
