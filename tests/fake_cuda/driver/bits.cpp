// Logic, shifts, and what picks bits apart.
#include <algorithm>
#include <type_traits>

#include "lanes.hpp"

namespace fake {
namespace {

struct And {
    template <class T>
    static T of(T a, T b) {
        return a & b;
    }
};
struct Or {
    template <class T>
    static T of(T a, T b) {
        return a | b;
    }
};
struct Xor {
    template <class T>
    static T of(T a, T b) {
        return a ^ b;
    }
};
struct Not {
    template <class T>
    static T of(T a) {
        return static_cast<T>(~a);
    }
};
struct NotPredicate {
    static uint8_t of(uint8_t a) { return a ^ 1; }
};
struct Cnot {
    template <class T>
    static T of(T a) {
        return a == 0;
    }
};
// Shifts by the width or more leave nothing but the sign.
struct ShiftLeft {
    template <class T>
    static T of(T a, uint32_t n) {
        return n >= 8 * sizeof(T) ? T{0} : static_cast<T>(a << n);
    }
};
struct ShiftRight {
    template <class T>
    static T of(T a, uint32_t n) {
        constexpr uint32_t last = 8 * sizeof(T) - 1;
        if (n > last) return std::is_signed_v<T> ? static_cast<T>(a >> last) : T{0};
        return static_cast<T>(a >> n);
    }
};
struct Popc {
    static uint32_t of(uint64_t a) { return static_cast<uint32_t>(__builtin_popcountll(a)); }
};
struct Clz {
    static uint32_t of(uint32_t a) { return a ? static_cast<uint32_t>(__builtin_clz(a)) : 32; }
    static uint32_t of(uint64_t a) { return a ? static_cast<uint32_t>(__builtin_clzll(a)) : 64; }
};
struct Brev {
    template <class T>
    static T of(T a) {
        T r = 0;
        for (size_t k = 0; k < 8 * sizeof(T); ++k) r = static_cast<T>(r << 1 | (a >> k & 1));
        return r;
    }
};
// The highest bit that differs from the sign.
template <bool kAsShift>
struct Bfind {
    template <class T>
    static uint32_t of(T a) {
        using U = std::make_unsigned_t<T>;
        const U bits = a < 0 ? static_cast<U>(~a) : static_cast<U>(a);
        if (!bits) return 0xffffffff;
        const uint32_t at = 63 - static_cast<uint32_t>(__builtin_clzll(bits));
        return kAsShift ? static_cast<uint32_t>(8 * sizeof(T) - 1) - at : at;
    }
};
struct Bfe {
    template <class T>
    static T of(T a, uint32_t from, uint32_t count) {
        constexpr uint32_t bits = 8 * sizeof(T);
        from &= 0xff;
        count &= 0xff;
        using U = std::make_unsigned_t<T>;
        const uint32_t sign_at = std::min(from + count - 1, bits - 1);
        const bool sign = std::is_signed_v<T> && count && (static_cast<U>(a) >> sign_at & 1);
        U r = from < bits ? static_cast<U>(static_cast<U>(a) >> from) : U{0};
        const uint32_t kept = from < bits ? std::min(count, bits - from) : 0;
        if (kept < bits) {
            const U mask = static_cast<U>((U{1} << kept) - 1);
            r = sign ? static_cast<U>(r | ~mask) : static_cast<U>(r & mask);
        }
        return static_cast<T>(r);
    }
};
struct Prmt {
    static uint32_t of(uint32_t a, uint32_t b, uint32_t selector) {
        const uint64_t bytes = static_cast<uint64_t>(b) << 32 | a;
        uint32_t r = 0;
        for (int k = 0; k < 4; ++k) {
            const uint32_t nibble = selector >> 4 * k & 0xf;
            uint32_t byte = bytes >> 8 * (nibble & 7) & 0xff;
            if (nibble & 8) byte = byte & 0x80 ? 0xff : 0;
            r |= byte << 8 * k;
        }
        return r;
    }
};
template <bool kLeft, bool kWraps>
struct Funnel {
    static uint32_t of(uint32_t a, uint32_t b, uint32_t n) {
        n = kWraps ? n & 31 : std::min(n, 32u);
        const uint64_t both = static_cast<uint64_t>(b) << 32 | a;
        return static_cast<uint32_t>(kLeft ? both << n >> 32 : both >> n);
    }
};

template <class Op>
Run logic(Type type) {
    if (type.kind == Kind::predicate) return binary<Op, uint8_t, uint8_t, uint8_t>;
    return with_integer({Kind::bits, type.bytes},
                        [](auto v) -> Run { return binary<Op, decltype(v), decltype(v), decltype(v)>; });
}

template <class Op>
void decode_logic(Decoder& d) {
    const Type type = d.take_type();
    same_type_operands(d, type, 2);
    d.emit(logic<Op>(type));
}

void decode_not(Decoder& d) {
    const Type type = d.take_type();
    same_type_operands(d, type, 1);
    if (type.kind == Kind::predicate) return d.emit(unary<NotPredicate, uint8_t, uint8_t>);
    d.emit(with_integer(type, [](auto v) -> Run { return unary<Not, decltype(v), decltype(v)>; }));
}

template <class Op>
void decode_shift(Decoder& d) {
    const Type type = d.take_type();
    d.out.r[0] = d.target(0, type.bytes);
    d.out.r[1] = d.source(1, type.bytes);
    d.out.r[2] = d.source(2, 4);
    d.emit(with_integer(type, [](auto v) -> Run { return binary<Op, decltype(v), decltype(v), uint32_t>; }));
}

// Counts are 32 bits wide whatever is counted.
template <class Op>
void decode_count(Decoder& d) {
    const Type type = d.take_type();
    d.out.r[0] = d.target(0, 4);
    d.out.r[1] = d.source(1, type.bytes);
    if (type.bytes == 2) d.reject("16 bits are not known here");
    d.emit(with_integer(type, [](auto v) -> Run { return unary<Op, uint32_t, decltype(v)>; }));
}

void decode_bfe(Decoder& d) {
    const Type type = d.take_type();
    d.out.r[0] = d.target(0, type.bytes);
    d.out.r[1] = d.source(1, type.bytes);
    d.out.r[2] = d.source(2, 4);
    d.out.r[3] = d.source(3, 4);
    d.emit(
        with_integer(type, [](auto v) -> Run { return ternary<Bfe, decltype(v), decltype(v), uint32_t, uint32_t>; }));
}

// d = b with `count` bits of a from bit `from` on.
template <class T>
void run_bfi(Warp& w, const Instruction& i, uint32_t mask) {
    constexpr uint32_t bits = 8 * sizeof(T);
    each_lane(w, mask, [&](int t) {
        const uint32_t from = w.lanes<uint32_t>(i.r[3])[t] & 0xff;
        const uint32_t count = std::min(w.lanes<uint32_t>(i.r[4])[t] & 0xff, from < bits ? bits - from : 0);
        const T b = w.lanes<T>(i.r[2])[t];
        const T window = count ? static_cast<T>((count == bits ? T{0} : static_cast<T>(T{1} << count)) - 1) : T{0};
        const T a = w.lanes<T>(i.r[1])[t] & window;
        w.lanes<T>(i.r[0])[t] = count ? (b & ~(window << from)) | (a << from) : b;
    });
}

void decode_bfi(Decoder& d) {
    const Type type = d.take_type();
    d.out.r[0] = d.target(0, type.bytes);
    d.out.r[1] = d.source(1, type.bytes);
    d.out.r[2] = d.source(2, type.bytes);
    d.out.r[3] = d.source(3, 4);
    d.out.r[4] = d.source(4, 4);
    d.emit(type.bytes == 4 ? Run(run_bfi<uint32_t>) : Run(run_bfi<uint64_t>));
}

void run_lop3(Warp& w, const Instruction& i, uint32_t mask) {
    const auto table = static_cast<uint32_t>(i.offset);
    each_lane(w, mask, [&](int t) {
        uint32_t r = 0;
        for (uint32_t k = 0; k < 8; ++k) {
            if (!(table >> k & 1)) continue;
            const uint32_t a = w.lanes<uint32_t>(i.r[1])[t] ^ (k & 4 ? 0 : ~0u);
            const uint32_t b = w.lanes<uint32_t>(i.r[2])[t] ^ (k & 2 ? 0 : ~0u);
            const uint32_t c = w.lanes<uint32_t>(i.r[3])[t] ^ (k & 1 ? 0 : ~0u);
            r |= a & b & c;
        }
        w.lanes<uint32_t>(i.r[0])[t] = r;
    });
}

void decode_words(Decoder& d, Run run) {
    d.take_type();
    same_type_operands(d, {Kind::bits, 4}, 3);
    d.emit(run);
}

}  // namespace

void add_bit_instructions(DecodeTable& table) {
    table["and"] = decode_logic<And>;
    table["or"] = decode_logic<Or>;
    table["xor"] = decode_logic<Xor>;
    table["not"] = decode_not;
    table["cnot"] = [](Decoder& d) {
        const Type type = d.take_type();
        same_type_operands(d, type, 1);
        d.emit(with_integer(type, [](auto v) -> Run { return unary<Cnot, decltype(v), decltype(v)>; }));
    };
    table["shl"] = decode_shift<ShiftLeft>;
    table["shr"] = decode_shift<ShiftRight>;
    table["popc"] = decode_count<Popc>;
    table["clz"] = [](Decoder& d) {
        const Type type = d.take_type();
        d.out.r[0] = d.target(0, 4);
        d.out.r[1] = d.source(1, type.bytes);
        d.emit(type.bytes == 4 ? Run(unary<Clz, uint32_t, uint32_t>) : Run(unary<Clz, uint32_t, uint64_t>));
    };
    table["bfind"] = [](Decoder& d) {
        d.take("shiftamt") ? decode_count<Bfind<true>>(d) : decode_count<Bfind<false>>(d);
    };
    table["brev"] = [](Decoder& d) {
        const Type type = d.take_type();
        same_type_operands(d, type, 1);
        d.emit(type.bytes == 4 ? Run(unary<Brev, uint32_t, uint32_t>) : Run(unary<Brev, uint64_t, uint64_t>));
    };
    table["bfe"] = decode_bfe;
    table["bfi"] = decode_bfi;
    table["prmt"] = [](Decoder& d) { decode_words(d, ternary<Prmt, uint32_t, uint32_t, uint32_t, uint32_t>); };
    table["shf"] = [](Decoder& d) {
        const bool left = d.take("l");
        if (!left) d.take("r");
        const bool wraps = d.take("wrap");
        if (!wraps) d.take("clamp");
        const auto run = [](auto op) -> Run { return ternary<decltype(op), uint32_t, uint32_t, uint32_t, uint32_t>; };
        if (left) decode_words(d, wraps ? run(Funnel<true, true>{}) : run(Funnel<true, false>{}));
        else decode_words(d, wraps ? run(Funnel<false, true>{}) : run(Funnel<false, false>{}));
    };
    table["lop3"] = [](Decoder& d) {
        d.take_type();
        d.out.r[0] = d.target(0, 4);
        for (size_t k = 1; k <= 3; ++k) d.out.r[k] = d.source(k, 4);
        d.out.offset = static_cast<int64_t>(parse_number(d.operand(4).text, d.statement.line));
        d.emit(run_lop3);
    };
}

}  // namespace fake
