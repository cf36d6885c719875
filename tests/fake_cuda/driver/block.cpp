// A block: its warps take turns, each until it waits at a barrier.
#include <algorithm>

#include "interpreter.hpp"

namespace fake {

Block::Block(Launch& launch) : launch(launch), threads(static_cast<uint32_t>(launch.block.count())), visitor{} {
    const Program& program = launch.program;
    const uint32_t warp_count = (threads + kLanes - 1) / kLanes;
    local.assign(uint64_t{threads} * program.local_valid.size(), 0);
    frames.assign(uint64_t{warp_count} * program.frame_bytes + 64, 0);
    shared_state.assign(program.shared_bytes, kOutside);
    std::memset(launch.shared.state, kOutside, kSharedBytes);
    const auto open = [&](const SharedVariable& v) { std::memset(&shared_state[v.offset], kUnwritten, v.bytes); };
    for (const auto& variable : program.shared) open(variable);
    for (const Function& f : program.functions)
        if (!f.kernel || &f == &launch.kernel)
            for (const auto& variable : f.shared) open(variable);
    auto* frame = reinterpret_cast<uint8_t*>((reinterpret_cast<uint64_t>(frames.data()) + 63) / 64 * 64);
    for (uint32_t w = 0; w < warp_count; ++w) {
        const uint32_t lanes = std::min<uint32_t>(kLanes, threads - w * kLanes);
        warps.push_back({*this,
                         frame + uint64_t{w} * program.frame_bytes,
                         w * kLanes,
                         lanes == kLanes ? 0xffffffffu : (1u << lanes) - 1,
                         0,
                         nullptr,
                         {},
                         {}});
    }
    for (Warp& warp : warps) prepare_frame(warp);
}

void Block::prepare_frame(Warp& warp) {
    for (const Function& f : launch.program.functions) {
        if (f.kernel && &f != &launch.kernel) continue;
        for (const Constant& c : f.constants)
            for (int lane = 0; lane < kLanes; ++lane)
                std::memcpy(warp.frame + c.offset + lane * c.bytes, &c.bits, c.bytes);
        for (const SpecialRegister& s : f.specials) fill_special(warp, s);
    }
}

void Block::fill_special(Warp& warp, const SpecialRegister& special) {
    const Dim3 b = launch.block;
    const auto warp_count = static_cast<uint32_t>(warps.size());
    for (uint32_t lane = 0; lane < kLanes; ++lane) {
        const uint32_t t = warp.first + lane;
        const uint32_t values[] = {t % b.x,
                                   t / b.x % b.y,
                                   t / b.x / b.y,
                                   b.x,
                                   b.y,
                                   b.z,
                                   id.x,
                                   id.y,
                                   id.z,
                                   launch.grid.x,
                                   launch.grid.y,
                                   launch.grid.z,
                                   lane,
                                   warp.first / kLanes,
                                   warp_count,
                                   0,
                                   1,
                                   1u << lane,
                                   (1u << lane) - 1,
                                   (2u << lane) - 1,
                                   ~((2u << lane) - 1),
                                   ~((1u << lane) - 1),
                                   launch.dynamic_shared,
                                   launch.dynamic_shared + launch.program.shared_bytes,
                                   0,
                                   0};
        warp.lanes<uint32_t>(special.offset)[lane] = values[static_cast<size_t>(special.which)];
    }
}

void Block::start(Dim3 where) {
    id = where;
    visitor.block = visitor.now = ++*launch.stamp;
    visitor.synchronised = false;
    std::memcpy(launch.shared.state, shared_state.data(), shared_state.size());
    std::memset(launch.shared.state + kDynamicShared, kUnwritten, launch.dynamic_shared);
    for (Warp& warp : warps) {
        warp.epoch = 0;
        warp.groups = {{launch.kernel.entry, warp.exists}};
        launch.settings.order.arrange(warp.lane_order, kLanes, warp.first + visitor.block);
        for (const Function& f : launch.program.functions)
            for (const SpecialRegister& s : f.specials)
                if (s.which >= Special::ctaid_x && s.which <= Special::ctaid_z && (!f.kernel || &f == &launch.kernel))
                    fill_special(warp, s);
    }
}

void Block::run(Dim3 where) {
    start(where);
    std::vector<uint32_t> turns(warps.size());
    do {
        launch.settings.order.arrange(turns.data(), turns.size(), visitor.now);
        for (const uint32_t w : turns) warps[w].run();
    } while (release_barrier());
}

// False when all threads have left. A barrier passes when everybody it is for waits at the same place.
bool Block::release_barrier() {
    struct Waiting {
        uint32_t threads = 0;
        uint32_t needed = 0;
        uint32_t pc = kNowhere;
        bool split = false;
    } waiting[16];
    bool any = false;
    for (Warp& warp : warps)
        for (const Group& g : warp.groups) {
            const Instruction& i = launch.program.code[g.pc];
            const int lane = __builtin_ctz(g.mask);
            Waiting& w = waiting[warp.lanes<uint32_t>(i.r[1])[lane] & 15];
            any = true;
            w.threads += static_cast<uint32_t>(__builtin_popcount(g.mask));
            w.needed = i.named_count ? warp.lanes<uint32_t>(i.r[2])[lane] : threads;
            w.split |= !i.named_count && w.pc != kNowhere && w.pc != g.pc;
            w.pc = g.pc;
        }
    if (!any) return false;
    for (uint32_t barrier = 0; barrier < 16; ++barrier)
        if (waiting[barrier].needed && waiting[barrier].threads == waiting[barrier].needed && !waiting[barrier].split) {
            pass(barrier);
            return true;
        }
    report_stall();
}

// bar.red combines a predicate of all threads: r[0] is the result, r[3] the predicate, `count` says how.
void Block::pass(uint32_t barrier) {
    const auto waits = [&](Warp& warp, const Group& g) {
        const Instruction& i = launch.program.code[g.pc];
        return g.state == Group::at_barrier && (warp.lanes<uint32_t>(i.r[1])[__builtin_ctz(g.mask)] & 15) == barrier;
    };
    uint32_t votes = 0;
    uint32_t voters = 0;
    for (Warp& warp : warps)
        for (const Group& g : warp.groups)
            if (waits(warp, g) && launch.program.code[g.pc].r[3] != kNowhere)
                for_lanes(warp, g.mask, [&](int lane) {
                    ++voters;
                    const Instruction& i = launch.program.code[g.pc];
                    votes += (warp.lanes<uint8_t>(i.r[3])[lane] != 0) != i.extends_sign;
                });
    for (Warp& warp : warps)
        for (Group& g : warp.groups)
            if (waits(warp, g)) {
                const Instruction& i = launch.program.code[g.pc];
                if (i.r[3] != kNowhere)
                    for_lanes(warp, g.mask, [&](int lane) {
                        if (i.bytes == 4) warp.lanes<uint32_t>(i.r[0])[lane] = votes;
                        else warp.lanes<uint8_t>(i.r[0])[lane] = i.count == 1 ? votes == voters : votes > 0;
                    });
                g.state = Group::ready;
                ++g.pc;
            }
    visitor.now = ++*launch.stamp;
    ++launch.counters.barriers;
}

void Block::report_stall() {
    std::string places;
    uint32_t here = 0;
    Warp* last = nullptr;
    for (Warp& warp : warps)
        for (const Group& g : warp.groups) {
            here += static_cast<uint32_t>(__builtin_popcount(g.mask));
            const std::string place = " line " + std::to_string(launch.program.code[g.pc].line);
            if (places.find(place) == std::string::npos) places += place;
            warp.current = &launch.program.code[g.pc];
            last = &warp;
        }
    fail(*last, __builtin_ctz(last->groups.back().mask), kLaunchFailed,
         "divergent barrier: " + std::to_string(here) + " of " + std::to_string(threads) + " threads wait (PTX" +
             places + "), " + std::to_string(threads - here) + " have left");
}

void Launch::run() {
    const uint32_t launch_stamp = ++*stamp;
    Block worker(*this);
    worker.visitor.launch = launch_stamp;
    std::vector<uint32_t> turns(grid.count());
    settings.order.arrange(turns.data(), turns.size(), launch_stamp);
    ++counters.launches;
    for (const uint32_t turn : turns) worker.run({turn % grid.x, turn / grid.x % grid.y, turn / grid.x / grid.y});
}

void fail(const Warp& warp, int lane, int code, const std::string& what) {
    const Launch& launch = warp.block.launch;
    const uint32_t t = warp.first + static_cast<uint32_t>(lane);
    const Dim3 b = launch.block;
    const Dim3 id = warp.block.id;
    const auto triple = [](uint32_t x, uint32_t y, uint32_t z) {
        return "(" + std::to_string(x) + "," + std::to_string(y) + "," + std::to_string(z) + ")";
    };
    std::string text = what + ": kernel " + launch.kernel.name + ", block " + triple(id.x, id.y, id.z) + ", thread " +
                       triple(t % b.x, t / b.x % b.y, t / b.x / b.y);
    if (warp.current) {
        const uint32_t line = warp.current->line;
        text += ", PTX line " + std::to_string(line) + ": " + launch.program.source[line - 1];
    }
    throw Fault(code, text);
}

}  // namespace fake
