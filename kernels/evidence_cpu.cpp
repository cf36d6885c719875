// Evidence, confidence, patches and edges (R1, R4) as row loops that the compiler vectorises.
//
// Compiled once per instruction set, like gdr_cpu.cpp: everything but the table is local to the file.
#include "descriptors.hpp"
#include "evidence_sweeps.hpp"
#include "exponential.cuh"
#include "flags.hpp"
#include "halves.hpp"
#include "median.cuh"
#include "patches.hpp"
#include "windows.hpp"

namespace stereomend {
namespace {


template <class Row>
struct Three {
    Row above;
    Row centre;
    Row below;
};

// Without ever storing a descriptor: to describe the left image again for a second map takes less than that.
void similarity_row(const Three<const float*>& left, const Three<GreyRow>& right, int width, float* out) {
    const Three<const float*> own = left;
    const Three<GreyRow> other = right;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        float v[kNeighbours];
        float w[kNeighbours];
        differences(own.above, own.centre, own.below, x, v);
        differences(other.above, other.centre, other.below, x, w);
        out[x] = similarity_of(v, w);
    }
}

void sum_row(float* row, int width, float* out) {
    extend(row, width, true);
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) out[x] = row[x - 2] + row[x - 1] + row[x] + row[x + 1] + row[x + 2];
}

// The rows of both images, the similarity and its sums along rows, as far as a band has come.
class Evidence {
public:
    Evidence(const Pair& pair, const Maps& maps, float* scratch)
        : pair_(pair), size_(pair.size), maps_(maps), stride_(size_.width + 2 * kAround), scratch_(scratch) {}

    // n of some rows.
    void run(Rows rows) {
        loaded_ = summed_ = rows.begin > kAround ? rows.begin - kAround : 0;
        if (loaded_ > 0) load(loaded_ - 1);
        load(loaded_++);
        for (int y = rows.begin; y < rows.end; ++y) {
            while (summed_ <= y + kAround && summed_ < size_.height) sum(summed_++);
            for (int k = 0; k < maps_.count; ++k) mean(k, y);
        }
    }

private:
    float* memory(int row) const { return scratch_ + static_cast<size_t>(row) * stride_; }
    int of_map(int k) const { return 5 + k * (7 + kSide); }
    RowRing left() const { return {memory(0), size_.width}; }
    RowRing base(int k) const { return {memory(of_map(k)), size_.width}; }
    RowRing rest(int k) const { return {memory(of_map(k) + 3), size_.width}; }
    float* similar(int k) const { return memory(of_map(k) + 6) + kAround; }
    float* sums(int k, int y) const { return memory(of_map(k) + 7 + y % kSide); }
    GreyRow grey(int k, int y) const { return {base(k).row(y), rest(k).row(y)}; }

    void load(int y) {
        const int width = size_.width;
        const long o = static_cast<long>(y) * width;
        float* own = left().row(y);
        memcpy(own, pair_.left + o, sizeof(float) * width);
        left().pad(y);
        float* right = memory(4) + kAround;
        memcpy(right, pair_.right + o, sizeof(float) * width);
        extend(right, width, true);
        int* places = reinterpret_cast<int*>(memory(3));
        for (int k = 0; k < maps_.count; ++k) {
            const float* u = maps_.u[k] + o;
            warp_row(right, u, width, places, base(k).row(y), rest(k).row(y));
            base(k).pad(y);
            rest(k).pad(y);
        }
    }

    void sum(int y) {
        const int above = y > 0 ? y - 1 : 0;
        const int below = y + 1 < size_.height ? y + 1 : y;
        while (loaded_ <= below) load(loaded_++);
        const Three<const float*> own{left().row(above), left().row(y), left().row(below)};
        for (int k = 0; k < maps_.count; ++k) {
            similarity_row(own, {grey(k, above), grey(k, y), grey(k, below)}, size_.width, similar(k));
            sum_row(similar(k), size_.width, sums(k, y));
        }
    }

    // Always the same additions, wherever a band begins.
    void mean(int k, int y) {
        const float* s[kSide];
        for (int i = 0; i < kSide; ++i) s[i] = sums(k, mirrored(y + i - kAround, size_.height));
        float* out = maps_.found[k] + static_cast<long>(y) * size_.width;
        constexpr float kShare = 1.0f / (kSide * kSide);
#pragma GCC ivdep
        for (int x = 0; x < size_.width; ++x) out[x] = kShare * (s[0][x] + s[1][x] + s[2][x] + s[3][x] + s[4][x]);
    }

    const Pair& pair_;
    const Size size_;
    const Maps& maps_;
    const long stride_;
    float* const scratch_;
    int loaded_ = 0;
    int summed_ = 0;
};

void evidence(const Pair& pair, const Maps& maps, Rows rows, float* scratch) {
    if (rows.begin < rows.end) Evidence(pair, maps, scratch).run(rows);
}

// The columns of the windows of row y, each sorted: rank by rank, with room on both sides; borders repeated.
void sort_columns(const ConfidenceInput& in, int y, float* const sorted[kSide]) {
    const float* rows[kSide];
    for (int i = 0; i < kSide; ++i) {
        const int row = y + i - kAround < in.size.height ? y + i - kAround : in.size.height - 1;
        rows[i] = in.u + static_cast<long>(row > 0 ? row : 0) * in.size.width;
    }
    float* out[kSide] = {sorted[0], sorted[1], sorted[2], sorted[3], sorted[4]};
#pragma GCC ivdep
    for (int x = 0; x < in.size.width; ++x) {
        float v[kSide] = {rows[0][x], rows[1][x], rows[2][x], rows[3][x], rows[4][x]};
        sort5(v);
        for (int i = 0; i < kSide; ++i) out[i][x] = v[i];
    }
    for (int i = 0; i < kSide; ++i) extend(out[i], in.size.width, false);
}

