// Integer arithmetic. Sums and products wrap: they are computed unsigned.
#include <type_traits>

#include "lanes.hpp"

namespace fake {
namespace {

// Wide enough that the product of two narrow ones is no signed overflow.
template <class T>
uint64_t wide(T a) {
    return static_cast<uint64_t>(a);
}

struct Add {
    template <class T>
    static T of(T a, T b) {
        return static_cast<T>(wide(a) + wide(b));
    }
};
struct Sub {
    template <class T>
    static T of(T a, T b) {
        return static_cast<T>(wide(a) - wide(b));
    }
};
struct MulLow {
    template <class T>
    static T of(T a, T b) {
        return static_cast<T>(wide(a) * wide(b));
    }
};
struct MulHigh {
    template <class T>
    static T of(T a, T b) {
        using Wide = std::conditional_t<std::is_signed_v<T>, __int128, unsigned __int128>;
        return static_cast<T>((static_cast<Wide>(a) * static_cast<Wide>(b)) >> (8 * sizeof(T)));
    }
};
template <class D>
struct MulWide {
    template <class T>
    static D of(T a, T b) {
        return static_cast<D>(static_cast<D>(a) * static_cast<D>(b));
    }
};
struct MadLow {
    template <class T>
    static T of(T a, T b, T c) {
        return Add::of(MulLow::of(a, b), c);
    }
};
struct MadHigh {
    template <class T>
    static T of(T a, T b, T c) {
        return Add::of(MulHigh::of(a, b), c);
    }
};
template <class D>
struct MadWide {
    template <class T>
    static D of(T a, T b, D c) {
        return Add::of(MulWide<D>::of(a, b), c);
    }
};

// What the hardware leaves where the result has no meaning: all bits set.
struct Div {
    template <class T>
    static T of(T a, T b) {
        if (b == 0) return static_cast<T>(~T{0});
        if (std::is_signed_v<T> && b == static_cast<T>(-1)) return Sub::of(T{0}, a);
        return static_cast<T>(a / b);
    }
};
struct Rem {
    template <class T>
    static T of(T a, T b) {
        if (b == 0) return a;
        if (std::is_signed_v<T> && b == static_cast<T>(-1)) return 0;
        return static_cast<T>(a % b);
    }
};
struct Min {
    template <class T>
    static T of(T a, T b) {
        return b < a ? b : a;
    }
};
struct Max {
    template <class T>
    static T of(T a, T b) {
        return a < b ? b : a;
    }
};
struct Abs {
    template <class T>
    static T of(T a) {
        return a < 0 ? Sub::of(T{0}, a) : a;
    }
};
struct Neg {
    template <class T>
    static T of(T a) {
        return Sub::of(T{0}, a);
    }
};
struct Sad {
    template <class T>
    static T of(T a, T b, T c) {
        return Add::of(a < b ? Sub::of(b, a) : Sub::of(a, b), c);
    }
};

template <class Op>
Run pick1(Type type) {
    return with_integer(type, [](auto v) -> Run { return unary<Op, decltype(v), decltype(v)>; });
}
template <class Op>
Run pick2(Type type) {
    return with_integer(type, [](auto v) -> Run { return binary<Op, decltype(v), decltype(v), decltype(v)>; });
}
template <class Op>
Run pick3(Type type) {
    return with_integer(type,
                        [](auto v) -> Run { return ternary<Op, decltype(v), decltype(v), decltype(v), decltype(v)>; });
}

template <class Op>
void decode2(Decoder& d, Type type) {
    same_type_operands(d, type, 2);
    d.emit(pick2<Op>(type));
}

void decode_wide(Decoder& d, Type type, bool adds) {
    d.out.r[0] = d.target(0, 2 * type.bytes);
    d.out.r[1] = d.source(1, type.bytes);
    d.out.r[2] = d.source(2, type.bytes);
    if (adds) d.out.r[3] = d.source(3, 2 * type.bytes);
    const bool sign = type.kind == Kind::integer;
    Run run = nullptr;
    if (type.bytes == 4 && adds)
        run = sign ? Run(ternary<MadWide<int64_t>, int64_t, int32_t, int32_t, int64_t>)
                   : Run(ternary<MadWide<uint64_t>, uint64_t, uint32_t, uint32_t, uint64_t>);
    else if (type.bytes == 4)
        run = sign ? Run(binary<MulWide<int64_t>, int64_t, int32_t, int32_t>)
                   : Run(binary<MulWide<uint64_t>, uint64_t, uint32_t, uint32_t>);
    else if (type.bytes == 2 && adds)
        run = sign ? Run(ternary<MadWide<int32_t>, int32_t, int16_t, int16_t, int32_t>)
                   : Run(ternary<MadWide<uint32_t>, uint32_t, uint16_t, uint16_t, uint32_t>);
    else if (type.bytes == 2)
        run = sign ? Run(binary<MulWide<int32_t>, int32_t, int16_t, int16_t>)
                   : Run(binary<MulWide<uint32_t>, uint32_t, uint16_t, uint16_t>);
    d.emit(run);
}

}  // namespace

// The opcodes that integers share with floats arrive here from float.cpp.
void decode_shared_integer(Decoder& d, Type type) {
    const std::string& op = d.statement.opcode;
    if (op == "add") return decode2<Add>(d, type);
    if (op == "sub") return decode2<Sub>(d, type);
    if (op == "div") return decode2<Div>(d, type);
    if (op == "min") return decode2<Min>(d, type);
    if (op == "max") return decode2<Max>(d, type);
    if (op == "abs" || op == "neg") {
        same_type_operands(d, type, 1);
        return d.emit(op == "abs" ? pick1<Abs>(type) : pick1<Neg>(type));
    }
    const bool adds = op == "mad";
    if (d.take("wide")) return decode_wide(d, type, adds);
    const bool high = d.take("hi");
    if (!high && !d.take("lo")) d.reject("'" + op + "' is not known for this type");
    same_type_operands(d, type, adds ? 3 : 2);
    if (adds) d.emit(high ? pick3<MadHigh>(type) : pick3<MadLow>(type));
    else d.emit(high ? pick2<MulHigh>(type) : pick2<MulLow>(type));
}

void add_integer_instructions(DecodeTable& table) {
    table["rem"] = [](Decoder& d) { decode2<Rem>(d, d.take_type()); };
    table["sad"] = [](Decoder& d) {
        const Type type = d.take_type();
        same_type_operands(d, type, 3);
        d.emit(pick3<Sad>(type));
    };
}

}  // namespace fake
