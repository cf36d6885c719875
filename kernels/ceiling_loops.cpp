// The loops of the ceilings, compiled once per instruction set.
//
// As in gdr_cpu.cpp, everything but the table is local to the file.
#include "ceilings.hpp"

namespace stereomend {
namespace {

void triad(const float* b, const float* c, float s, float* a, long count) {
#pragma GCC ivdep
    for (long i = 0; i < count; ++i) a[i] = b[i] + s * c[i];
}

#ifdef __AVX__
constexpr int kVectorBytes = 32;
#else
constexpr int kVectorBytes = 16;
#endif
typedef float Lanes __attribute__((vector_size(kVectorBytes)));

constexpr int kLanes = kVectorBytes / sizeof(float);
// Two multiply-adds start per cycle and take four or five, so ten must be under way; 16 registers hold 12 and both
// constants.
constexpr int kVectors = 12;

float multiply_add(float factor, float summand, long rounds) {
    Lanes chains[kVectors];
    for (int v = 0; v < kVectors; ++v)
        for (int lane = 0; lane < kLanes; ++lane) chains[v][lane] = static_cast<float>(v * kLanes + lane);
    const Lanes factors = factor - Lanes{};
    const Lanes summands = summand - Lanes{};
    for (long round = 0; round < rounds; ++round) {
#pragma GCC unroll 12
        for (int v = 0; v < kVectors; ++v) chains[v] = chains[v] * factors + summands;
    }
    float sum = 0.0f;
    for (int v = 0; v < kVectors; ++v)
        for (int lane = 0; lane < kLanes; ++lane) sum += chains[v][lane];
    return sum;
}

}  // namespace

extern const CeilingLoops CEILINGS = {triad, multiply_add, kVectors * kLanes};

}  // namespace stereomend