void trust(const ConfidenceInput& in, const TrustParams& params, int y, const bool* hidden, float* scratch,
           float* row) {
    const int width = in.size.width;
    const long o = static_cast<long>(y) * width;
    const float* u = in.u + o;
    float* s[kSide];
    for (int i = 0; i < kSide; ++i) s[i] = scratch + i * static_cast<long>(width + 2 * kAround) + kAround;
    sort_columns(in, y, s);
    const float slope = slope_of(params.least, params.full);
    const float least = params.least;
    const float smallest = params.smallest;
    const float* ranks[kSide] = {s[0] - kAround, s[1] - kAround, s[2] - kAround, s[3] - kAround, s[4] - kAround};
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        float v[kSide][kSide];
        for (int i = 0; i < kSide; ++i)
            for (int k = 0; k < kSide; ++k) v[i][k] = ranks[i][x + k];
        const float jump = fabsf(u[x] - median25(v));
        const float value = ramp(row[x], least, slope) * fast_exp2(-kLog2E * jump);
        row[x] = u[x] > smallest ? value : 0.0f;
    }
    const uint8_t* valid = bytes_of(in.valid + o);
    const uint8_t* matte = bytes_of(in.matte + o);
    const uint8_t* unseen = bytes_of(hidden);
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) row[x] *= static_cast<float>(valid[x] & matte[x] & (1 - unseen[x]));
}

// The largest squared forward difference of the channels; 0 beyond the last row and column.
template <int Count>
PIXEL_FN float steepest(const float* const* here, const float* const* below, int x, int next) {
    float most = 0.0f;
    for (int k = 0; k < Count; ++k) {
        const float along = here[k][next] - here[k][x];
        const float down = below[k][x] - here[k][x];
        most = larger(most, along * along + down * down);
    }
    return most;
}

template <int Count>
void edge_row_of(const Channels& in, const EdgeParams& params, int y, float* out) {
    const int width = in.size.width;
    const float* here[Count];
    const float* below[Count];
    for (int k = 0; k < Count; ++k) {
        here[k] = in.levels[k] + static_cast<long>(y) * width;
        below[k] = y + 1 < in.size.height ? here[k] + width : here[k];
    }
    const float power = params.power;
    const float scale = 1.0f / (params.level * params.level);
    const float floor = params.floor;
    const auto weigh = [&](int x, int next) {
        out[x] = edge_weight(steepest<Count>(here, below, x, next) * scale, power, floor);
    };
#pragma GCC ivdep
    for (int x = 0; x < width - 1; ++x) weigh(x, x + 1);
    weigh(width - 1, width - 1);
}

void edge_row(const Channels& in, const EdgeParams& params, int y, float* out) {
    if (in.count == 1) edge_row_of<1>(in, params, y, out);
    else if (in.count == 2) edge_row_of<2>(in, params, y, out);
    else edge_row_of<3>(in, params, y, out);
}

template <int Count>
void glint_row_of(const Channels& in, const GlintRule& rule, int y, uint8_t* glints, uint8_t* nearly) {
    const float* row[Count];
    for (int k = 0; k < Count; ++k) row[k] = in.levels[k] + static_cast<long>(y) * in.size.width;
    const float saturation = rule.saturation;
    const float bright = rule.bright;
    const float almost = rule.nearly;
    const int width = in.size.width;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        float most = row[0][x];
        float least = row[0][x];
        for (int k = 1; k < Count; ++k) {
            most = larger(most, row[k][x]);
            least = smaller(least, row[k][x]);
        }
        // As numbers, for comparisons of bools are not vectorised.
        const int colourless = most - least < saturation * most ? 1 : 0;
        glints[x] = static_cast<uint8_t>(colourless & (most > bright ? 1 : 0));
        nearly[x] = static_cast<uint8_t>(most > almost ? 1 : 0);
    }
}

void glint_row(const Channels& in, const GlintRule& rule, int y, bool* glints, bool* nearly) {
    uint8_t* out = reinterpret_cast<uint8_t*>(glints);
    uint8_t* out_nearly = reinterpret_cast<uint8_t*>(nearly);
    if (in.count == 1) glint_row_of<1>(in, rule, y, out, out_nearly);
    else if (in.count == 2) glint_row_of<2>(in, rule, y, out, out_nearly);
    else glint_row_of<3>(in, rule, y, out, out_nearly);
}

void better_row(const float* u, const float* n, const float* other, const float* other_n, const bool* hidden, int width,
                const ReuseRule& rule, float* out) {
    const uint8_t* unseen = bytes_of(hidden);
    const float margin = rule.margin;
    const float least = rule.least;
    const float apart = rule.apart;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const float needed = unseen[x] ? kNone : larger(n[x] + margin, least);
        const bool taken = (fabsf(other[x] - u[x]) > apart) & (other_n[x] > needed);
        out[x] = taken ? other[x] : u[x];
    }
}

}  // namespace

extern const EvidenceSweeps EVIDENCE_SWEEPS = {evidence,   trust,     label, join, flag_small, edge_row,
                                              glint_row,  better_row, halve_row, halve_weighed_row};

}  // namespace stereomend
