// What tests ask of the fake driver beyond CUDA.
#include <cstring>

#include "driver.hpp"

using namespace fake;

// What the last error was about; empty if there was none.
extern "C" __attribute__((visibility("default"))) const char* fake_cuda_message() { return driver().message.c_str(); }

// Eight sums as in struct Counters; all zero for a kernel that never ran. Waits for work in the queue.
FAKE_API fake_cuda_counters(const char* kernel, uint64_t* values) {
    Driver& d = driver();
    const int result = d.drain();
    const auto found = d.counters.find(kernel);
    const Counters sums = found == d.counters.end() ? Counters{} : found->second;
    std::memcpy(values, &sums, sizeof sums);
    return result;
}

// Names of the kernels that ran, one per line; returns how many bytes that takes.
FAKE_API fake_cuda_kernels(char* text, int size) {
    std::string names;
    for (const auto& [name, counters] : driver().counters) names += name + "\n";
    if (size > static_cast<int>(names.size())) std::strcpy(text, names.c_str());
    return static_cast<int>(names.size()) + 1;
}

// Six sums as in struct HostCounters.
FAKE_API fake_cuda_host_counters(uint64_t* values) {
    std::memcpy(values, &driver().host, sizeof(HostCounters));
    return kSuccess;
}

FAKE_API fake_cuda_reset_counters() {
    driver().counters.clear();
    driver().host = {};
    return kSuccess;
}

// The launch after `after` others breaks the device down with `code`.
FAKE_API fake_cuda_fail_launch(int64_t after, int code) { return driver().failing_launch = {after, code, 1}, kSuccess; }

// The allocation after `after` others finds no memory.
FAKE_API fake_cuda_fail_allocation(int64_t after) {
    return driver().failing_allocation = {after, kOutOfMemory, kTries}, kSuccess;
}

// A new device: forgets a breakdown and what was planned.
FAKE_API fake_cuda_repair() {
    Driver& d = driver();
    d.sticky = kSuccess;
    d.message.clear();
    d.queue.clear();
    d.failing_launch = d.failing_allocation = {};
    return kSuccess;
}

FAKE_API fake_cuda_set_order(const char* text) {
    return Order::parse(text, &driver().settings.order) ? kSuccess : kInvalidValue;
}
