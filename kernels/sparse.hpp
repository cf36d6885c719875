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

void count_kinds(const uint8_t* kinds, int width, long counts[4]) {
    for (int kind = 0; kind < 4; ++kind) {
        unsigned count = 0;
        for (int x = 0; x < width; ++x) count += kinds[x] == kind;
        counts[kind] = count;
    }
}

// `out` [in/out]: which pixels the right image does not show, then the kinds; scratch: 2 * width bytes.
void tell_row(const Origins& origins, const float* u, const int* columns, int row, int y, uint8_t* scratch, uint8_t* out,
              long counts[4]) {
    const int width = origins.to.width;
    const long o = static_cast<long>(y) * width;
    const float* initial = origins.initial + o;
    const uint8_t* valid = reinterpret_cast<const uint8_t*>(origins.valid + o);
    const uint8_t* kept = reinterpret_cast<const uint8_t*>(origins.kept) + static_cast<long>(row) * origins.from.width;
    const float within = origins.within;
    uint8_t* moved = scratch;
    uint8_t* stayed = scratch + width;
    for (int x = 0; x < width; ++x) stayed[x] = kept[columns[x]];
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) moved[x] = static_cast<uint8_t>(fabsf(u[x] - initial[x]) > within ? 1 : 0);
    if (origins.scene) {
        const uint8_t* scene = reinterpret_cast<const uint8_t*>(origins.scene + o);
        for (int x = 0; x < width; ++x) out[x] |= scene[x] ^ 1;
    }
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        // Read whatever comes of it, or the loop would branch.
        const uint8_t refined = moved[x];
        const uint8_t hidden = out[x];
        const uint8_t seen = stayed[x] & valid[x] ? refined : static_cast<uint8_t>(kFilled);
        out[x] = hidden ? static_cast<uint8_t>(kUnobserved) : seen;
    }
    count_kinds(out, width, counts);
}

}  // namespace
}  // namespace stereomend
