// Comparisons into predicates, and choices by them.
#include <cmath>
#include <limits>

#include "lanes.hpp"

namespace fake {
namespace {

struct Eq {
    template <class T>
    static bool of(T a, T b) {
        return a == b;
    }
};
struct Ne {
    template <class T>
    static bool of(T a, T b) {
        return a < b || b < a;
    }
};
struct Lt {
    template <class T>
    static bool of(T a, T b) {
        return a < b;
    }
};
struct Le {
    template <class T>
    static bool of(T a, T b) {
        return a <= b;
    }
};
struct Gt {
    template <class T>
    static bool of(T a, T b) {
        return a > b;
    }
};
struct Ge {
    template <class T>
    static bool of(T a, T b) {
        return a >= b;
    }
};
struct Num {
    template <class T>
    static bool of(T a, T b) {
        return a == a && b == b;
    }
};
// True where the opposite is false: also for NaN.
template <class Opposite>
struct Unordered {
    template <class T>
    static bool of(T a, T b) {
        return !Opposite::of(a, b);
    }
};

// Subnormals taken as zero.
template <class Op>
struct Flushing {
    static float flushed(float a) { return std::fabs(a) < std::numeric_limits<float>::min() ? 0.0f : a; }
    static bool of(float a, float b) { return Op::of(flushed(a), flushed(b)); }
};

template <class Op>
Run compare(const Decoder& d, Type type) {
    if (d.out.flushes) return binary<Flushing<Op>, uint8_t, float, float>;
    return with_number(type, [](auto v) -> Run { return binary<Op, uint8_t, decltype(v), decltype(v)>; });
}

Type without_sign(Type type) { return {type.kind == Kind::real ? Kind::real : Kind::natural, type.bytes}; }

Run take_comparison(Decoder& d, Type type) {
    if (d.take("eq")) return compare<Eq>(d, type);
    if (d.take("ne")) return compare<Ne>(d, type);
    if (d.take("lt")) return compare<Lt>(d, type);
    if (d.take("le")) return compare<Le>(d, type);
    if (d.take("gt")) return compare<Gt>(d, type);
    if (d.take("ge")) return compare<Ge>(d, type);
    if (d.take("lo")) return compare<Lt>(d, without_sign(type));
    if (d.take("ls")) return compare<Le>(d, without_sign(type));
    if (d.take("hi")) return compare<Gt>(d, without_sign(type));
    if (d.take("hs")) return compare<Ge>(d, without_sign(type));
    if (type.kind != Kind::real) return nullptr;
    if (d.take("equ")) return compare<Unordered<Ne>>(d, type);
    if (d.take("neu")) return compare<Unordered<Eq>>(d, type);
    if (d.take("ltu")) return compare<Unordered<Ge>>(d, type);
    if (d.take("leu")) return compare<Unordered<Gt>>(d, type);
    if (d.take("gtu")) return compare<Unordered<Le>>(d, type);
    if (d.take("geu")) return compare<Unordered<Lt>>(d, type);
    if (d.take("num")) return compare<Num>(d, type);
    if (d.take("nan")) return compare<Unordered<Num>>(d, type);
    return nullptr;
}

struct And {
    static uint8_t of(uint8_t a, uint8_t b) { return a & b; }
};
struct Or {
    static uint8_t of(uint8_t a, uint8_t b) { return a | b; }
};
struct Xor {
    static uint8_t of(uint8_t a, uint8_t b) { return a ^ b; }
};
struct Not {
    static uint8_t of(uint8_t a) { return a ^ 1; }
};

Run take_combination(Decoder& d) {
    if (d.take("and")) return binary<And, uint8_t, uint8_t, uint8_t>;
    if (d.take("or")) return binary<Or, uint8_t, uint8_t, uint8_t>;
    if (d.take("xor")) return binary<Xor, uint8_t, uint8_t, uint8_t>;
    return nullptr;
}

uint32_t emit_not(Decoder& d, uint32_t predicate) {
    d.out.r[0] = d.builder.allocate_register(1);
    d.out.r[1] = predicate;
    d.emit(unary<Not, uint8_t, uint8_t>);
    return d.out.r[0];
}

void emit_combined(Decoder& d, uint32_t target, uint32_t found, Run combine, uint32_t other) {
    d.out.r[0] = target;
    d.out.r[1] = found;
    d.out.r[2] = combine ? other : found;
    d.emit(combine ? combine : binary<And, uint8_t, uint8_t, uint8_t>);
}

// setp.CMP[.BOOL] p[|q], a, b[, c]: p = (a CMP b) BOOL c, q = !(a CMP b) BOOL c.
void decode_setp(Decoder& d) {
    const Type type = d.take_type();
    d.out.flushes = d.take("ftz");
    if (d.out.flushes && (type.kind != Kind::real || type.bytes != 4)) d.reject("'ftz' is for f32");
    const Run combine = take_combination(d);
    const Run run = take_comparison(d, type);
    const bool pair = d.operand(0).paired;
    const size_t first = pair ? 2 : 1;
    const uint32_t p = d.target(0, 1);
    const bool simple = !pair && !combine;
    const uint32_t found = simple ? p : d.builder.allocate_register(1);
    d.out.r[0] = found;
    d.out.r[1] = d.source(first, type.bytes);
    d.out.r[2] = d.source(first + 1, type.bytes);
    d.emit(run);
    if (simple) return;
    uint32_t other = kNowhere;
    if (combine) {
        other = d.source(first + 2, 1);
        if (d.operand(first + 2).negated) other = emit_not(d, other);
    }
    if (pair) emit_combined(d, d.target(1, 1), emit_not(d, found), combine, other);
    emit_combined(d, p, found, combine, other);
}

template <class T>
void run_select(Warp& w, const Instruction& i, uint32_t mask) {
    T* d = w.lanes<T>(i.r[0]);
    const T* a = w.lanes<T>(i.r[1]);
    const T* b = w.lanes<T>(i.r[2]);
    const uint8_t* p = w.lanes<uint8_t>(i.r[3]);
    each_lane(w, mask, [=](int t) { d[t] = p[t] ? a[t] : b[t]; });
}

void decode_selp(Decoder& d) {
    const Type type = d.take_type();
    d.out.r[0] = d.target(0, type.bytes);
    d.out.r[1] = d.source(1, type.bytes);
    d.out.r[2] = d.source(2, type.bytes);
    d.out.r[3] = d.source(3, 1);
    d.emit(with_integer({Kind::bits, type.bytes}, [](auto v) -> Run { return run_select<decltype(v)>; }));
}

// d = c >= 0 ? a : b
template <class T, class C>
void run_slct(Warp& w, const Instruction& i, uint32_t mask) {
    each_lane(w, mask, [&](int t) {
        w.lanes<T>(i.r[0])[t] = w.lanes<C>(i.r[3])[t] >= C{0} ? w.lanes<T>(i.r[1])[t] : w.lanes<T>(i.r[2])[t];
    });
}

void decode_slct(Decoder& d) {
    const Type type = d.take_type();
    const Type by = d.take_type();
    d.out.r[0] = d.target(0, type.bytes);
    d.out.r[1] = d.source(1, type.bytes);
    d.out.r[2] = d.source(2, type.bytes);
    d.out.r[3] = d.source(3, 4);
    const bool real = by.kind == Kind::real;
    d.emit(with_integer({Kind::bits, type.bytes}, [real](auto v) -> Run {
        return real ? Run(run_slct<decltype(v), float>) : Run(run_slct<decltype(v), int32_t>);
    }));
}

}  // namespace

void add_compare_instructions(DecodeTable& table) {
    table["setp"] = decode_setp;
    table["selp"] = decode_selp;
    table["slct"] = decode_slct;
}

}  // namespace fake
