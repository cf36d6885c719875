// The steps of GDR as row loops that the compiler vectorises.
//
// This file is compiled once per instruction set. Everything but the table is local to the file: a function
// shared by name would leave one copy, perhaps the one that older machines cannot run.
#include "descriptors.hpp"
#include "sweeps.hpp"

namespace stereomend {
namespace {

// What the data term of a row is weighed with: `step` is 2 lambda tau.
struct DataWeight {
    const float* weight;
    float step;
};

// What A and B are made of around the u at hand: the sums over the descriptor of g^2 and of g (D2 - D1), with the
// derivative taken between `before` and `after`, `scale` being 1 / distance.
PIXEL_FN void sum_pixel(const float* d1, const float* d2, int stride, int x, int before, int after, float scale,
                        float* sum_gg, float* sum_gr) {
    float gg = 0.0f;
    float gr = 0.0f;
    for (int k = 0; k < kNeighbours; ++k) {
        const float* row = d2 + k * stride;
        const float g = -scale * (row[after] - row[before]);
        gg += g * g;
        gr += g * (row[x] - d1[k * stride + x]);
    }
    *sum_gg = gg;
    *sum_gr = gr;
}

// Both coefficients at x.
PIXEL_FN void linearise_pixel(const float* d1, const float* d2, int stride, int x, int before, int after, float scale,
                              float u, float weight, float* a, float* b) {
    float sum_gg;
    float sum_gr;
    sum_pixel(d1, d2, stride, x, before, after, scale, &sum_gg, &sum_gr);
    *a = 1.0f / (1.0f + weight * sum_gg);
    *b = weight * (sum_gr - sum_gg * u);
}

template <bool Weighted>
void linearise_row(const float* d1, const float* d2, int width, const float* u, DataWeight weight, float* a, float* b) {
    const int stride = width + 2;
    const int last = width - 1;
    const auto at = [&](int x, int before, int after, float scale) {
        const float own = Weighted ? weight.step * weight.weight[x] : weight.step;
        linearise_pixel(d1, d2, stride, x, before, after, scale, u[x], own, a + x, b + x);
    };
    at(0, 0, last > 0 ? 1 : 0, 1.0f);
#pragma GCC ivdep
    for (int x = 1; x < last; ++x) at(x, x - 1, x + 1, 0.5f);
    if (last > 0) at(last, last - 1, last, 1.0f);
}

void linearise(const Level& level, const State& state, const SolverParams& params, Rows rows, float* scratch) {
    if (rows.begin >= rows.end) return;
    const float step = 2.0f * params.data_weight * params.tau;
    const auto linearise_one = level.weight ? linearise_row<true> : linearise_row<false>;
    Descriptors descriptors(level, state.u, params.absolute, scratch);
    descriptors.start(rows.begin);
    for (int y = rows.begin; y < rows.end; ++y) {
        const long o = static_cast<long>(y) * level.width;
        const DataWeight weight{level.weight ? level.weight + o : nullptr, step};
        descriptors.describe(y);
        linearise_one(descriptors.left, descriptors.right, level.width, state.u + o, weight, state.a + o,
                      state.b + o);
    }
}

void gather_row(const float* d1, const float* d2, int width, float* sum_gg, float* sum_gr) {
    const int stride = width + 2;
    const int last = width - 1;
    sum_pixel(d1, d2, stride, 0, 0, last > 0 ? 1 : 0, 1.0f, sum_gg, sum_gr);
#pragma GCC ivdep
    for (int x = 1; x < last; ++x) sum_pixel(d1, d2, stride, x, x - 1, x + 1, 0.5f, sum_gg + x, sum_gr + x);
    if (last > 0) sum_pixel(d1, d2, stride, last, last - 1, last, 1.0f, sum_gg + last, sum_gr + last);
}

// 1 where the right image shows the pixel, else 0; see ldr_sweeps.hpp. u itself, not rounded: x - u is exact enough
// for a decision that flips with any step of the solver.
void observed_row(const float* u, int width, float* out) {
    const float end = static_cast<float>(width - 1);
    // The leftmost column that pixels further right land in: the only step that waits for its neighbour.
    float leftmost = kFarAway;
    for (int x = width - 1; x >= 0; --x) {
        out[x] = leftmost;
        leftmost = smaller(static_cast<float>(x) - u[x], leftmost);
    }
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const float column = static_cast<float>(x) - u[x];
        const bool outside = (column < 0.0f) | (column > end);
        out[x] = (outside | (out[x] <= column - 1.0f)) ? 0.0f : 1.0f;
    }
}

// One row of an average: the sum of taps[0] times the centre and taps[i] times the two values i away from it. The
// radius is known to the compiler, for a loop of unknown length inside would not be vectorised.
template <int Radius>
void average(const float* const* before, const float* const* after, const float* taps, int width, float* out) {
    const float* b[Radius + 1];
    const float* a[Radius + 1];
    float t[Radius + 1];
    for (int i = 0; i <= Radius; ++i) {
        b[i] = before[i];
        a[i] = after[i];
        t[i] = taps[i];
    }
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        float sum = t[0] * b[0][x];
        for (int i = 1; i <= Radius; ++i) sum += t[i] * (b[i][x] + a[i][x]);
        out[x] = sum;
    }
}

