// What the fake driver knows, and what all its entry points have in common.
#pragma once

#include <chrono>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "interpreter.hpp"

#define FAKE_API extern "C" __attribute__((visibility("default"))) int

namespace fake {

// The results of the driver API that are answered here.
constexpr int kSuccess = 0;
constexpr int kInvalidValue = 1;
constexpr int kOutOfMemory = 2;
constexpr int kNotInitialised = 3;
constexpr int kNoDevice = 100;
constexpr int kInvalidDevice = 101;
constexpr int kInvalidContext = 201;
constexpr int kNoBinary = 209;
constexpr int kInvalidPtx = 218;
constexpr int kFileNotFound = 301;
constexpr int kInvalidHandle = 400;
constexpr int kNotFound = 500;
constexpr int kNotReady = 600;
constexpr int kOutOfResources = 701;
constexpr int kNotSupported = 801;

struct Module {
    Program program;
};

struct Kernel {
    Module* module;
    const Function* function;
    uint32_t dynamic_limit;
};

struct Context {
    bool primary = false;
    int users = 1;
};

struct Stream {};

struct Event {
    std::chrono::steady_clock::time_point time;
    bool recorded = false;
    bool done = false;
};

// What the host did. tests/fake_cuda/device.py reads these in this order.
struct HostCounters {
    uint64_t synchronisations = 0;  // calls that wait for the device
    uint64_t allocations = 0;
    uint64_t frees = 0;
    uint64_t bytes_to_device = 0;
    uint64_t bytes_to_host = 0;
    uint64_t unwritten_bytes_to_host = 0;
};

// A fault to come: `after` more calls succeed, then `times` fail. Negative: none.
struct Planned {
    int64_t after = -1;
    int code = kLaunchFailed;
    int times = 1;

    bool strikes() {
        if (after < 0) return false;
        if (after > 0) return --after, false;
        if (--times == 0) after = -1;
        return true;
    }
};

constexpr int kTries = 2;  // PyCUDA collects garbage and asks again where it gets no memory

struct Driver {
    Driver();

    std::recursive_mutex mutex;
    bool initialised = false;
    int devices = 1;
    int arch = 86;
    bool lazy = false;  // work waits in a queue until somebody synchronises
    Settings settings;
    std::unique_ptr<DeviceMemory> memory;
    Region shared{0, kSharedBytes};
    uint32_t stamp = 0;
    int sticky = kSuccess;
    std::string message;  // of the last error
    std::map<std::string, Counters> counters;
    HostCounters host;
    Planned failing_launch;
    Planned failing_allocation;
    std::string fault_file;  // its path; empty: none is looked for
    Context primary{true, 0};
    std::set<Context*> contexts;
    std::set<Module*> modules;
    std::map<std::pair<Module*, std::string>, std::unique_ptr<Kernel>> kernels;
    std::set<Kernel*> kernel_handles;
    std::set<Stream*> streams;
    std::set<Event*> events;
    std::map<uint64_t, uint64_t> pinned;  // address, bytes
    std::deque<std::function<int()>> queue;

    // Errors that make the device unusable stay, others do not.
    int break_down(int code, const std::string& what);
    // Takes over the plan of the fault file, if there is one.
    void look_for_faults();
    int reject(int code, const std::string& what);
    int submit(std::function<int()> work);
    int work_off_one();
    int drain();
    int synchronise();
    bool is_pinned(const void* host, uint64_t bytes) const;
};

Driver& driver();

std::vector<Context*>& context_stack();  // of this thread

// Runs f if the driver is up, a context is current and nothing has broken down.
template <class F>
int guarded(F f) {
    Driver& d = driver();
    const std::lock_guard<std::recursive_mutex> lock(d.mutex);
    if (!d.initialised) return kNotInitialised;
    if (context_stack().empty()) return kInvalidContext;
    if (d.sticky) return d.sticky;
    try {
        return f(d);
    } catch (const std::bad_alloc&) {
        return kOutOfMemory;
    }
}

}  // namespace fake
