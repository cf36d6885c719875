// Averages on a coarse grid, and back to pixels (R7 to R9).
//
// For fusion_cpu.cpp alone, which is compiled once per instruction set: everything is local to it.
#pragma once

#include <string.h>

#include "descriptors.hpp"
#include "fusion_sweeps.hpp"

namespace stereomend {
namespace {

constexpr float kTouched = 1e-4f;  // support from which there is a plane

// The cell that mirrors cell i at the borders, however far outside it lies.
int reflected(int i, int count) {
    while (i < 0 || i >= count) i = i < 0 ? -1 - i : 2 * count - 1 - i;
    return i;
}

// Adds the next pairs of an average to a row of it.
template <int Count>
void add_pairs(const double* const* before, const double* const* after, const double* weights, int width, double* out) {
    const double* b[Count];
    const double* a[Count];
    double w[Count];
    for (int k = 0; k < Count; ++k) {
        b[k] = before[k];
        a[k] = after[k];
        w[k] = weights[k];
    }
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        double sum = out[x];
        for (int k = 0; k < Count; ++k) sum += w[k] * (b[k][x] + a[k][x]);
        out[x] = sum;
    }
}

// One row of an average; row_at(k) is the one k away from its middle. Several pairs at a time: to load and store the sum
// for each would take as long as to add.
template <class RowAt>
void average_cells(const Taps& taps, const RowAt& row_at, int width, double* out) {
    constexpr int kTogether = 8;
    const double* middle = row_at(0);
    for (int x = 0; x < width; ++x) out[x] = taps.weight[0] * middle[x];
    int k = 1;
    const auto add = [&](auto add_some, int count) {
        const double* before[kTogether];
        const double* after[kTogether];
        for (int i = 0; i < count; ++i) {
            before[i] = row_at(-(k + i));
            after[i] = row_at(k + i);
        }
        add_some(before, after, taps.weight + k, width, out);
        k += count;
    };
    while (k + kTogether - 1 <= taps.radius) add(add_pairs<kTogether>, kTogether);
    while (k <= taps.radius) add(add_pairs<1>, 1);
}

void blur(const double* plane, Size cells, int columns, const Taps& taps, double* scratch, double* out) {
    const int width = cells.width;
    const int needed = columns + taps.radius;
    double* rows = scratch;
    double* padded = scratch + static_cast<long>(columns) * cells.height;
    for (int y = 0; y < cells.height; ++y) {
        const double* row = plane + static_cast<long>(y) * width;
        for (int x = -taps.radius; x < needed; ++x) padded[x + taps.radius] = row[reflected(x, width)];
        const double* middle = padded + taps.radius;
        average_cells(taps, [&](int k) { return middle + k; }, columns, rows + static_cast<long>(y) * columns);
    }
    for (int y = 0; y < cells.height; ++y) {
        const auto row = [&](int k) { return rows + static_cast<long>(reflected(y + k, cells.height)) * columns; };
        average_cells(taps, row, columns, out + static_cast<long>(y) * width);
    }
}

// Where pixel y lies among `count` cells: after the centre of the first of two, by a share of the way to the second.
struct Between {
    int before;
    int after;
    float share;
};

Between between(int y, int count) {
    const int shifted = y - kCell / 2;
    if (shifted < 0) return {0, 0, 0.0f};
    const int before = shifted / kCell;
    if (before + 1 >= count) return {count - 1, count - 1, 0.0f};
    return {before, before + 1, (static_cast<float>(shifted % kCell) + 0.5f) / kCell};
}

// scratch: a row of cells.
void widen_cells(const double* plane, Size cells, int y, int width, float* scratch, float* out) {
    const Between at = between(y, cells.height);
    const double* first = plane + static_cast<long>(at.before) * cells.width;
    const double* second = plane + static_cast<long>(at.after) * cells.width;
    const int count = (width + kCell - 1) / kCell + 1 < cells.width ? (width + kCell - 1) / kCell + 1 : cells.width;
    for (int x = 0; x < count; ++x) {
        const float before = static_cast<float>(first[x]);
        scratch[x] = before + at.share * (static_cast<float>(second[x]) - before);
    }
    for (int x = 0; x < kCell / 2; ++x) out[x] = scratch[0];
    float* to = out + kCell / 2;
    for (int cell = 0; cell * kCell + kCell / 2 < width; ++cell, to += kCell) {
        const float before = scratch[cell < count ? cell : count - 1];
        const float step = scratch[cell + 1 < count ? cell + 1 : count - 1] - before;
        for (int j = 0; j < kCell; ++j) to[j] = before + step * ((static_cast<float>(j) + 0.5f) / kCell);
    }
}

void widen(const double* plane, Size cells, int y, int width, float* scratch, float* out) {
    float* row = scratch + cells.width + 1;
    widen_cells(plane, cells, y, width, scratch, row);
    memcpy(out, row, sizeof(float) * width);
}

void bend(const float* u, Size size, int columns, const PlaneFit& fit, const BendRule& rule, int y, float* scratch,
          float* out) {
    const Size cells{cells_of(size.width), cells_of(size.height)};
    const long room = columns + 2L * kCell;
    float* value = scratch + cells.width + 1;
    float* residual = value + room;
    float* support = residual + room;
    widen_cells(fit.value, cells, y, columns, scratch, value);
    widen_cells(fit.residual, cells, y, columns, scratch, residual);
    widen_cells(fit.support, cells, y, columns, scratch, support);
    const float* row = u + static_cast<long>(y) * size.width;
    float* to = out + static_cast<long>(y) * size.width;
    const float most = rule.bend;
    const float damping = 1.0f / (rule.flat * rule.flat);
#pragma GCC ivdep
    for (int x = 0; x < columns; ++x) {
        const float limit = most * larger(row[x], 1.0f);
        const float step = smaller(larger(value[x] - row[x], -limit), limit) / (1.0f + residual[x] * damping);
        const float bent = larger(row[x] + step, 0.0f);
        const bool outside = (static_cast<float>(x) < row[x]) & (support[x] > kTouched);
        to[x] = outside ? bent : row[x];
    }
    memcpy(to + columns, row + columns, sizeof(float) * (size.width - columns));
}

}  // namespace
}  // namespace stereomend
