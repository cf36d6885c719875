// The steps of LDR on the CPU. All planes are row-major (height, width).
#pragma once

namespace stereomend {

struct Size {
    int width;
    int height;
};

struct ConfidenceParams {
    int window;              // side of the window of the local mean, odd [px]
    float smoothness_weight;   // alpha_s [1]
    int smoothness_power;      // exponent of C_s [1]
    float photometric_weight;  // alpha_p [1]
};

struct ConfidenceInput {
    Size size;
    const float* left;   // grey levels, 0 to 255
    const float* right;
    const float* u;      // disparity [px]
    const bool* valid;   // u is known
    const bool* matte;   // no specular highlight
};

// C_f = M_b M_s C_p C_s^power, in [0, 1], 0 where u is unknown (Eq. 1 to 4) [out].
void confidence(const ConfidenceInput& input, const ConfidenceParams& params, float* out, int threads);

// Replaces u where it is not known by the median of the first known values met along eight directions within
// `steps` steps; repeats up to `passes` times, then takes the nearest known value (of equally near ones the
// leftmost, then the upper). With nothing known, u stays as it is. u and known are [in/out].
void fill(Size size, float* u, bool* known, int steps, int passes, int threads);

}  // namespace stereomend
