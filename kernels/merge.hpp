// The upload and GDR's map put together at input size.
//
// For resize_cpu.cpp alone, which is compiled once per instruction set: everything is local to it.
#pragma once

#include "area.hpp"

namespace stereomend {
namespace {

constexpr float kBeyond = 1e9f;  // any disparity [px]

// Two rows at their new width, linear between the centres of their pixels.
void widen_rows(const float* first, const float* second, const Places& columns, int width, float* out, float* out_second) {
    for (int x = 0; x < width; ++x) {
        const int before = columns.before[x];
        const int after = columns.after[x];
        const float fraction = columns.fraction[x];
        out[x] = multiply_add(fraction, first[after] - first[before], first[before]);
        out_second[x] = multiply_add(fraction, second[after] - second[before], second[before]);
    }
}

// The rows of both maps as far as a band has come.
class Merging {
public:
    Merging(const Offer& offer, const Places& columns, const Places& rows, float* scratch)
        : offer_(offer), columns_(columns), rows_(rows), width_(offer.to.width), u_(scratch), share_(u_ + 2L * width_),
          least_(share_ + 2L * width_), most_(least_ + width_), judged_(most_ + width_),
          lowest_(judged_ + width_ + 1), highest_(lowest_ + offer.from.width + 2), fitting_(highest_ + offer.from.width + 1) {}

    void run(Rows band, float* out) {
        for (int y = band.begin; y < band.end; ++y) {
            widen(rows_.before[y]);
            widen(rows_.after[y]);
            if (y == band.begin || rows_.nearest[y] != rows_.nearest[y - 1]) judge(rows_.nearest[y]);
            blend(y, out + static_cast<long>(y) * width_);
        }
    }

private:
    // Neighbouring rows are different in their last bit.
    float* row(float* rows, int y) const { return rows + (y & 1) * static_cast<long>(width_); }

    void widen(int y) {
        if (held_[y & 1] == y) return;
        held_[y & 1] = y;
        const long o = static_cast<long>(y) * offer_.from.width;
        widen_rows(offer_.u + o, offer_.share + o, columns_, width_, row(u_, y), row(share_, y));
    }

    // Least and most of the chosen samples in the column of three around each pixel of row y.
    void range(int y) {
        const int width = offer_.from.width;
        const int above = y > 0 ? y - 1 : y;
        const int below = y + 1 < offer_.from.height ? y + 1 : y;
        const float half = offer_.half;
        float* lowest = lowest_;
        float* highest = highest_;
        for (int row = above; row <= below; ++row) {
            const float* share = offer_.share + static_cast<long>(row) * width;
            const float* sample = offer_.sample + static_cast<long>(row) * width;
            const bool first = row == above;
#pragma GCC ivdep
            for (int x = 0; x < width; ++x) {
                const bool chosen = share[x] > half;
                lowest[x] = smaller(chosen ? sample[x] : kBeyond, first ? kBeyond : lowest[x]);
                highest[x] = larger(chosen ? sample[x] : -kBeyond, first ? -kBeyond : highest[x]);
            }
        }
        lowest[-1] = lowest[width] = kBeyond;
        highest[-1] = highest[width] = -kBeyond;
    }

    // What row y of the samples says, in pixels of the input: what fits them, and what stands where nothing does.
    void weigh(int y) {
        range(y);
        const int width = offer_.from.width;
        const float* share = offer_.share + static_cast<long>(y) * width;
        const float* sample = offer_.sample + static_cast<long>(y) * width;
        const float* lowest = lowest_;
        const float* highest = highest_;
        float* least = fitting_;
        float* most = least + width;
        float* chosen = most + width;
        const float half = offer_.half;
        const float ratio = offer_.ratio;
#pragma GCC ivdep
        for (int x = 0; x < width; ++x) {
            least[x] = smaller(smaller(lowest[x - 1], lowest[x]), lowest[x + 1]) * ratio - 1.0f;
            most[x] = larger(larger(highest[x - 1], highest[x]), highest[x + 1]) * ratio + 1.0f;
            chosen[x] = share[x] > half ? sample[x] * ratio : kBeyond;
        }
    }

    // The same at input width.
    void judge(int y) {
        weigh(y);
        const float* least = fitting_;
        const float* most = least + offer_.from.width;
        const float* chosen = most + offer_.from.width;
        for (int x = 0; x < width_; ++x) {
            const int at = columns_.nearest[x];
            least_[x] = least[at];
            most_[x] = most[at];
            judged_[x] = chosen[at];
        }
    }

    void blend(int y, float* out) {
        const long o = static_cast<long>(y) * width_;
        const float* u[2] = {row(u_, rows_.before[y]), row(u_, rows_.after[y])};
        const float* share[2] = {row(share_, rows_.before[y]), row(share_, rows_.after[y])};
        const float* upload = offer_.upload + o;
        const uint8_t* valid = reinterpret_cast<const uint8_t*>(offer_.valid + o);
        const float* least = least_;
        const float* most = most_;
        const float* judged = judged_;
        const float fraction = rows_.fraction[y];
        const float ratio = offer_.ratio;
        const float near = offer_.near;
        const float half = offer_.half;
#pragma GCC ivdep
        for (int x = 0; x < width_; ++x) {
            const float own = multiply_add(fraction, u[1][x] - u[0][x], u[0][x]) * ratio;
            const float part = multiply_add(fraction, share[1][x] - share[0][x], share[0][x]);
            const float other = judged[x] < kBeyond ? judged[x] : own;
            const bool fits = (upload[x] >= least[x]) & (upload[x] <= most[x]);
            const float chosen = fits ? upload[x] : other;
            const float hard = part > half ? chosen : own;
            const float blended = part * upload[x] + (1.0f - part) * own;
            const float known = fabsf(upload[x] - own) < near ? blended : hard;
            out[x] = larger(valid[x] ? known : own, 0.0f);
        }
    }

    const Offer& offer_;
    const Places& columns_;
    const Places& rows_;
    const int width_;
    float* const u_;      // two rows at input width each
    float* const share_;
    float* const least_;  // and one
    float* const most_;
    float* const judged_;
    float* const lowest_;  // of a row at working size, with room on both sides
    float* const highest_;
    float* const fitting_;  // three rows at working size
    int held_[2] = {-1, -1};
};

void merge(const Offer& offer, const Places& columns, const Places& rows, Rows band, float* scratch, float* out) {
    if (band.begin < band.end) Merging(offer, columns, rows, scratch).run(band, out);
}

}  // namespace
}  // namespace stereomend