using Average = void(const float* const*, const float* const*, const float*, int, float*);
constexpr Average* kAverage[kMostTaps] = {average<0>, average<1>, average<2>, average<3>, average<4>,
                                          average<5>, average<6>, average<7>, average<8>};

// Averages a row; it needs kMostTaps values of room on both sides, which become its mirror images.
void average_row(float* row, int width, const Window& window, float* out) {
    const float* before[kMostTaps] = {row};
    const float* after[kMostTaps] = {row};
    for (int i = 1; i <= window.radius; ++i) {
        row[-i] = row[i - 1 < width ? i - 1 : width - 1];
        row[width - 1 + i] = row[width - i > 0 ? width - i : 0];
        before[i] = row - i;
        after[i] = row + i;
    }
    kAverage[window.radius](before, after, window.taps, width, out);
}

void weigh_row(const float* weight, int width, float* sum_gg, float* sum_gr) {
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        sum_gg[x] *= weight[x];
        sum_gr[x] *= weight[x];
    }
}

void gather(const Level& level, const State& state, const SolverParams& params, const Window& window, Rows rows,
            float* scratch) {
    if (rows.begin >= rows.end) return;
    const int width = level.width;
    Descriptors descriptors(level, state.u, params.absolute, scratch);
    float* gg = scratch + descriptor_floats(width) + kMostTaps;
    float* gr = gg + width + 2 * kMostTaps;
    float* observed = gr + width + kMostTaps;
    descriptors.start(rows.begin);
    for (int y = rows.begin; y < rows.end; ++y) {
        const long o = static_cast<long>(y) * width;
        descriptors.describe(y);
        gather_row(descriptors.left, descriptors.right, width, gg, gr);
        if (params.observed_only) {
            observed_row(state.u + o, width, observed);
            weigh_row(observed, width, gg, gr);
        }
        if (level.weight) weigh_row(level.weight + o, width, gg, gr);
        average_row(gg, width, window, state.sum_gg + o);
        average_row(gr, width, window, state.sum_gr + o);
    }
}

void average_down(const float* plane, int width, int height, int y, const Window& window, float* out) {
    const float* above[kMostTaps];
    const float* below[kMostTaps];
    for (int i = 0; i <= window.radius; ++i) {
        above[i] = plane + static_cast<long>(mirrored(y - i, height)) * width;
        below[i] = plane + static_cast<long>(mirrored(y + i, height)) * width;
    }
    kAverage[window.radius](above, below, window.taps, width, out);
}

State row_of(const Level& level, const State& state, int y) {
    const long o = static_cast<long>(y) * level.width;
    return {state.u + o, state.u_bar + o, state.p_x + o, state.p_y + o, state.a + o, state.b + o,
            state.shrink + o, state.threshold + o, state.sum_gg + o, state.sum_gr + o};
}

// A and B around u: the sums have been averaged as functions of the step from u, not of u itself, so that a slope
// stays a slope.
void settle(const Level& level, const State& state, const SolverParams& params, const Window& window, Rows rows) {
    const float step = 2.0f * params.data_weight * params.tau;
    const int width = level.width;
    for (int y = rows.begin; y < rows.end; ++y) {
        const State row = row_of(level, state, y);
        average_down(state.sum_gg, width, level.height, y, window, row.a);
        average_down(state.sum_gr, width, level.height, y, window, row.b);
#pragma GCC ivdep
        for (int x = 0; x < width; ++x) {
            const float gg = row.a[x];
            row.a[x] = 1.0f / (1.0f + step * gg);
            row.b[x] = step * (row.b[x] - gg * row.u[x]);
        }
        if (!level.trust) continue;
        const float* trust = level.trust + static_cast<long>(y) * width;
#pragma GCC ivdep
        for (int x = 0; x < width; ++x) row.threshold[x] = params.tau * trust[x] * row.a[x];
    }
}

void prepare_edges(const Level& level, const State& state, const SolverParams& params, Rows rows) {
    const float soft = params.sigma * params.huber_epsilon;
    const long end = static_cast<long>(rows.end) * level.width;
#pragma GCC ivdep
    for (long i = static_cast<long>(rows.begin) * level.width; i < end; ++i)
        state.shrink[i] = level.edge[i] / (level.edge[i] + soft);
}

