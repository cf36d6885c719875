// The steps of GDR as row loops that the compiler vectorises.
//
// This file is compiled once per instruction set. Everything but the table is local to the file: a function
// shared by name would leave one copy, perhaps the one that older machines cannot run.
#include <initializer_list>

#include "sweeps.hpp"

namespace stereomend {
namespace {

// Three rows of an image around y, padded by their own ends, so that borders need no test.
class RowRing {
public:
    RowRing(float* memory, int width) : memory_(memory), width_(width), stride_(width + 2) {}

    float* base(int y) { return memory_ + (y % 3) * stride_ + 1; }
    float* rest(int y) { return base(y) + 3 * stride_; }
    GreyRow row(int y) { return {base(y), rest(y)}; }

    void pad(int y) {
        for (float* row : {base(y), rest(y)}) {
            row[-1] = row[0];
            row[width_] = row[width_ - 1];
        }
    }

private:
    float* memory_;
    int width_;
    int stride_;
};

void load_row(const Level& level, int y, RowRing& ring) {
    const float* source = level.left + static_cast<long>(y) * level.width;
    float* base = ring.base(y);
    float* rest = ring.rest(y);
    for (int x = 0; x < level.width; ++x) base[x] = source[x];
    for (int x = 0; x < level.width; ++x) rest[x] = 0.0f;
    ring.pad(y);
}

void warp_row(const Level& level, const float* u, int y, RowRing& ring) {
    const long offset = static_cast<long>(y) * level.width;
    const float* source = level.right + offset;
    const float* shift = u + offset;
    float* base = ring.base(y);
    float* rest = ring.rest(y);
#pragma GCC ivdep
    for (int x = 0; x < level.width; ++x) {
        const Grey grey = sample_row(source, level.width, x, shift[x]);
        base[x] = grey.base;
        rest[x] = grey.rest;
    }
    ring.pad(y);
}

template <bool Absolute>
void describe_row(GreyRow above, GreyRow centre, GreyRow below, int width, float* out) {
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
        : level_(level),
          u_(u),
          describe_(absolute ? describe_row<true> : describe_row<false>),
          left_rows_(scratch, level.width),
          right_rows_(scratch + 6 * stride(), level.width),
          left(scratch + 12 * stride()),
          right(left + kNeighbours * stride()) {}

    int stride() const { return level_.width + 2; }

    void start(int y) {
        for (int row = y > 0 ? y - 1 : 0; row <= y; ++row) load(row);
    }

    // Row y of both descriptors; rows y - 1 and y have been loaded.
    void describe(int y) {
        const int above = y > 0 ? y - 1 : 0;
        const int below = y + 1 < level_.height ? y + 1 : y;
        if (below > y) load(below);
        describe_(left_rows_.row(above), left_rows_.row(y), left_rows_.row(below), level_.width, left);
        describe_(right_rows_.row(above), right_rows_.row(y), right_rows_.row(below), level_.width, right);
    }

private:
    void load(int y) {
        load_row(level_, y, left_rows_);
        warp_row(level_, u_, y, right_rows_);
    }

    const Level& level_;
    const float* u_;
    void (*describe_)(GreyRow, GreyRow, GreyRow, int, float*);
    RowRing left_rows_;
    RowRing right_rows_;

public:
    float* left;   // (8, width + 2)
    float* right;  // (8, width + 2), warped
};

// What the data term of a row is weighed with: `step` is 2 lambda tau.
struct DataWeight {
    const float* weight;
    float step;
};

// Both coefficients at x, with the derivative taken between `before` and `after`, `scale` being 1 / distance.
PIXEL_FN void linearise_pixel(const float* d1, const float* d2, int stride, int x, int before, int after, float scale,
                              float u, float weight, float* a, float* b) {
    float sum_gg = 0.0f;
    float sum_gr = 0.0f;
    for (int k = 0; k < kNeighbours; ++k) {
        const float* row = d2 + k * stride;
        const float g = -scale * (row[after] - row[before]);
        sum_gg += g * g;
        sum_gr += g * (row[x] - d1[k * stride + x]);
    }
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
    if (width == 1) {
        a[0] = 1.0f;
        b[0] = 0.0f;
        return;
    }
    at(0, 0, 1, 1.0f);
#pragma GCC ivdep
    for (int x = 1; x < last; ++x) at(x, x - 1, x + 1, 0.5f);
    at(last, last - 1, last, 1.0f);
}

void linearise(const Level& level, const State& state, const SolverParams& params, Rows rows, float* scratch) {
    if (rows.begin >= rows.end) return;
    const float step = 2.0f * params.data_weight * params.tau;
    const auto row_of = level.weight ? linearise_row<true> : linearise_row<false>;
    Descriptors descriptors(level, state.u, params.absolute, scratch);
    descriptors.start(rows.begin);
    for (int y = rows.begin; y < rows.end; ++y) {
        const long o = static_cast<long>(y) * level.width;
        const DataWeight weight{level.weight ? level.weight + o : nullptr, step};
        descriptors.describe(y);
        row_of(descriptors.left, descriptors.right, level.width, state.u + o, weight, state.a + o, state.b + o);
        for (int x = 0; x < level.width; ++x) state.u_bar[o + x] = state.u[o + x];
    }
}

// Below the last row the gradient is 0: `next` is then the row itself.
void dual_row(const float* u_bar, const float* next, int width, float sigma, float shrink, float* p_x, float* p_y) {
    const int last = width - 1;
#pragma GCC ivdep
    for (int x = 0; x < last; ++x)
        dual_step(u_bar[x + 1] - u_bar[x], next[x] - u_bar[x], sigma, shrink, p_x + x, p_y + x);
    dual_step(0.0f, next[last] - u_bar[last], sigma, shrink, p_x + last, p_y + last);
}

PIXEL_FN void primal_pixel(const State& row, int x, float divergence, float tau) {
    const float old = row.u[x];
    const float u = primal_step(old, divergence, tau, row.a[x], row.b[x]);
    row.u[x] = u;
    row.u_bar[x] = 2.0f * u - old;
}

// p is 0 before the first and on the last pixel of a row and a column, so far borders need no test.
void primal_row(const State& row, const float* p_y_above, int width, float tau) {
    primal_pixel(row, 0, row.p_x[0] + row.p_y[0] - p_y_above[0], tau);
#pragma GCC ivdep
    for (int x = 1; x < width; ++x)
        primal_pixel(row, x, row.p_x[x] - row.p_x[x - 1] + row.p_y[x] - p_y_above[x], tau);
}

void primal_top_row(const State& row, int width, float tau) {
    primal_pixel(row, 0, row.p_x[0] + row.p_y[0], tau);
#pragma GCC ivdep
    for (int x = 1; x < width; ++x) primal_pixel(row, x, row.p_x[x] - row.p_x[x - 1] + row.p_y[x], tau);
}

void iterate(const Level& level, const State& state, const SolverParams& params, int y) {
    const long o = static_cast<long>(y) * level.width;
    const State row{state.u + o, state.u_bar + o, state.p_x + o, state.p_y + o, state.a + o, state.b + o};
    const float* next = y + 1 < level.height ? row.u_bar + level.width : row.u_bar;
    const float shrink = 1.0f / (1.0f + params.sigma * params.huber_epsilon);
    dual_row(row.u_bar, next, level.width, params.sigma, shrink, row.p_x, row.p_y);
    if (y == 0) primal_top_row(row, level.width, params.tau);
    else primal_row(row, row.p_y - level.width, level.width, params.tau);
}

void distance(const Level& level, const float* u, bool absolute, float* out, Rows rows, float* scratch) {
    if (rows.begin >= rows.end) return;
    Descriptors descriptors(level, u, absolute, scratch);
    descriptors.start(rows.begin);
    for (int y = rows.begin; y < rows.end; ++y) {
        descriptors.describe(y);
        float* row = out + static_cast<long>(y) * level.width;
        for (int x = 0; x < level.width; ++x) {
            float square = 0.0f;
            for (int k = 0; k < kNeighbours; ++k) {
                const long at = static_cast<long>(k) * descriptors.stride() + x;
                const float difference = descriptors.right[at] - descriptors.left[at];
                square += difference * difference;
            }
            row[x] = sqrtf(square);
        }
    }
}

}  // namespace

extern const Sweeps SWEEPS = {linearise, iterate, distance};

}  // namespace stereomend
