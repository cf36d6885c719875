// Directed roundings, subnormals taken as zero, results clamped to [0, 1]. Compiled with -frounding-math.
#include <cfenv>

#include "lanes.hpp"
#include "real_ops.hpp"

namespace fake {
namespace {

class RoundingScope {
   public:
    explicit RoundingScope(Rounding rounding) {
        constexpr int modes[] = {FE_TONEAREST, FE_TOWARDZERO, FE_DOWNWARD, FE_UPWARD};
        std::fesetround(modes[static_cast<size_t>(rounding)]);
    }
    ~RoundingScope() { std::fesetround(FE_TONEAREST); }
};

template <class T>
T flushed(const Instruction& i, T a) {
    return i.flushes && std::fpclassify(a) == FP_SUBNORMAL ? std::copysign(T{0}, a) : a;
}

template <class T>
T finished(const Instruction& i, T a) {
    a = flushed(i, a);
    if (!i.saturates) return a;
    return !(a > T{0}) ? T{0} : (a < T{1} ? a : T{1});
}

template <class Op, class T>
void run1(Warp& w, const Instruction& i, uint32_t mask) {
    const RoundingScope scope(i.rounding);
    for (uint32_t m = mask; m; m &= m - 1) {
        const int t = __builtin_ctz(m);
        w.lanes<T>(i.r[0])[t] = finished(i, Op::of(flushed(i, w.lanes<T>(i.r[1])[t])));
    }
}

template <class Op, class T>
void run2(Warp& w, const Instruction& i, uint32_t mask) {
    const RoundingScope scope(i.rounding);
    for (uint32_t m = mask; m; m &= m - 1) {
        const int t = __builtin_ctz(m);
        w.lanes<T>(i.r[0])[t] =
            finished(i, Op::of(flushed(i, w.lanes<T>(i.r[1])[t]), flushed(i, w.lanes<T>(i.r[2])[t])));
    }
}

template <class T>
void run_fma(Warp& w, const Instruction& i, uint32_t mask) {
    const RoundingScope scope(i.rounding);
    for (uint32_t m = mask; m; m &= m - 1) {
        const int t = __builtin_ctz(m);
        w.lanes<T>(i.r[0])[t] =
            finished(i, RealFma::of(flushed(i, w.lanes<T>(i.r[1])[t]), flushed(i, w.lanes<T>(i.r[2])[t]),
                                    flushed(i, w.lanes<T>(i.r[3])[t])));
    }
}

template <class Op>
Run pick1(uint8_t bytes) {
    return bytes == 4 ? Run(run1<Op, float>) : Run(run1<Op, double>);
}

template <class Op>
Run pick2(uint8_t bytes) {
    return bytes == 4 ? Run(run2<Op, float>) : Run(run2<Op, double>);
}

}  // namespace

Run careful_unary(const std::string& op, uint8_t bytes) {
    if (op == "abs") return pick1<RealAbs>(bytes);
    if (op == "neg") return pick1<RealNeg>(bytes);
    if (op == "sqrt") return pick1<RealSqrt>(bytes);
    if (op == "rsqrt") return pick1<RealRsqrt>(bytes);
    if (op == "rcp") return pick1<RealRcp>(bytes);
    if (op == "ex2") return pick1<RealEx2>(bytes);
    if (op == "lg2") return pick1<RealLg2>(bytes);
    if (op == "sin") return pick1<RealSin>(bytes);
    if (op == "cos") return pick1<RealCos>(bytes);
    if (op == "tanh") return pick1<RealTanh>(bytes);
    return nullptr;
}

Run careful_binary(const std::string& op, uint8_t bytes) {
    if (op == "add") return pick2<RealAdd>(bytes);
    if (op == "sub") return pick2<RealSub>(bytes);
    if (op == "mul") return pick2<RealMul>(bytes);
    if (op == "div") return pick2<RealDiv>(bytes);
    if (op == "min") return pick2<RealMin>(bytes);
    if (op == "max") return pick2<RealMax>(bytes);
    return nullptr;
}

Run careful_fma(uint8_t bytes) { return bytes == 4 ? Run(run_fma<float>) : Run(run_fma<double>); }

}  // namespace fake
