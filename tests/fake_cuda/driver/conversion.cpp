// cvt: from any number to any other. Registers may be wider than the types. Compiled with -frounding-math.
#include <cfenv>
#include <cmath>
#include <limits>
#include <type_traits>

#include "lanes.hpp"

namespace fake {
namespace {

double rounded(double a, Rounding rounding) {
    switch (rounding) {
        case Rounding::zero: return std::trunc(a);
        case Rounding::down: return std::floor(a);
        case Rounding::up: return std::ceil(a);
        default: return std::nearbyint(a);
    }
}

// Out of range is the nearest in range, NaN is 0.
template <class D>
D to_integer(double a, Rounding rounding) {
    if (a != a) return 0;
    a = rounded(a, rounding);
    const double limit = std::ldexp(1.0, std::numeric_limits<D>::digits);
    if (a >= limit) return std::numeric_limits<D>::max();
    if (a < (std::is_signed_v<D> ? -limit : 0.0)) return std::numeric_limits<D>::min();
    return static_cast<D>(a);
}

template <class D, class S>
D to_saturated_integer(S a) {
    const auto wide = static_cast<__int128>(a);
    if (wide > static_cast<__int128>(std::numeric_limits<D>::max())) return std::numeric_limits<D>::max();
    if (wide < static_cast<__int128>(std::numeric_limits<D>::min())) return std::numeric_limits<D>::min();
    return static_cast<D>(a);
}

template <class T>
T flushed(T a) {
    return std::fpclassify(a) == FP_SUBNORMAL ? std::copysign(T{0}, a) : a;
}

// `offset` of the instruction is 1 where a float is rounded to an integral float.
template <class D, class S>
D converted(S a, const Instruction& i) {
    if constexpr (std::is_integral_v<D> && std::is_integral_v<S>) {
        return i.saturates ? to_saturated_integer<D>(a) : static_cast<D>(a);
    } else if constexpr (std::is_integral_v<D>) {
        return to_integer<D>(static_cast<double>(i.flushes ? flushed(a) : a), i.rounding);
    } else {
        D result;
        if constexpr (std::is_integral_v<S>) result = static_cast<D>(a);
        else if (i.offset)
            result = static_cast<D>(rounded(static_cast<double>(i.flushes ? flushed(a) : a), i.rounding));
        else result = static_cast<D>(i.flushes ? flushed(a) : a);
        if (i.flushes) result = flushed(result);
        if (i.saturates) result = !(result > D{0}) ? D{0} : (result < D{1} ? result : D{1});
        return result;
    }
}

// Into a register that may be wider: the sign goes on.
template <class D>
void store_wide(uint8_t* to, uint8_t width, D value) {
    if (width == sizeof(D)) {
        std::memcpy(to, &value, sizeof(D));
        return;
    }
    const auto wide = static_cast<int64_t>(value);
    std::memcpy(to, &wide, width);
}

template <class D, class S>
void run_exact(Warp& w, const Instruction& i, uint32_t mask) {
    D* d = w.lanes<D>(i.r[0]);
    const S* a = w.lanes<S>(i.r[1]);
    each_lane(w, mask, [=](int t) { d[t] = static_cast<D>(a[t]); });
}

template <class D, class S>
void run_general(Warp& w, const Instruction& i, uint32_t mask) {
    constexpr int modes[] = {FE_TONEAREST, FE_TOWARDZERO, FE_DOWNWARD, FE_UPWARD};
    const bool directed = std::is_floating_point_v<D> && !i.offset && i.rounding != Rounding::nearest;
    if (directed) std::fesetround(modes[static_cast<size_t>(i.rounding)]);
    for (uint32_t m = mask; m; m &= m - 1) {
        const auto t = static_cast<uint32_t>(__builtin_ctz(m));
        S a;
        std::memcpy(&a, w.frame + i.r[1] + t * i.width[1], sizeof a);
        store_wide(w.frame + i.r[0] + t * i.width[0], i.width[0], converted<D, S>(a, i));
    }
    if (directed) std::fesetround(FE_TONEAREST);
}

template <class F>
Run with_any(Type type, F f) {
    if (type.kind == Kind::predicate) return nullptr;
    if (type.bytes == 1) return type.kind == Kind::integer ? f(int8_t{}) : f(uint8_t{});
    return with_number(type, f);
}

Run pick(Type to, Type from, bool exact) {
    return with_any(to, [=](auto d) -> Run {
        return with_any(from, [=](auto s) -> Run {
            using D = decltype(d);
            using S = decltype(s);
            constexpr bool always_exact = std::is_floating_point_v<D> || std::is_integral_v<S>;
            return exact && always_exact ? Run(run_exact<D, S>) : Run(run_general<D, S>);
        });
    });
}

bool take_integral_rounding(Decoder& d) {
    const char* names[] = {"rni", "rzi", "rmi", "rpi"};
    for (int k = 0; k < 4; ++k)
        if (d.take(names[k])) {
            d.out.rounding = static_cast<Rounding>(k);
            return true;
        }
    return false;
}

void decode_cvt(Decoder& d) {
    const Type to = d.take_type();
    const Type from = d.take_type();
    const bool integral = take_integral_rounding(d);
    if (!integral) d.out.rounding = d.take_rounding();
    d.out.offset = integral;
    d.out.flushes = d.take("ftz");
    d.out.saturates = d.take("sat");
    d.out.width[0] = d.width_of(d.operand(0), to.bytes);
    d.out.width[1] = d.width_of(d.operand(1), d.operand(1).text[0] == '%' ? 4 : from.bytes);
    if (d.out.width[0] < to.bytes || d.out.width[1] < from.bytes) d.reject("a register narrower than its type");
    d.out.r[0] = d.target(0, d.out.width[0]);
    d.out.r[1] = d.source(1, d.out.width[1]);
    const bool plain = !integral && d.out.rounding == Rounding::nearest && !d.out.flushes && !d.out.saturates;
    d.emit(pick(to, from, plain && d.out.width[0] == to.bytes && d.out.width[1] == from.bytes));
}

}  // namespace

void add_conversion_instructions(DecodeTable& table) { table["cvt"] = decode_cvt; }

}  // namespace fake
