// What the row loops of evidence and fusion share: windows of 5 pixels, ramps.
//
// For files that are compiled once per instruction set: everything is local to them.
#pragma once

#include "pixel.cuh"

namespace stereomend {
namespace {

constexpr int kAround = 2;  // pixels on each side of the window of evidence and of the median
constexpr int kSide = 2 * kAround + 1;

// Repeats the ends of a row, which needs kAround values of room on both sides; `mirror` repeats them outwards.
void extend(float* row, int width, bool mirror) {
    for (int i = 0; i < kAround; ++i) {
        const int inside = mirror ? (i < width ? i : width - 1) : 0;
        row[-1 - i] = row[inside];
        row[width + i] = row[width - 1 - inside];
    }
}

PIXEL_FN float ramp(float value, float least, float slope) {
    return smaller(larger((value - least) * slope, 0.0f), 1.0f);
}

PIXEL_FN float slope_of(float least, float full) { return 1.0f / larger(full - least, 1e-9f); }

}  // namespace
}  // namespace stereomend
