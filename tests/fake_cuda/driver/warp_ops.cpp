// What the threads of a warp tell each other. r[4] holds the member mask.
#include "lanes.hpp"

namespace fake {
namespace {

enum class Direction : int64_t { up, down, butterfly, indexed };

int shuffle_source(Direction direction, uint32_t lane, uint32_t b, uint32_t c) {
    const uint32_t segments = c >> 8 & 31;
    const uint32_t least = lane & segments;
    const uint32_t bound = least | (c & 31 & ~segments);
    const auto distance = static_cast<int>(b & 31);
    const auto here = static_cast<int>(lane);
    switch (direction) {
        case Direction::up: return here - distance >= static_cast<int>(bound) ? here - distance : -1;
        case Direction::down: return here + distance <= static_cast<int>(bound) ? here + distance : -1;
        case Direction::butterfly: return (here ^ distance) <= static_cast<int>(bound) ? here ^ distance : -1;
        default: {
            const uint32_t from = least | (b & 31 & ~segments);
            return from <= bound ? static_cast<int>(from) : -1;
        }
    }
}

// `target` of the instruction is the predicate that says whether the source lane was in range.
void run_shuffle(Warp& w, const Instruction& i, uint32_t mask) {
    uint32_t values[kLanes];
    std::memcpy(values, w.lanes<uint32_t>(i.r[1]), sizeof values);
    for_lanes(w, mask, [&](int lane) {
        const int source = shuffle_source(static_cast<Direction>(i.offset), static_cast<uint32_t>(lane),
                                          w.lanes<uint32_t>(i.r[2])[lane], w.lanes<uint32_t>(i.r[3])[lane]);
        const int from = source < 0 ? lane : source;
        if (!(mask >> from & 1))
            fail(w, lane, kLaunchFailed, "shuffle from lane " + std::to_string(from) + ", which takes no part");
        w.lanes<uint32_t>(i.r[0])[lane] = values[from];
        if (i.target != kNowhere) w.lanes<uint8_t>(i.target)[lane] = source >= 0;
    });
}

void decode_shuffle(Decoder& d) {
    d.out.flow = Flow::meet;
    if (!d.take("sync")) d.reject("shuffles without a member mask are not known");
    const char* names[] = {"up", "down", "bfly", "idx"};
    for (int k = 0; k < 4; ++k)
        if (d.take(names[k])) d.out.offset = k;
    d.take_type();
    const bool pair = d.operand(0).paired;
    d.out.target = pair ? d.target(1, 1) : kNowhere;
    d.out.r[0] = d.target(0, 4);
    for (size_t k = 1; k <= 4; ++k) d.out.r[k] = d.source(k + (pair ? 1 : 0), 4);
    d.emit(run_shuffle);
}

uint32_t votes_of(Warp& w, const Instruction& i, uint32_t mask) {
    uint32_t votes = 0;
    for_lanes(w, mask, [&](int lane) {
        if ((w.lanes<uint8_t>(i.r[1])[lane] != 0) != i.extends_sign) votes |= 1u << lane;
    });
    return votes;
}

template <class T, class F>
void give_all(Warp& w, const Instruction& i, uint32_t mask, F value) {
    for_lanes(w, mask, [&](int lane) { w.lanes<T>(i.r[0])[lane] = static_cast<T>(value); });
}

void run_ballot(Warp& w, const Instruction& i, uint32_t mask) { give_all<uint32_t>(w, i, mask, votes_of(w, i, mask)); }
void run_any(Warp& w, const Instruction& i, uint32_t mask) { give_all<uint8_t>(w, i, mask, votes_of(w, i, mask) != 0); }
void run_all(Warp& w, const Instruction& i, uint32_t mask) {
    give_all<uint8_t>(w, i, mask, votes_of(w, i, mask) == mask);
}
void run_uniform(Warp& w, const Instruction& i, uint32_t mask) {
    const uint32_t votes = votes_of(w, i, mask);
    give_all<uint8_t>(w, i, mask, votes == 0 || votes == mask);
}

void decode_vote(Decoder& d) {
    d.out.flow = Flow::meet;
    if (!d.take("sync")) d.reject("votes without a member mask are not known");
    const Run run = d.take("ballot") ? run_ballot
                    : d.take("any")  ? run_any
                    : d.take("all")  ? run_all
                    : d.take("uni")  ? run_uniform
                                     : nullptr;
    if (!run) d.reject("this vote is not known");
    const Type type = d.take_type();
    d.out.r[0] = d.target(0, type.bytes);
    d.out.extends_sign = d.operand(1).negated;
    d.out.r[1] = d.source(1, 1);
    d.out.r[4] = d.source(2, 4);
    d.emit(run);
}

void run_activemask(Warp& w, const Instruction& i, uint32_t mask) { give_all<uint32_t>(w, i, mask, mask); }

template <class T>
void run_match_any(Warp& w, const Instruction& i, uint32_t mask) {
    const T* a = w.lanes<T>(i.r[1]);
    for_lanes(w, mask, [&](int lane) {
        uint32_t same = 0;
        for_lanes(w, mask, [&](int other) { same |= static_cast<uint32_t>(a[other] == a[lane]) << other; });
        w.lanes<uint32_t>(i.r[0])[lane] = same;
    });
}

void decode_match(Decoder& d) {
    d.out.flow = Flow::meet;
    d.take("sync");
    if (!d.take("any")) d.reject("only match.any is known");
    const Type type = d.take_type();
    d.out.r[0] = d.target(0, 4);
    d.out.r[1] = d.source(1, type.bytes);
    d.out.r[4] = d.source(2, 4);
    d.emit(type.bytes == 4 ? run_match_any<uint32_t> : run_match_any<uint64_t>);
}

template <class T, class F>
void reduce(Warp& w, const Instruction& i, uint32_t mask, F combine) {
    T sum = w.lanes<T>(i.r[1])[__builtin_ctz(mask)];
    for_lanes(w, mask & (mask - 1), [&](int lane) { sum = combine(sum, w.lanes<T>(i.r[1])[lane]); });
    give_all<T>(w, i, mask, sum);
}

template <class T>
Run take_reduction(Decoder& d) {
    if (d.take("add"))
        return [](Warp& w, const Instruction& i, uint32_t m) {
            reduce<uint32_t>(w, i, m, [](auto a, auto b) { return a + b; });
        };
    if (d.take("min"))
        return [](Warp& w, const Instruction& i, uint32_t m) {
            reduce<T>(w, i, m, [](T a, T b) { return b < a ? b : a; });
        };
    if (d.take("max"))
        return [](Warp& w, const Instruction& i, uint32_t m) {
            reduce<T>(w, i, m, [](T a, T b) { return a < b ? b : a; });
        };
    if (d.take("and"))
        return [](Warp& w, const Instruction& i, uint32_t m) { reduce<T>(w, i, m, [](T a, T b) { return a & b; }); };
    if (d.take("or"))
        return [](Warp& w, const Instruction& i, uint32_t m) { reduce<T>(w, i, m, [](T a, T b) { return a | b; }); };
    if (d.take("xor"))
        return [](Warp& w, const Instruction& i, uint32_t m) { reduce<T>(w, i, m, [](T a, T b) { return a ^ b; }); };
    return nullptr;
}

void decode_redux(Decoder& d) {
    d.out.flow = Flow::meet;
    d.take("sync");
    const Type type = d.take_type();
    const Run run = type.kind == Kind::integer ? take_reduction<int32_t>(d) : take_reduction<uint32_t>(d);
    if (!run || type.kind == Kind::real) d.reject("this reduction is not known");
    d.out.r[0] = d.target(0, 4);
    d.out.r[1] = d.source(1, 4);
    d.out.r[4] = d.source(2, 4);
    d.emit(run);
}

}  // namespace

void add_warp_instructions(DecodeTable& table) {
    table["shfl"] = decode_shuffle;
    table["vote"] = decode_vote;
    table["match"] = decode_match;
    table["redux"] = decode_redux;
    table["activemask"] = [](Decoder& d) {
        d.take_type();
        d.out.r[0] = d.target(0, 4);
        d.emit(run_activemask);
    };
}

}  // namespace fake
