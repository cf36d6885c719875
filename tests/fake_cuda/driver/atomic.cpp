// atom and red: read, compute, write at once.
#include "access.hpp"
#include "lanes.hpp"

namespace fake {
namespace {

struct Add {
    template <class T>
    static T of(T old, T a, T) {
        return static_cast<T>(old + a);
    }
};
struct Min {
    template <class T>
    static T of(T old, T a, T) {
        return a < old ? a : old;
    }
};
struct Max {
    template <class T>
    static T of(T old, T a, T) {
        return old < a ? a : old;
    }
};
struct And {
    template <class T>
    static T of(T old, T a, T) {
        return old & a;
    }
};
struct Or {
    template <class T>
    static T of(T old, T a, T) {
        return old | a;
    }
};
struct Xor {
    template <class T>
    static T of(T old, T a, T) {
        return old ^ a;
    }
};
struct Exchange {
    template <class T>
    static T of(T, T a, T) {
        return a;
    }
};
struct CompareAndSwap {
    template <class T>
    static T of(T old, T expected, T wanted) {
        return old == expected ? wanted : old;
    }
};
struct Inc {
    template <class T>
    static T of(T old, T limit, T) {
        return old >= limit ? T{0} : static_cast<T>(old + 1);
    }
};
struct Dec {
    template <class T>
    static T of(T old, T limit, T) {
        return old == 0 || old > limit ? limit : static_cast<T>(old - 1);
    }
};

template <class Op, class T>
void run_atomic(Warp& w, const Instruction& i, uint32_t mask) {
    for_lanes(w, mask, [&](int lane) {
        const Access access = access_of(w, i, lane);
        T old;
        std::memcpy(&old, reach_read(w, i, lane, access), sizeof old);
        const T a = w.lanes<T>(i.r[1])[lane];
        const T b = i.r[2] == kNowhere ? T{0} : w.lanes<T>(i.r[2])[lane];
        const T value = Op::of(old, a, b);
        std::memcpy(reach_write(w, i, lane, access, nullptr), &value, sizeof value);
        if (i.r[0] != kNowhere) w.lanes<T>(i.r[0])[lane] = old;
        if (access.space == Space::global) w.block.visitor.synchronised = true;
    });
}

template <class Op>
Run integers(Type type) {
    return with_integer(type, [](auto v) -> Run { return run_atomic<Op, decltype(v)>; });
}

Run take_operation(Decoder& d, Type type) {
    if (d.take("add")) return with_number(type, [](auto v) -> Run { return run_atomic<Add, decltype(v)>; });
    if (d.take("min")) return integers<Min>(type);
    if (d.take("max")) return integers<Max>(type);
    if (d.take("and")) return integers<And>(type);
    if (d.take("or")) return integers<Or>(type);
    if (d.take("xor")) return integers<Xor>(type);
    if (d.take("exch")) return integers<Exchange>(type);
    if (d.take("cas")) return integers<CompareAndSwap>(type);
    if (d.take("inc")) return integers<Inc>(type);
    if (d.take("dec")) return integers<Dec>(type);
    return nullptr;
}

void decode_atomic(Decoder& d, bool returns) {
    take_strength(d);
    d.out.strong = true;
    d.out.space = d.take_space();
    d.take("noftz");
    const Type type = d.take_type();
    if (type.bytes < 4) d.reject("atomics of 16 bits are not known");
    d.out.bytes = type.bytes;
    d.out.flops = type.kind == Kind::real ? 1 : 0;
    const size_t at = returns ? 1 : 0;
    if (returns) d.out.r[0] = d.target(0, type.bytes);
    take_address(d, d.operand(at));
    d.out.r[1] = d.source(at + 1, type.bytes);
    if (d.operand_count() > at + 2) d.out.r[2] = d.source(at + 2, type.bytes);
    d.emit(take_operation(d, type));
}

}  // namespace

void add_atomic_instructions(DecodeTable& table) {
    table["atom"] = [](Decoder& d) { decode_atomic(d, true); };
    table["red"] = [](Decoder& d) { decode_atomic(d, false); };
}

}  // namespace fake
