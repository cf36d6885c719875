// Disparities that are not known everywhere, at another size; and where those of a result come from.
//
// For resize_cpu.cpp alone, which is compiled once per instruction set: everything is local to it.
#pragma once

#include "resize_sweeps.hpp"

namespace stereomend {
namespace {

// From sums over what is known to means.
void divide_row(const float* share, int width, float ratio, float half, float* u, bool* valid) {
    uint8_t* flags = reinterpret_cast<uint8_t*>(valid);
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const bool known = share[x] >= half;
        u[x] = known ? u[x] / share[x] * ratio : 0.0f;
        flags[x] = known;
    }
}

void sample_row(const float* u, const bool* valid, const int* columns, int width, float ratio, float* out, bool* out_valid) {
    for (int x = 0; x < width; ++x) {
        out[x] = u[columns[x]] * ratio;
        out_valid[x] = valid[columns[x]];
    }
}

// Kinds of pixels as numbers that grow with what hides the rest.
enum Kind : uint8_t { kKept, kRefined, kFilled, kUnobserved };

// `out` [in/out]: which pixels the right image does not show, then the kinds.
void tell_row(const Origins& origins, const float* u, const int* columns, int row, int y, uint8_t* out, long counts[4]) {
    const int width = origins.to.width;
    const long o = static_cast<long>(y) * width;
    const float* initial = origins.initial + o;
    const uint8_t* valid = reinterpret_cast<const uint8_t*>(origins.valid + o);
    const uint8_t* scene = origins.scene ? reinterpret_cast<const uint8_t*>(origins.scene + o) : nullptr;
    const uint8_t* kept = reinterpret_cast<const uint8_t*>(origins.kept) + static_cast<long>(row) * origins.from.width;
    if (scene)
        for (int x = 0; x < width; ++x) out[x] |= scene[x] ^ 1;
    for (int x = 0; x < width; ++x) {
        const bool moved = fabsf(u[x] - initial[x]) > origins.within;
        const bool replaced = !(valid[x] & kept[columns[x]]);
        out[x] = out[x] ? kUnobserved : replaced ? kFilled : moved ? kRefined : kKept;
    }
    unsigned sums[4] = {};
    for (int x = 0; x < width; ++x) {
        sums[kRefined] += out[x] == kRefined;
        sums[kFilled] += out[x] == kFilled;
        sums[kUnobserved] += out[x] == kUnobserved;
    }
    sums[kKept] = width - sums[kRefined] - sums[kFilled] - sums[kUnobserved];
    for (int kind = 0; kind < 4; ++kind) counts[kind] = sums[kind];
}

}  // namespace
}  // namespace stereomend
