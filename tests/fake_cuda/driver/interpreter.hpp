// A grid of threads, run warp by warp on one core.
#pragma once

#include <cstring>
#include <string>
#include <vector>

#include "instruction.hpp"
#include "memory.hpp"
#include "order.hpp"
#include "races.hpp"

namespace fake {

struct Dim3 {
    uint32_t x = 1;
    uint32_t y = 1;
    uint32_t z = 1;
    uint64_t count() const { return uint64_t{x} * y * z; }
};

// Sums over the launches of a kernel. tests/fake_cuda/device.py reads them in this order.
struct Counters {
    uint64_t launches = 0;
    uint64_t global_read = 0;  // bytes
    uint64_t global_written = 0;
    uint64_t shared_read = 0;
    uint64_t shared_written = 0;
    uint64_t flops = 0;         // a fused multiply-add is two
    uint64_t barriers = 0;      // per block
    uint64_t instructions = 0;  // per thread
};

struct Settings {
    Order order;
    bool find_races = true;
    uint64_t max_steps = 1ull << 31;  // instructions of warps per launch
};

// Threads of a warp at the same instruction.
struct Group {
    enum State : uint8_t { ready, meeting, at_barrier };
    uint32_t pc;
    uint32_t mask;
    State state = ready;
};

struct Block;

struct Warp {
    Block& block;
    uint8_t* frame;
    uint32_t first;   // thread number of lane 0
    uint32_t exists;  // lanes
    uint32_t epoch = 0;
    const Instruction* current = nullptr;
    std::vector<Group> groups;
    uint8_t lane_order[kLanes];

    template <class T>
    T* lanes(uint32_t offset) {
        return reinterpret_cast<T*>(frame + offset);
    }

    uint32_t guard_mask(const Instruction& i, uint32_t mask);

    // Runs until every group waits or has left.
    void run();

   private:
    size_t choose() const;
    void run_group(size_t g);
    bool flow(const Instruction& i, Group& g, uint32_t mask);
    bool branch(const Instruction& i, Group& g, uint32_t mask);
    bool meet(const Instruction& i, Group& g, uint32_t mask);
    void jump_by_table(const Instruction& i, uint32_t mask);
    void split(const uint32_t* targets, uint32_t mask);
    void call(const Instruction& i, Group& g, uint32_t mask);
    void join();
    bool unblock_meeting();
};

struct Launch {
    const Program& program;
    const Function& kernel;
    Dim3 grid;
    Dim3 block;
    uint32_t dynamic_shared;
    const std::vector<uint8_t>& params;
    DeviceMemory& memory;
    Region& shared;
    const Settings& settings;
    uint32_t* stamp;  // time, as in races.hpp
    Counters counters;
    uint64_t steps = 0;

    void run();
};

struct Block {
    Launch& launch;
    Dim3 id;
    uint32_t threads;
    Visitor visitor;  // of the thread that is looked at
    std::vector<uint8_t> local;
    std::vector<uint8_t> frames;
    std::vector<Warp> warps;
    std::vector<uint8_t> shared_state;  // of static variables, at the start of a block

    explicit Block(Launch& launch);

    void run(Dim3 where);
    void start(Dim3 where);

   private:
    void prepare_frame(Warp& warp);
    void fill_special(Warp& warp, const SpecialRegister& special);
    bool release_barrier();
    void pass(uint32_t id);
    [[noreturn]] void report_stall();
};

// The first lanes of a mask, in the order of the run.
template <class F>
void for_lanes(const Warp& warp, uint32_t mask, F f) {
    for (int k = 0; k < kLanes; ++k) {
        const int lane = warp.lane_order[k];
        if (mask >> lane & 1) f(lane);
    }
}

// Raises a fault that says which thread of which kernel did it, and where.
[[noreturn]] void fail(const Warp& warp, int lane, int code, const std::string& what);

constexpr int kMisaligned = 716;
constexpr int kIllegalAddress = 700;
constexpr int kLaunchFailed = 719;
constexpr int kAssert = 710;
constexpr int kTimeout = 702;

}  // namespace fake
