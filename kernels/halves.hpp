// Planes at half of their size by the area mean, sides rounded up.
//
// For evidence_cpu.cpp alone, which is compiled once per instruction set: everything is local to it.
#pragma once

#include "evidence_sweeps.hpp"

namespace stereomend {
namespace {

// Of an odd side of 2 n - 1 pixels, one of n larger ones covers pixel 2 i, a share of the one before and of the one
// after; of an even side, pixels 2 i and 2 i + 1.
struct Cover {
    float slope;  // 1 / n, or 0 for an even side
    float scale;  // 1 / what one covers

    explicit Cover(int side)
        : slope(side % 2 ? 1.0f / static_cast<float>(half_of(side)) : 0.0f),
          scale(static_cast<float>(half_of(side)) / static_cast<float>(side)) {}

    float before(int i) const { return slope * static_cast<float>(i); }
    float after(int i) const { return 1.0f - slope * static_cast<float>(i + 1); }
};

// The rows that row y of the result covers, added up.
template <class Value>
void add_rows(Size from, int y, Value value, float* out) {
    const Cover cover(from.height);
    const float scale = cover.scale;
    const float a = cover.before(y);
    const float b = cover.after(y);
    const long o = 2L * y * from.width;
    const long above = y > 0 && from.height % 2 ? o - from.width : o;
    const long below = 2 * y + 1 < from.height ? o + from.width : o;
#pragma GCC ivdep
    for (int x = 0; x < from.width; ++x)
        out[x] = scale * (a * value(above + x) + value(o + x) + b * value(below + x));
}

// The columns of a row with a pixel of room on both sides.
void add_columns(float* row, int width, float* out) {
    const Cover cover(width);
    const float scale = cover.scale;
    const int half = half_of(width);
    row[-1] = row[width] = 0.0f;
#pragma GCC ivdep
    for (int x = 0; x < half; ++x)
        out[x] = scale * (cover.before(x) * row[2 * x - 1] + row[2 * x] + cover.after(x) * row[2 * x + 1]);
}

void halve_row(const float* plane, Size from, int y, float* scratch, float* out) {
    add_rows(from, y, [=](long i) { return plane[i]; }, scratch + 1);
    add_columns(scratch + 1, from.width, out);
}

// A weight so small that it counts only where there is no other.
constexpr float kHardly = 1e-6f;

void halve_weighed_row(const float* u, const float* weight, Size from, int y, float* scratch, float* out,
                       float* out_weight) {
    halve_row(weight, from, y, scratch, out_weight);
    add_rows(from, y, [=](long i) { return u[i] * (weight[i] + kHardly); }, scratch + 1);
    add_columns(scratch + 1, from.width, out);
    const int half = half_of(from.width);
    const float shrunk = static_cast<float>(half) / static_cast<float>(from.width);
#pragma GCC ivdep
    for (int x = 0; x < half; ++x) out[x] = shrunk * out[x] / (out_weight[x] + kHardly);
}

}  // namespace
}  // namespace stereomend
