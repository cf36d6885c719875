// mov in all its forms, and addresses from one space to another.
#include <ctime>

#include "lanes.hpp"

namespace fake {
namespace {

template <class T>
void run_move(Warp& w, const Instruction& i, uint32_t mask) {
    T* d = w.lanes<T>(i.r[0]);
    const T* a = w.lanes<T>(i.r[1]);
    each_lane(w, mask, [=](int t) { d[t] = a[t]; });
}

// r[0] is made of `count` parts from r[1] on, or taken apart into them: `width` bytes each.
void run_pack(Warp& w, const Instruction& i, uint32_t mask) {
    const uint32_t part = i.width[1];
    for_lanes(w, mask, [&](int t) {
        for (uint32_t k = 0; k < i.count; ++k)
            std::memcpy(w.frame + i.r[0] + static_cast<uint32_t>(t) * i.width[0] + k * part,
                        w.frame + i.r[1 + k] + static_cast<uint32_t>(t) * part, part);
    });
}

void run_unpack(Warp& w, const Instruction& i, uint32_t mask) {
    const uint32_t part = i.width[1];
    for_lanes(w, mask, [&](int t) {
        for (uint32_t k = 0; k < i.count; ++k)
            std::memcpy(w.frame + i.r[1 + k] + static_cast<uint32_t>(t) * part,
                        w.frame + i.r[0] + static_cast<uint32_t>(t) * i.width[0] + k * part, part);
    });
}

void decode_pack(Decoder& d, Type type, const Operand& whole, const Operand& parts, bool packs) {
    d.out.count = static_cast<uint8_t>(parts.parts.size());
    if (d.out.count < 2 || d.out.count > 4) d.reject("two to four parts expected");
    const auto part = static_cast<uint8_t>(type.bytes / d.out.count);
    d.out.width[0] = type.bytes;
    d.out.width[1] = part;
    d.out.r[0] = packs ? d.target(whole, type.bytes) : d.source(whole, type.bytes);
    for (size_t k = 0; k < d.out.count; ++k)
        d.out.r[1 + k] = packs ? d.source(parts.parts[k], part) : d.target(parts.parts[k], part);
    d.emit(packs ? run_pack : run_unpack);
}

// Time is counted in instructions.
template <class T>
void run_clock(Warp& w, const Instruction& i, uint32_t mask) {
    each_lane(w, mask, [&](int t) { w.lanes<T>(i.r[0])[t] = static_cast<T>(w.block.launch.steps); });
}

void decode_mov(Decoder& d) {
    const Type type = d.take_type();
    if (d.operand(1).form == Operand::vector) return decode_pack(d, type, d.operand(0), d.operand(1), true);
    if (d.operand(0).form == Operand::vector) return decode_pack(d, type, d.operand(1), d.operand(0), false);
    d.out.r[0] = d.target(0, type.bytes);
    const std::string& from = d.operand(1).text;
    if (from == "%clock" || from == "%clock64" || from == "%globaltimer")
        return d.emit(type.bytes == 4 ? Run(run_clock<uint32_t>) : Run(run_clock<uint64_t>));
    d.out.r[1] = d.source(1, type.bytes);
    if (type.bytes == 1) return d.emit(run_move<uint8_t>);
    d.emit(with_integer({Kind::bits, type.bytes}, [](auto v) -> Run { return run_move<decltype(v)>; }));
}

uint64_t window_of(Space space) {
    if (space == Space::shared) return kSharedWindow;
    if (space == Space::local) return kLocalWindow;
    return space == Space::param ? kParamWindow : 0;
}

void run_shift_address(Warp& w, const Instruction& i, uint32_t mask) {
    uint64_t* d = w.lanes<uint64_t>(i.r[0]);
    const uint64_t* a = w.lanes<uint64_t>(i.r[1]);
    const auto shift = static_cast<uint64_t>(i.offset);
    each_lane(w, mask, [=](int t) { d[t] = a[t] + shift; });
}

void decode_cvta(Decoder& d) {
    const bool to = d.take("to");
    const Space space = d.take_space();
    const Type type = d.take_type();
    const auto window = static_cast<int64_t>(window_of(space));
    d.out.offset = to ? -window : window;
    same_type_operands(d, type, 1);
    if (type.bytes != 8) d.reject("only addresses of 64 bits are known");
    d.emit(run_shift_address);
}

void run_is_space(Warp& w, const Instruction& i, uint32_t mask) {
    each_lane(w, mask, [&](int t) {
        w.lanes<uint8_t>(i.r[0])[t] = w.lanes<uint64_t>(i.r[1])[t] >> 48 == static_cast<uint64_t>(i.offset);
    });
}

}  // namespace

void add_move_instructions(DecodeTable& table) {
    table["mov"] = decode_mov;
    table["cvta"] = decode_cvta;
    table["isspacep"] = [](Decoder& d) {
        d.out.offset = static_cast<int64_t>(window_of(d.take_space()) >> 48);
        d.out.r[0] = d.target(0, 1);
        d.out.r[1] = d.source(1, 8);
        d.emit(run_is_space);
    };
}

}  // namespace fake
