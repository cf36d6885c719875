// Float and double arithmetic in the default rounding; what it shares with integers is told apart here.
#include "lanes.hpp"
#include "real_ops.hpp"

namespace fake {

void decode_shared_integer(Decoder& d, Type type);

namespace {

struct Cost {
    Run plain;
    uint8_t flops;
};

template <class Op>
Run pick1(Type type) {
    return with_real(type, [](auto v) -> Run { return unary<Op, decltype(v), decltype(v)>; });
}
template <class Op>
Run pick2(Type type) {
    return with_real(type, [](auto v) -> Run { return binary<Op, decltype(v), decltype(v), decltype(v)>; });
}

Run pick_fma(Type type) {
    if (type.bytes == 4) return ternary<RealFma, float, float, float, float>;
    return ternary<RealFma, double, double, double, double>;
}

Cost plain_unary(const std::string& op, Type type) {
    if (op == "abs") return {pick1<RealAbs>(type), 0};
    if (op == "neg") return {pick1<RealNeg>(type), 0};
    if (op == "sqrt") return {pick1<RealSqrt>(type), 1};
    if (op == "rsqrt") return {pick1<RealRsqrt>(type), 1};
    if (op == "rcp") return {pick1<RealRcp>(type), 1};
    if (op == "ex2") return {pick1<RealEx2>(type), 1};
    if (op == "lg2") return {pick1<RealLg2>(type), 1};
    if (op == "sin") return {pick1<RealSin>(type), 1};
    if (op == "cos") return {pick1<RealCos>(type), 1};
    if (op == "tanh") return {pick1<RealTanh>(type), 1};
    return {nullptr, 0};
}

Cost plain_binary(const std::string& op, Type type) {
    if (op == "add") return {pick2<RealAdd>(type), 1};
    if (op == "sub") return {pick2<RealSub>(type), 1};
    if (op == "mul") return {pick2<RealMul>(type), 1};
    if (op == "div") return {pick2<RealDiv>(type), 1};
    if (op == "min") return {pick2<RealMin>(type), 0};
    if (op == "max") return {pick2<RealMax>(type), 0};
    if (op == "copysign") return {pick2<RealCopysign>(type), 0};
    return {nullptr, 0};
}

// True if the plain operation will do.
bool take_flags(Decoder& d) {
    if (!d.take("approx")) d.take("full");
    d.out.rounding = d.take_rounding();
    d.out.flushes = d.take("ftz");
    d.out.saturates = d.take("sat");
    return d.out.rounding == Rounding::nearest && !d.out.flushes && !d.out.saturates;
}

void decode_unary(Decoder& d, Type type) {
    const bool plain = take_flags(d);
    same_type_operands(d, type, 1);
    const Cost cost = plain_unary(d.statement.opcode, type);
    d.out.flops = cost.flops;
    d.emit(plain ? cost.plain : careful_unary(d.statement.opcode, type.bytes));
}

void decode_binary(Decoder& d, Type type) {
    const bool plain = take_flags(d);
    same_type_operands(d, type, 2);
    const Cost cost = plain_binary(d.statement.opcode, type);
    d.out.flops = cost.flops;
    d.emit(plain ? cost.plain : careful_binary(d.statement.opcode, type.bytes));
}

void decode_fma(Decoder& d, Type type) {
    const bool plain = take_flags(d);
    same_type_operands(d, type, 3);
    d.out.flops = 2;
    d.emit(plain ? pick_fma(type) : careful_fma(type.bytes));
}

void decode_any(Decoder& d) {
    const Type type = d.take_type();
    const std::string& op = d.statement.opcode;
    if (type.kind != Kind::real) return decode_shared_integer(d, type);
    if (op == "mad") return decode_fma(d, type);
    if (op == "abs" || op == "neg") return decode_unary(d, type);
    decode_binary(d, type);
}

void decode_only_real(Decoder& d) {
    const Type type = d.take_type();
    if (type.kind != Kind::real) d.reject("'" + d.statement.opcode + "' is not known for this type");
    const std::string& op = d.statement.opcode;
    if (op == "fma") return decode_fma(d, type);
    if (op == "copysign") return decode_binary(d, type);
    decode_unary(d, type);
}

struct IsFinite {
    template <class T>
    static bool of(T a) {
        return std::isfinite(a);
    }
};
struct IsInfinite {
    template <class T>
    static bool of(T a) {
        return std::isinf(a);
    }
};
struct IsNan {
    template <class T>
    static bool of(T a) {
        return a != a;
    }
};
struct IsNumber {
    template <class T>
    static bool of(T a) {
        return a == a;
    }
};
struct IsNormal {
    template <class T>
    static bool of(T a) {
        return std::isnormal(a);
    }
};
struct IsSubnormal {
    template <class T>
    static bool of(T a) {
        return a != 0 && std::fpclassify(a) == FP_SUBNORMAL;
    }
};

template <class Op>
Run test(Type type) {
    return with_real(type, [](auto v) -> Run { return unary<Op, uint8_t, decltype(v)>; });
}

void decode_testp(Decoder& d) {
    const Type type = d.take_type();
    d.out.r[0] = d.target(0, 1);
    d.out.r[1] = d.source(1, type.bytes);
    Run run = nullptr;
    if (d.take("finite")) run = test<IsFinite>(type);
    else if (d.take("infinite")) run = test<IsInfinite>(type);
    else if (d.take("notanumber")) run = test<IsNan>(type);
    else if (d.take("number")) run = test<IsNumber>(type);
    else if (d.take("normal")) run = test<IsNormal>(type);
    else if (d.take("subnormal")) run = test<IsSubnormal>(type);
    d.emit(run);
}

}  // namespace

void add_float_instructions(DecodeTable& table) {
    for (const char* op : {"add", "sub", "mul", "mad", "div", "min", "max", "abs", "neg"}) table[op] = decode_any;
    for (const char* op : {"fma", "copysign", "sqrt", "rsqrt", "rcp", "ex2", "lg2", "sin", "cos", "tanh"})
        table[op] = decode_only_real;
    table["testp"] = decode_testp;
}

}  // namespace fake
