// How fast this machine's memory and multipliers are: what the kernels are measured against.
#pragma once

namespace stereomend {

// Loops that nothing but the machine holds up, one table per instruction set.
struct CeilingLoops {
    // a[i] = b[i] + s * c[i] for i in [0, count); a is [out].
    void (*triad)(const float* b, const float* c, float s, float* a, long count);
    // Repeats x <- x * factor + summand, `rounds` times in each of `chains` independent chains that stay in
    // registers; returns a number that depends on all of them.
    float (*multiply_add)(float factor, float summand, long rounds);
    // Chains of multiply_add, vector lanes counted.
    int chains;
};

extern const CeilingLoops ceilings_v2;
extern const CeilingLoops ceilings_v3;
extern const CeilingLoops ceilings_generic;

// Memory traffic of the triad on arrays far larger than the caches [GB/s], best of several passes. 12 bytes count per
// element: what a processor reads of a line before it overwrites it does not. Throws std::bad_alloc.
double triad(int threads);

// Rate of float32 multiply-adds of all threads together [GFlop/s], best of several passes; each counts as two
// operations. Both throw std::system_error where the system gives fewer threads.
double multiply_add(int threads);

}  // namespace stereomend