void weighted_dual_row(const float* u_bar, const float* next, int width, float sigma, const float* edge,
                       const State& row) {
    const int last = width - 1;
    const auto step = [&](int x, float gradient_x) {
        weighted_dual_step(gradient_x, next[x] - u_bar[x], sigma, row.shrink[x], edge[x], row.p_x + x, row.p_y + x);
    };
#pragma GCC ivdep
    for (int x = 0; x < last; ++x) step(x, u_bar[x + 1] - u_bar[x]);
    step(last, 0.0f);
}

// Below the last row the gradient is 0: `next` is then the row itself.
void dual_row(const float* u_bar, const float* next, int width, float sigma, float shrink, float* p_x, float* p_y) {
    const int last = width - 1;
#pragma GCC ivdep
    for (int x = 0; x < last; ++x)
        dual_step(u_bar[x + 1] - u_bar[x], next[x] - u_bar[x], sigma, shrink, p_x + x, p_y + x);
    dual_step(0.0f, next[last] - u_bar[last], sigma, shrink, p_x + last, p_y + last);
}

template <bool Prior>
PIXEL_FN void primal_pixel(const State& row, const float* prior, int x, float divergence, float tau) {
    const float old = row.u[x];
    float u = primal_step(old, divergence, tau, row.a[x], row.b[x]);
    if (Prior) u = towards(u, prior[x], row.threshold[x]);
    row.u[x] = u;
    row.u_bar[x] = 2.0f * u - old;
}

// p is 0 before the first and on the last pixel of a row and a column, so far borders need no test.
template <bool Prior>
void primal_row(const State& row, const float* prior, const float* p_y_above, int width, float tau) {
    primal_pixel<Prior>(row, prior, 0, row.p_x[0] + row.p_y[0] - p_y_above[0], tau);
#pragma GCC ivdep
    for (int x = 1; x < width; ++x)
        primal_pixel<Prior>(row, prior, x, row.p_x[x] - row.p_x[x - 1] + row.p_y[x] - p_y_above[x], tau);
}

template <bool Prior>
void primal_top_row(const State& row, const float* prior, int width, float tau) {
    primal_pixel<Prior>(row, prior, 0, row.p_x[0] + row.p_y[0], tau);
#pragma GCC ivdep
    for (int x = 1; x < width; ++x) primal_pixel<Prior>(row, prior, x, row.p_x[x] - row.p_x[x - 1] + row.p_y[x], tau);
}

void dual(const Level& level, const State& state, const SolverParams& params, const float* extrapolated, int y) {
    const State row = row_of(level, state, y);
    const float* u_bar = extrapolated + static_cast<long>(y) * level.width;
    const float* next = y + 1 < level.height ? u_bar + level.width : u_bar;
    const float shrink = 1.0f / (1.0f + params.sigma * params.huber_epsilon);
    if (level.edge) {
        const float* edge = level.edge + static_cast<long>(y) * level.width;
        weighted_dual_row(u_bar, next, level.width, params.sigma, edge, row);
        return;
    }
    dual_row(u_bar, next, level.width, params.sigma, shrink, row.p_x, row.p_y);
}

void primal(const Level& level, const State& state, const SolverParams& params, int y) {
    const State row = row_of(level, state, y);
    const float* prior = level.prior ? level.prior + static_cast<long>(y) * level.width : nullptr;
    const float* above = row.p_y - level.width;
    if (prior) {
        if (y == 0) primal_top_row<true>(row, prior, level.width, params.tau);
        else primal_row<true>(row, prior, above, level.width, params.tau);
    } else {
        if (y == 0) primal_top_row<false>(row, prior, level.width, params.tau);
        else primal_row<false>(row, prior, above, level.width, params.tau);
    }
}

// Distances of the descriptors, 0 where `seen` is false.
void distance_row(const float* d1, const float* d2, const bool* seen, int width, float* out) {
    const int stride = width + 2;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        float square = 0.0f;
        for (int k = 0; k < kNeighbours; ++k) {
            const float difference = d2[k * stride + x] - d1[k * stride + x];
            square += difference * difference;
        }
        out[x] = sqrtf(square);
    }
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) out[x] = seen[x] ? out[x] : 0.0f;
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

void distance(const Level& level, const float* u, const bool* seen, Rows rows, float* scratch, double* sums) {
    if (rows.begin >= rows.end) return;
    Descriptors descriptors(level, u, false, scratch);
    descriptors.start(rows.begin);
    for (int y = rows.begin; y < rows.end; ++y) {
        descriptors.describe(y);
        float* row = descriptors.left;  // its first descriptor is not needed any more
        distance_row(descriptors.left, descriptors.right, seen + static_cast<long>(y) * level.width, level.width, row);
        sums[y] = sum_row(row, level.width);
    }
}

}  // namespace

extern const Sweeps SWEEPS = {linearise, gather, settle, prepare_edges, dual, primal, distance};

}  // namespace stereomend
