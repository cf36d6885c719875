// The descriptors of both images, row by row.
//
// For gdr_cpu.cpp and evidence_cpu.cpp, which are compiled once per instruction set: everything is local to the file
// that includes it.
#pragma once

#include "sweeps.hpp"

namespace stereomend {
namespace {

// The row that mirrors row y at the borders: the border itself is repeated.
inline int mirrored(int y, int height) {
    const int inside = y < 0 ? -1 - y : (y >= height ? 2 * height - 1 - y : y);
    return inside < 0 ? 0 : (inside >= height ? height - 1 : inside);
}

// Three rows of an image around y, padded by their own ends, so that borders need no test.
class RowRing {
public:
    RowRing(float* memory, int width) : memory_(memory), width_(width) {}

    float* row(int y) { return memory_ + (y % 3) * (width_ + 2) + 1; }

    void pad(int y) {
        row(y)[-1] = row(y)[0];
        row(y)[width_] = row(y)[width_ - 1];
    }

private:
    float* memory_;
    int width_;
};

// padded: the right image's row with its ends repeated, from its first pixel on; places: a row of scratch.
void warp_row(const float* padded, const float* u, int width, int* places, float* base, float* rest) {
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const Place place = place_of(width, x, u[x]);
        places[x] = place.at;
        rest[x] = place.fraction;
    }
    for (int x = 0; x < width; ++x) {
        const float* here = padded + places[x];
        const Grey grey = interpolate(here[0], here[-1], rest[x]);
        base[x] = grey.base;
        rest[x] = grey.rest;
    }
}

template <bool Absolute, class Row>
void describe_row(Row above, Row centre, Row below, int width, float* out) {
    const int stride = width + 2;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        float v[kNeighbours];
        differences(above, centre, below, x, v);
        const float scale = inverse_norm(v);
        for (int k = 0; k < kNeighbours; ++k) out[k * stride + x] = (Absolute ? fabsf(v[k]) : v[k]) * scale;
    }
}

// Rows and descriptors of both images for one band of rows, made on the way down.
class Descriptors {
public:
    Descriptors(const Level& level, const float* u, bool absolute, float* scratch)
        : left(scratch),
          right(left + kNeighbours * stride_of(level)),
          level_(level),
          u_(u),
          absolute_(absolute),
          left_rows_(right + kNeighbours * stride_of(level), level.width),
          base_rows_(right + (kNeighbours + 3) * stride_of(level), level.width),
          rest_rows_(right + (kNeighbours + 6) * stride_of(level), level.width),
          places_(reinterpret_cast<int*>(right + (kNeighbours + 9) * stride_of(level))) {}

    void start(int y) {
        for (int row = y > 0 ? y - 1 : 0; row <= y; ++row) load(row);
    }

    // Row y of both descriptors; rows y - 1 and y have been loaded.
    void describe(int y) {
        const int above = y > 0 ? y - 1 : 0;
        const int below = y + 1 < level_.height ? y + 1 : y;
        if (below > y) load(below);
        describe_rows(left_rows_.row(above), left_rows_.row(y), left_rows_.row(below), left);
        describe_rows(grey(above), grey(y), grey(below), right);
    }

    float* const left;   // (8, width + 2)
    float* const right;  // (8, width + 2), warped

private:
    static int stride_of(const Level& level) { return level.width + 2; }

    GreyRow grey(int y) { return {base_rows_.row(y), rest_rows_.row(y)}; }

    template <class Row>
    void describe_rows(Row above, Row centre, Row below, float* out) {
        if (absolute_) describe_row<true, Row>(above, centre, below, level_.width, out);
        else describe_row<false, Row>(above, centre, below, level_.width, out);
    }

    void load(int y) {
        const int width = level_.width;
        const float* source = level_.left + static_cast<long>(y) * width;
        const float* padded = level_.right + static_cast<long>(y) * (width + 2) + 1;
        float* row = left_rows_.row(y);
        for (int x = 0; x < width; ++x) row[x] = source[x];
        warp_row(padded, u_ + static_cast<long>(y) * width, width, places_, base_rows_.row(y), rest_rows_.row(y));
        left_rows_.pad(y);
        base_rows_.pad(y);
        rest_rows_.pad(y);
    }

    const Level& level_;
    const float* u_;
    bool absolute_;
    RowRing left_rows_;
    RowRing base_rows_;
    RowRing rest_rows_;
    int* places_;
};

}  // namespace
}  // namespace stereomend
