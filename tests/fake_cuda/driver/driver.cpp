#include "driver.hpp"

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>

namespace fake {
namespace {

std::string environment(const char* name, const char* otherwise) {
    const char* value = std::getenv(name);
    return value ? value : otherwise;
}

// "2" or "2:700"
Planned planned(const std::string& text, int code, int times) {
    Planned plan{-1, code, times};
    if (text.empty()) return plan;
    plan.after = std::atoll(text.c_str());
    const size_t colon = text.find(':');
    if (colon != std::string::npos) plan.code = std::atoi(text.c_str() + colon + 1);
    return plan;
}

// Of a kernel, or of the hardware under it: after them nothing works any more.
bool is_sticky(int code) {
    static const std::set<int> codes = {214, 220, 226, 700, 702, 709, 710, 714, 715, 716, 717, 718, 719, 721, 999};
    return codes.count(code) > 0;
}

}  // namespace

Driver::Driver() {
    devices = std::atoi(environment("FAKE_CUDA_DEVICES", "1").c_str()) > 0 ? 1 : 0;
    arch = std::atoi(environment("FAKE_CUDA_ARCH", "86").c_str());
    lazy = environment("FAKE_CUDA_ASYNC", "eager") == "lazy";
    settings.find_races = environment("FAKE_CUDA_RACES", "on") != "off";
    settings.max_steps = std::strtoull(environment("FAKE_CUDA_MAX_STEPS", "2147483648").c_str(), nullptr, 10);
    if (!Order::parse(environment("FAKE_CUDA_ORDER", "forward"), &settings.order)) {
        std::fprintf(stderr, "FAKE_CUDA_ORDER is forward, reverse or shuffled:SEED\n");
        std::abort();
    }
    const auto mebibytes = std::strtoull(environment("FAKE_CUDA_MEMORY", "8192").c_str(), nullptr, 10);
    memory = std::make_unique<DeviceMemory>(mebibytes << 20);
    failing_launch = planned(environment("FAKE_CUDA_FAIL_LAUNCH", ""), kLaunchFailed, 1);
    failing_allocation = planned(environment("FAKE_CUDA_FAIL_ALLOCATION", ""), kOutOfMemory, kTries);
    fault_file = environment("FAKE_CUDA_FAULT_FILE", "");
}

Driver& driver() {
    static Driver* the = new Driver;  // outlives whoever cleans up at exit
    return *the;
}

std::vector<Context*>& context_stack() {
    thread_local std::vector<Context*> stack;
    return stack;
}

int Driver::break_down(int code, const std::string& what) {
    if (!is_sticky(code)) return reject(code, what);
    sticky = code;
    queue.clear();
    return reject(code, what);
}

// Renamed first, so that one process alone has it.
void Driver::look_for_faults() {
    if (fault_file.empty()) return;
    const std::string mine = fault_file + "." + std::to_string(getpid());
    if (std::rename(fault_file.c_str(), mine.c_str())) return;
    std::string what;
    std::string plan;
    std::ifstream(mine) >> what >> plan;
    std::remove(mine.c_str());
    if (what == "launch") failing_launch = planned(plan, kLaunchFailed, 1);
    if (what == "allocation") failing_allocation = planned(plan, kOutOfMemory, kTries);
}

int Driver::reject(int code, const std::string& what) {
    message = what;
    return code;
}

int Driver::submit(std::function<int()> work) {
    if (!lazy) return work();
    queue.push_back(std::move(work));
    return kSuccess;
}

int Driver::work_off_one() {
    const auto work = std::move(queue.front());
    queue.pop_front();
    return work();
}

int Driver::drain() {
    while (!queue.empty()) {
        const int result = work_off_one();
        if (result) return result;
    }
    return kSuccess;
}

int Driver::synchronise() {
    ++host.synchronisations;
    return drain();
}

bool Driver::is_pinned(const void* host_address, uint64_t bytes) const {
    const auto address = reinterpret_cast<uint64_t>(host_address);
    auto after = pinned.upper_bound(address);
    if (after == pinned.begin()) return false;
    --after;
    return address + bytes <= after->first + after->second;
}

}  // namespace fake
