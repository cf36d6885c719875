// Instructions that treat each lane alike: one function per operation and type, over all lanes of a warp.
#pragma once

#include "interpreter.hpp"
#include "syntax.hpp"

namespace fake {

// Calls f for each lane of the mask. A full warp is a loop that vectorises; lanes that do not exist may be computed.
template <class F>
inline void each_lane(const Warp& w, uint32_t mask, F f) {
    if (mask == w.exists) {
#pragma GCC ivdep
        for (int t = 0; t < kLanes; ++t) f(t);
    } else {
        for (uint32_t m = mask; m; m &= m - 1) f(__builtin_ctz(m));
    }
}

template <class Op, class D, class A>
void unary(Warp& w, const Instruction& i, uint32_t mask) {
    D* d = w.lanes<D>(i.r[0]);
    const A* a = w.lanes<A>(i.r[1]);
    each_lane(w, mask, [=](int t) { d[t] = static_cast<D>(Op::of(a[t])); });
}

template <class Op, class D, class A, class B>
void binary(Warp& w, const Instruction& i, uint32_t mask) {
    D* d = w.lanes<D>(i.r[0]);
    const A* a = w.lanes<A>(i.r[1]);
    const B* b = w.lanes<B>(i.r[2]);
    each_lane(w, mask, [=](int t) { d[t] = static_cast<D>(Op::of(a[t], b[t])); });
}

template <class Op, class D, class A, class B, class C>
void ternary(Warp& w, const Instruction& i, uint32_t mask) {
    D* d = w.lanes<D>(i.r[0]);
    const A* a = w.lanes<A>(i.r[1]);
    const B* b = w.lanes<B>(i.r[2]);
    const C* c = w.lanes<C>(i.r[3]);
    each_lane(w, mask, [=](int t) { d[t] = static_cast<D>(Op::of(a[t], b[t], c[t])); });
}

// What f makes of a value of the type, which says how to read the bytes.
template <class F>
Run with_integer(Type type, F f) {
    const bool sign = type.kind == Kind::integer;
    if (type.kind == Kind::real || type.kind == Kind::predicate) return nullptr;
    switch (type.bytes) {
        case 2: return sign ? f(int16_t{}) : f(uint16_t{});
        case 4: return sign ? f(int32_t{}) : f(uint32_t{});
        case 8: return sign ? f(int64_t{}) : f(uint64_t{});
        default: return nullptr;
    }
}

template <class F>
Run with_real(Type type, F f) {
    if (type.kind != Kind::real) return nullptr;
    return type.bytes == 4 ? f(float{}) : f(double{});
}

template <class F>
Run with_number(Type type, F f) {
    return type.kind == Kind::real ? with_real(type, f) : with_integer(type, f);
}

// The first operand is written, `sources` others are read, all of the type.
inline void same_type_operands(Decoder& d, Type type, size_t sources) {
    d.out.r[0] = d.target(0, type.bytes);
    for (size_t k = 1; k <= sources; ++k) d.out.r[k] = d.source(k, type.bytes);
    if (d.operand_count() != sources + 1) d.reject("'" + d.statement.opcode + "' with another number of operands");
}

}  // namespace fake
