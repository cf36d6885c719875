// Primal-dual iterations (Eq. 12 to 14, R3, R4), several per launch.
#pragma once

#include "gdr_device.cuh"

namespace stereomend {

// A block holds kTile x kTile pixels: a thread a strip of kStrip rows of one column in its registers, and what other
// threads read of it in shared memory.
constexpr int kTile = 64;
constexpr int kStrip = 8;
constexpr int kStrips = kTile / kStrip;

struct Fused {
    const float* u;      // [in, px]
    const float* u_bar;  // [in, px]; null: u
    const float* p_x;    // [in]; null: 0, and p_y likewise
    const float* p_y;
    float* u_out;      // [out], other planes than those read: neighbouring blocks still read those
    float* u_bar_out;  // [out]; null: nobody needs it
    float* p_x_out;
    float* p_y_out;
    const float* a;      // [in] 1 / (1 + 2 lambda tau A)
    const float* b;      // [in] 2 lambda tau B
    const float* edge;   // [in] weight of the smoothness; null: 1
    const float* prior;  // [in, px]; null for none
    const float* trust;  // [in] weight of |u - prior|; null exactly if prior is
    int width;
    int height;
    int iterations;  // of this launch; as many pixels around the block are read besides
    float tau;
    float sigma;
    float soft;  // sigma epsilon
};

// What is read of other threads.
struct Published {
    float* u_bar;  // kTile x kTile
    float* p_x;    // kTile x kTile
    float* p_y;    // the last row of each strip, kStrips x kTile
};

struct Column {
    float u[kStrip];
    float u_bar[kStrip];
    float p_x[kStrip];
    float p_y[kStrip];
    float a[kStrip];
    float b[kStrip];
};

struct Guidance {
    float edge[kStrip];
    float shrink[kStrip];
    float prior[kStrip];
    float threshold[kStrip];
};

// Where a thread stands: in the image, and in the tile.
struct Stand {
    int x;
    int y;     // of its first row
    int rows;  // of its strip that lie in the image
    int column;
    int row;
    bool left_end;  // of image or tile
    bool right_end;
};

// Each iteration looks one pixel further in every direction: so many at the rim of a tile are read but not written.
DEVICE_FN int halo_of(const Fused& in) { return in.iterations; }

// Tiles overlap by two halos; the first begins at the image's own border, where nothing is cut.
DEVICE_FN Stand stand_of(const Fused& in) {
    const int stride = kTile - 2 * halo_of(in);
    Stand at;
    at.column = threadIdx.x;
    at.row = threadIdx.y * kStrip;
    at.x = blockIdx.x * stride + at.column;
    at.y = blockIdx.y * stride + at.row;
    const int below = in.height - at.y;
    at.rows = at.x < in.width ? (below < 0 ? 0 : (below < kStrip ? below : kStrip)) : 0;
    at.left_end = at.column == 0;
    at.right_end = at.x + 1 >= in.width || at.column + 1 >= kTile;
    return at;
}

template <bool Guided>
DEVICE_FN void load_column(const Fused& in, const Stand& at, Column& own, Guidance& guide, const Published& shared) {
#pragma unroll
    for (int r = 0; r < kStrip; ++r) {
        if (r >= at.rows) continue;
        const long i = static_cast<long>(at.y + r) * in.width + at.x;
        own.u[r] = in.u[i];
        own.u_bar[r] = in.u_bar ? in.u_bar[i] : own.u[r];
        own.p_x[r] = in.p_x ? in.p_x[i] : 0.0f;
        own.p_y[r] = in.p_x ? in.p_y[i] : 0.0f;
        own.a[r] = in.a[i];
        own.b[r] = in.b[i];
        shared.u_bar[(at.row + r) * kTile + at.column] = own.u_bar[r];
        if (!Guided) continue;
        guide.edge[r] = in.edge ? in.edge[i] : 1.0f;
        guide.shrink[r] = guide.edge[r] / (guide.edge[r] + in.soft);
        guide.prior[r] = in.prior ? in.prior[i] : 0.0f;
        guide.threshold[r] = in.prior ? in.tau * in.trust[i] * own.a[r] : 0.0f;
    }
}

// Beyond the last row of the strip: of the strip below, if image and tile go on.
DEVICE_FN float u_bar_below(const Fused& in, const Stand& at, const Column& own, const Published& shared) {
    const bool end = at.y + kStrip >= in.height || at.row + kStrip >= kTile;
    return end ? own.u_bar[kStrip - 1] : shared.u_bar[(at.row + kStrip) * kTile + at.column];
}

template <bool Guided>
DEVICE_FN void dual_strip(const Fused& in, const Stand& at, Column& own, const Guidance& guide,
                          const Published& shared) {
    const float shrink = 1.0f / (1.0f + in.soft);
#pragma unroll
    for (int r = 0; r < kStrip; ++r) {
        if (r >= at.rows) continue;
        const int i = (at.row + r) * kTile + at.column;
        const float along = at.right_end ? 0.0f : shared.u_bar[i + 1] - own.u_bar[r];
        const float next = r + 1 < kStrip ? (r + 1 < at.rows ? own.u_bar[(r + 1) % kStrip] : own.u_bar[r])
                                          : u_bar_below(in, at, own, shared);
        const float down = next - own.u_bar[r];
        if (Guided)
            weighted_dual_step(along, down, in.sigma, guide.shrink[r], guide.edge[r], own.p_x + r, own.p_y + r);
        else
            dual_step(along, down, in.sigma, shrink, own.p_x + r, own.p_y + r);
        shared.p_x[i] = own.p_x[r];
    }
    if (at.rows == kStrip) shared.p_y[threadIdx.y * kTile + at.column] = own.p_y[kStrip - 1];
}

template <bool Guided>
DEVICE_FN void primal_strip(const Fused& in, const Stand& at, Column& own, const Guidance& guide,
                            const Published& shared) {
#pragma unroll
    for (int r = 0; r < kStrip; ++r) {
        if (r >= at.rows) continue;
        const int i = (at.row + r) * kTile + at.column;
        const float left = at.left_end ? 0.0f : shared.p_x[i - 1];
        const float above = r > 0 ? own.p_y[(r + kStrip - 1) % kStrip]
                                  : (at.row > 0 ? shared.p_y[(threadIdx.y - 1) * kTile + at.column] : 0.0f);
        const float divergence = own.p_x[r] - left + own.p_y[r] - above;
        const float old = own.u[r];
        float u = primal_step(old, divergence, in.tau, own.a[r], own.b[r]);
        if (Guided) u = towards(u, guide.prior[r], guide.threshold[r]);
        own.u[r] = u;
        own.u_bar[r] = 2.0f * u - old;
        shared.u_bar[i] = own.u_bar[r];
    }
}

// What no iteration has reached from beyond the tile.
DEVICE_FN void store_column(const Fused& in, const Stand& at, const Column& own) {
    const int halo = halo_of(in);
    const int x = at.x - at.column;
    const int y = at.y - at.row;
    if ((x > 0 && at.column < halo) || (x + kTile < in.width && at.column >= kTile - halo)) return;
#pragma unroll
    for (int r = 0; r < kStrip; ++r) {
        const int row = at.row + r;
        if (r >= at.rows || (y > 0 && row < halo) || (y + kTile < in.height && row >= kTile - halo)) continue;
        const long i = static_cast<long>(at.y + r) * in.width + at.x;
        in.u_out[i] = own.u[r];
        if (in.u_bar_out) in.u_bar_out[i] = own.u_bar[r];
        in.p_x_out[i] = own.p_x[r];
        in.p_y_out[i] = own.p_y[r];
    }
}

template <bool Guided>
DEVICE_FN void iterate_tile(const Fused& in) {
    __shared__ float u_bar[kTile * kTile];
    __shared__ float p_x[kTile * kTile];
    __shared__ float p_y[kTile * kStrips];
    const Published shared{u_bar, p_x, p_y};
    const Stand at = stand_of(in);
    Column own;
    Guidance guide;
    load_column<Guided>(in, at, own, guide, shared);
    __syncthreads();
    for (int iteration = 0; iteration < in.iterations; ++iteration) {
        dual_strip<Guided>(in, at, own, guide, shared);
        __syncthreads();
        primal_strip<Guided>(in, at, own, guide, shared);
        __syncthreads();
    }
    store_column(in, at, own);
}

// Some iterations without edge weights and prior. Blocks of kTile x kStrips threads.
KERNEL __launch_bounds__(kTile* kStrips) iterate(Fused in) { iterate_tile<false>(in); }

// The same with either or both; threads as `iterate`.
KERNEL __launch_bounds__(kTile* kStrips) iterate_guided(Fused in) { iterate_tile<true>(in); }

}  // namespace stereomend
