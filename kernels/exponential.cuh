// exp2 and log2 of float32 as polynomials that the compiler vectorises: neither a call nor a table.
#pragma once

#include "pixel.cuh"

#ifndef __CUDACC_RTC__
#include <string.h>
#endif

namespace stereomend {

constexpr float kLog2E = 1.44269504f;

PIXEL_FN float float_of(int bits) {
    float value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

PIXEL_FN int bits_of(float value) {
    int bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

// 2^x, x from -126 to 126, what is beyond as its nearest end; relative error below 2e-7.
PIXEL_FN float fast_exp2(float x) {
    const float safe = smaller(larger(x, -126.0f), 126.0f);
    const float whole = floorf(safe + 0.5f);
    const float f = safe - whole;
    // Of 2^f on [-0.5, 0.5], with the least relative error.
    float p = 1.5353354e-4f;
    p = p * f + 1.3398914e-3f;
    p = p * f + 9.6184378e-3f;
    p = p * f + 5.5503324e-2f;
    p = p * f + 2.4022648e-1f;
    p = p * f + 6.9314720e-1f;
    p = p * f + 1.0f;
    return p * float_of((static_cast<int>(whole) + 127) << 23);
}

// log2(x) of a normal x over 0; error below 2e-7 or so much of the result, whichever is more.
PIXEL_FN float fast_log2(float x) {
    // The power of two that leaves sqrt(1/2) to sqrt(2).
    const int power = (bits_of(x) - 0x3f3504f3) >> 23;
    const float m = float_of(bits_of(x) - power * (1 << 23));
    const float s = (m - 1.0f) / (m + 1.0f);
    const float t = s * s;
    // 2 / ln(2) times the series of artanh.
    float p = 0.32059889f;
    p = p * t + 0.41219858f;
    p = p * t + 0.57707802f;
    p = p * t + 0.96179669f;
    p = p * t + 2.88539008f;
    return static_cast<float>(power) + p * s;
}

constexpr float kLeast = 1e-37f;  // squares up to here are 0, which has no logarithm

// w (R4), over 0 to 1, from the squared gradient in units of the level at which it is 1 / e.
PIXEL_FN float edge_weight(float square, float power, float floor) {
    const float gradient = fast_exp2(0.5f * power * fast_log2(larger(square, kLeast)));
    return larger(fast_exp2(-kLog2E * gradient), square > kLeast ? floor : 1.0f);
}

}  // namespace stereomend
