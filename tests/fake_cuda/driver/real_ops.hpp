// Operations on float and double. Approximations of the hardware are computed as exactly as this machine can.
#pragma once

#include <cmath>

namespace fake {

struct RealAdd {
    template <class T>
    static T of(T a, T b) {
        return a + b;
    }
};
struct RealSub {
    template <class T>
    static T of(T a, T b) {
        return a - b;
    }
};
struct RealMul {
    template <class T>
    static T of(T a, T b) {
        return a * b;
    }
};
struct RealDiv {
    template <class T>
    static T of(T a, T b) {
        return a / b;
    }
};
struct RealFma {
    static float of(float a, float b, float c) { return __builtin_fmaf(a, b, c); }
    static double of(double a, double b, double c) { return __builtin_fma(a, b, c); }
};

// A number wins against NaN, and -0 is less than 0.
struct RealMin {
    template <class T>
    static T of(T a, T b) {
        const T less = a < b || (a == b && std::signbit(a)) ? a : b;
        return b != b ? a : less;
    }
};
struct RealMax {
    template <class T>
    static T of(T a, T b) {
        const T more = a > b || (a == b && !std::signbit(a)) ? a : b;
        return b != b ? a : more;
    }
};
struct RealAbs {
    template <class T>
    static T of(T a) {
        return std::fabs(a);
    }
};
struct RealNeg {
    template <class T>
    static T of(T a) {
        return -a;
    }
};
// The magnitude of b, the sign of a.
struct RealCopysign {
    template <class T>
    static T of(T a, T b) {
        return std::copysign(b, a);
    }
};
struct RealSqrt {
    template <class T>
    static T of(T a) {
        return std::sqrt(a);
    }
};
struct RealRcp {
    template <class T>
    static T of(T a) {
        return T{1} / a;
    }
};
struct RealRsqrt {
    template <class T>
    static T of(T a) {
        return static_cast<T>(1.0 / std::sqrt(static_cast<double>(a)));
    }
};
struct RealEx2 {
    template <class T>
    static T of(T a) {
        return static_cast<T>(std::exp2(static_cast<double>(a)));
    }
};
struct RealLg2 {
    template <class T>
    static T of(T a) {
        return static_cast<T>(std::log2(static_cast<double>(a)));
    }
};
struct RealSin {
    template <class T>
    static T of(T a) {
        return static_cast<T>(std::sin(static_cast<double>(a)));
    }
};
struct RealCos {
    template <class T>
    static T of(T a) {
        return static_cast<T>(std::cos(static_cast<double>(a)));
    }
};
struct RealTanh {
    template <class T>
    static T of(T a) {
        return static_cast<T>(std::tanh(static_cast<double>(a)));
    }
};

}  // namespace fake
