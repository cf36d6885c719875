// One level of GDR on the CPU, and the choice of the instruction set.
#pragma once

#include <string>
#include <vector>

#include "sweeps.hpp"

namespace stereomend {

// Names of the instruction sets this machine can run, best first.
std::vector<std::string> instruction_sets();

// The sweeps of that name, or the best ones for an empty name. Throws std::invalid_argument for others.
const Sweeps& choose_sweeps(const std::string& name);

// All warps of one level: refines u (height, width) [in/out, px of the level]. p starts at 0.
void solve_level(const Sweeps& sweeps, const Level& level, const SolverParams& params, float* u, int threads);

// Writes the descriptors' distance at every pixel [out, (height, width)].
void descriptor_distance(const Sweeps& sweeps, const Level& level, const float* u, bool absolute, float* out,
                         int threads);

}  // namespace stereomend
