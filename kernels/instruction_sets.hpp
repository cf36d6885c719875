// The tables of row loops by instruction set, best first. For engine.cpp alone.
#pragma once

#include <stdexcept>
#include <string>

#include "engine.hpp"

namespace stereomend {
namespace {

struct Candidate {
    const char* name;
    const Sweeps* gdr;
    const LdrSweeps* ldr;
    const EvidenceSweeps* evidence;
    const FusionSweeps* fusion;
    const ResizeSweeps* resize;
    bool (*supported)();
};

#ifdef HAVE_SWEEPS_v3
bool has_v3() {
    return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") &&
           __builtin_cpu_supports("bmi2");
}

bool has_v2() { return __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt"); }

const Candidate kCandidates[] = {
    {"x86-64-v3", &sweeps_v3, &ldr_sweeps_v3, &evidence_sweeps_v3, &fusion_sweeps_v3, &resize_sweeps_v3, has_v3},
    {"x86-64-v2", &sweeps_v2, &ldr_sweeps_v2, &evidence_sweeps_v2, &fusion_sweeps_v2, &resize_sweeps_v2, has_v2}};
#else
bool always() { return true; }

const Candidate kCandidates[] = {{"generic", &sweeps_generic, &ldr_sweeps_generic, &evidence_sweeps_generic,
                                  &fusion_sweeps_generic, &resize_sweeps_generic, always}};
#endif

const Candidate& best(const std::string& name) {
    for (const Candidate& candidate : kCandidates)
        if (candidate.supported() && (name.empty() || name == candidate.name)) return candidate;
    throw std::invalid_argument("instruction set '" + name + "' is not available on this machine");
}

}  // namespace
}  // namespace stereomend
