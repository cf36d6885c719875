// The steps of LDR on the CPU.
#pragma once

#include <vector>

#include "ldr_sweeps.hpp"
#include "team.hpp"

namespace stereomend {

// Memory that stays from one call to the next.
struct LdrBuffers {
    std::vector<float> planes;
};

// Who works, where and with what.
struct Crew {
    Team& team;
    LdrBuffers& buffers;
    const LdrSweeps& sweeps;
};

// C_f = M_b M_s C_p C_s^power, in [0, 1], 0 where u is unknown (Eq. 1 to 4) [out, (height, width)].
void confidence(const ConfidenceInput& input, const ConfidenceParams& params, float* out, const Crew& crew);

// A map with holes where it is not known; u [px] is [in/out].
struct Holes {
    Size size;
    float* u;
    const bool* known;
};

// Replaces u where it is not known by the median of the first known values met along eight directions within
// `steps` steps; repeats up to `passes` times, then takes the nearest known value (of equally near ones the
// leftmost, then the upper). With nothing known, u stays as it is.
void fill(const Holes& map, int steps, int passes, const Crew& crew);

// Replaces the occlusions of u by the value on their left; says which pixels those are [out].
void fill_occlusions(const Holes& map, const OcclusionRule& rule, bool* filled, const Crew& crew);

// What can be reached [in/out] from what is reached already: along every row to the right and to the left, then down
// and up every column.
void reach(const Terrain& terrain, bool* reached, const Crew& crew);

}  // namespace stereomend
