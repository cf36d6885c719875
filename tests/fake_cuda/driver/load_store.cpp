// ld and st, of one to four elements.
#include <algorithm>

#include "access.hpp"
#include "lanes.hpp"

namespace fake {
namespace {

// The sign goes on in registers that are wider than the type.
template <class T>
void put(uint8_t* to, uint8_t width, T value) {
    if (width == sizeof(T)) {
        std::memcpy(to, &value, sizeof(T));
    } else {
        const auto wide = static_cast<int64_t>(value);
        std::memcpy(to, &wide, width);
    }
}

template <class T>
void run_load(Warp& w, const Instruction& i, uint32_t mask) {
    for_lanes(w, mask, [&](int lane) {
        const uint8_t* from = reach_read(w, i, lane, access_of(w, i, lane));
        for (uint32_t k = 0; k < i.count; ++k) {
            T value;
            std::memcpy(&value, from + k * sizeof(T), sizeof(T));
            put(w.frame + i.r[k] + static_cast<uint32_t>(lane) * i.width[0], i.width[0], value);
        }
    });
}

template <class T>
void run_store(Warp& w, const Instruction& i, uint32_t mask) {
    for_lanes(w, mask, [&](int lane) {
        uint8_t values[4 * sizeof(T)];
        for (uint32_t k = 0; k < std::min<uint32_t>(i.count, 4); ++k)
            std::memcpy(values + k * sizeof(T), w.frame + i.r[k] + static_cast<uint32_t>(lane) * i.width[0], sizeof(T));
        const Access access = access_of(w, i, lane);
        std::memcpy(reach_write(w, i, lane, access, values), values, access.bytes);
    });
}

template <class F>
Run with_bytes(Type type, F f) {
    if (type.kind == Kind::predicate) return nullptr;
    if (type.bytes == 1) return type.kind == Kind::integer ? f(int8_t{}) : f(uint8_t{});
    return with_integer({type.kind == Kind::integer ? Kind::integer : Kind::bits, type.bytes}, f);
}

// The registers of `{a, b}` or `a`. Unlike elsewhere they may be wider than the type.
void take_elements(Decoder& d, const Operand& operand, Type type, bool loads) {
    const bool vector = operand.form == Operand::vector;
    const size_t count = vector ? operand.parts.size() : 1;
    if (count != d.out.count) d.reject("another number of elements than the instruction says");
    const auto part = [&](size_t k) -> const Operand& { return vector ? operand.parts[k] : operand; };
    uint8_t width = type.bytes;
    for (size_t k = 0; k < count; ++k) width = d.width_of(part(k), width);
    if (width < type.bytes) d.reject("a register narrower than its type");
    d.out.width[0] = width;
    for (size_t k = 0; k < count; ++k) d.out.r[k] = loads ? d.target(part(k), width) : d.source(part(k), width);
}

void decode_access(Decoder& d, bool loads) {
    d.out.uncounted =
        std::find(d.statement.modifiers.begin(), d.statement.modifiers.end(), "const") != d.statement.modifiers.end();
    take_strength(d);
    d.out.space = d.take_space();
    d.out.count = d.take("v4") ? 4 : d.take("v2") ? 2 : 1;
    const Type type = d.take_type();
    d.out.bytes = type.bytes;
    take_address(d, d.operand(loads ? 1 : 0));
    take_elements(d, d.operand(loads ? 0 : 1), type, loads);
    if (loads) return d.emit(with_bytes(type, [](auto v) -> Run { return run_load<decltype(v)>; }));
    d.emit(with_bytes(type, [](auto v) -> Run { return run_store<decltype(v)>; }));
}

void run_nothing(Warp&, const Instruction&, uint32_t) {}

}  // namespace

void add_memory_instructions(DecodeTable& table) {
    table["ld"] = [](Decoder& d) { decode_access(d, true); };
    table["ldu"] = table["ld"];
    table["st"] = [](Decoder& d) { decode_access(d, false); };
    const Decode order = [](Decoder& d) {
        for (const char* scope : {"gl", "cta", "sys", "gpu", "cluster", "sc", "acq_rel", "acquire", "release"})
            d.take(scope);
        d.emit(run_nothing);
    };
    table["membar"] = order;
    table["fence"] = order;
    table["prefetch"] = [](Decoder& d) {
        d.take_space();
        d.take("L1") || d.take("L2");
        d.emit(run_nothing);
    };
}

}  // namespace fake
