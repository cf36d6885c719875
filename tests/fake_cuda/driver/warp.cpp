// The threads of a warp: groups at the same instruction, of which the hindmost goes first, so that they meet again.
#include <algorithm>

#include "interpreter.hpp"

namespace fake {
namespace {

// Eight bytes of 0 or 1 as bits.
uint32_t packed(const uint8_t* flags) {
    uint32_t mask = 0;
    for (int k = 0; k < 4; ++k) {
        uint64_t eight;
        std::memcpy(&eight, flags + 8 * k, 8);
        mask |= static_cast<uint32_t>(eight * 0x0102040810204080ull >> 56) << 8 * k;
    }
    return mask;
}

}  // namespace

uint32_t Warp::guard_mask(const Instruction& i, uint32_t mask) {
    const uint32_t flags = packed(lanes<uint8_t>(i.guard));
    return mask & (i.guard_negated ? ~flags : flags);
}

size_t Warp::choose() const {
    size_t best = groups.size();
    for (size_t g = 0; g < groups.size(); ++g)
        if (groups[g].state == Group::ready && (best == groups.size() || groups[g].pc < groups[best].pc)) best = g;
    return best;
}

void Warp::run() {
    for (;;) {
        join();
        const size_t g = choose();
        if (g < groups.size()) run_group(g);
        else if (!unblock_meeting()) return;
    }
}

// Groups at the same instruction become one.
void Warp::join() {
    for (size_t a = 0; a < groups.size(); ++a)
        for (size_t b = groups.size(); b-- > a + 1;) {
            if (groups[a].pc != groups[b].pc ||
                (groups[a].state == Group::at_barrier) != (groups[b].state == Group::at_barrier))
                continue;
            groups[a].mask |= groups[b].mask;
            if (groups[b].state != groups[a].state) groups[a].state = Group::ready;
            groups.erase(groups.begin() + static_cast<std::ptrdiff_t>(b));
        }
}

void Warp::run_group(size_t index) {
    Group g = groups[index];
    groups.erase(groups.begin() + static_cast<std::ptrdiff_t>(index));
    uint32_t limit = kNowhere;
    for (const Group& other : groups)
        if (other.state != Group::at_barrier) limit = std::min(limit, other.pc > g.pc ? other.pc : kNowhere);
    Launch& launch = block.launch;
    const Instruction* code = launch.program.code.data();
    const uint64_t max_steps = launch.settings.max_steps;
    for (;;) {
        const Instruction& i = code[g.pc];
        current = &i;
        const uint32_t mask = i.guard == kNowhere ? g.mask : guard_mask(i, g.mask);
        const auto threads = static_cast<uint32_t>(__builtin_popcount(mask));
        launch.counters.instructions += threads;
        launch.counters.flops += threads * i.flops;
        if (++launch.steps > max_steps) fail(*this, __builtin_ctz(g.mask), kTimeout, "the kernel does not end");
        if (i.flow == Flow::plain) {
            if (mask) i.run(*this, i, mask);
            ++g.pc;
        } else if (!flow(i, g, mask)) {
            return;
        }
        if (g.pc >= limit) break;
    }
    groups.push_back(g);
}

bool Warp::branch(const Instruction& i, Group& g, uint32_t mask) {
    if (mask == g.mask) {
        g.pc = i.target;
        return true;
    }
    if (!mask) return ++g.pc, true;
    groups.push_back({i.target, mask});
    groups.push_back({g.pc + 1, g.mask & ~mask});
    return false;
}

// Waits until all lanes of the member mask that have not left are here.
bool Warp::meet(const Instruction& i, Group& g, uint32_t mask) {
    if (!mask) return ++g.pc, true;
    const uint32_t member = lanes<uint32_t>(i.r[4])[__builtin_ctz(mask)] & exists;
    uint32_t alive = g.mask;
    for (const Group& other : groups) alive |= other.mask;
    if (mask & ~member)
        fail(*this, __builtin_ctz(mask & ~member), kLaunchFailed, "a thread that the member mask leaves out");
    if (member & alive & ~mask) {
        g.state = Group::meeting;
        groups.push_back(g);
        return false;
    }
    i.run(*this, i, mask);
    return ++g.pc, true;
}

void Warp::jump_by_table(const Instruction& i, uint32_t mask) {
    uint32_t targets[kLanes];
    const auto& table = block.launch.program.functions[i.target].tables[static_cast<size_t>(i.offset)];
    for_lanes(*this, mask, [&](int lane) {
        const uint32_t index = lanes<uint32_t>(i.r[1])[lane];
        if (index >= table.size()) fail(*this, lane, kLaunchFailed, "an indexed branch outside of its table");
        targets[lane] = table[index];
    });
    split(targets, mask);
}

// False if the group was put aside or has left.
bool Warp::flow(const Instruction& i, Group& g, uint32_t mask) {
    if (i.flow == Flow::branch) return branch(i, g, mask);
    if (i.flow == Flow::meet) return meet(i, g, mask);
    const uint32_t rest = g.mask & ~mask;  // does not call, return, leave or wait
    if (rest) groups.push_back({g.pc + 1, rest});
    if (!mask) return false;
    g.mask = mask;
    switch (i.flow) {
        case Flow::leave: break;
        case Flow::barrier:
            g.state = Group::at_barrier;
            groups.push_back(g);
            break;
        case Flow::call:
            call(i, g, mask);
            groups.push_back(g);
            break;
        case Flow::ret: split(lanes<uint32_t>(block.launch.program.functions[i.target].return_register), mask); break;
        case Flow::table: jump_by_table(i, mask); break;
        default: fail(*this, __builtin_ctz(mask), kLaunchFailed, "an instruction without meaning");
    }
    return false;
}

// Each lane goes to its own target.
void Warp::split(const uint32_t* targets, uint32_t mask) {
    while (mask) {
        const uint32_t target = targets[__builtin_ctz(mask)];
        uint32_t same = 0;
        for (int lane = 0; lane < kLanes; ++lane)
            if ((mask >> lane & 1) && targets[lane] == target) same |= 1u << lane;
        groups.push_back({target, same});
        mask &= ~same;
    }
}

// Arguments are copied in here; results are copied out by the instruction after the call.
void Warp::call(const Instruction& i, Group& g, uint32_t mask) {
    const Program& program = block.launch.program;
    const Call& made = program.functions[static_cast<size_t>(i.offset)].calls[i.target];
    const Function& callee = program.functions[made.function];
    const size_t stride = program.local_valid.size();
    for_lanes(*this, mask, [&](int lane) {
        uint8_t* local = block.local.data() + (first + static_cast<uint32_t>(lane)) * stride;
        for (size_t k = 0; k < callee.params.size(); ++k)
            std::memcpy(local + callee.params[k].offset, local + made.arguments[k], callee.params[k].bytes);
        lanes<uint32_t>(callee.return_register)[lane] = g.pc + 1;
    });
    g.pc = callee.entry;
}

// Lanes that wait for lanes that cannot come any more: nothing is left but an error.
bool Warp::unblock_meeting() {
    for (const Group& g : groups) {
        if (g.state != Group::meeting) continue;
        current = &block.launch.program.code[g.pc];
        fail(*this, __builtin_ctz(g.mask), kLaunchFailed, "lanes of the member mask never come to this instruction");
    }
    return false;
}

}  // namespace fake
