// The choice between two maps on the CPU (R8 to R10).
#pragma once

#include "evidence.hpp"
#include "fusion_sweeps.hpp"

namespace stereomend {

// Memory that stays from one call to the next.
struct CellBuffers {
    std::vector<double> cells;
    std::vector<double> scratch;
};

// Who works, where and with what.
struct FusionCrew {
    const EvidenceCrew& evidence;
    const FusionSweeps& sweeps;
    CellBuffers& buffers;
};

// The means over cells of what pixels vote [out, kPolls planes of cells_of(height) x cells_of(width)].
void poll(const Rivals& rivals, const PollMarks& marks, const PollRule& rule, double* out, const FusionCrew& crew);

// The share of the upload at every pixel, 0 to 1 [out].
void choose(const Rivals& rivals, const Grounds& grounds, const ChoiceRule& rule, float* out, const FusionCrew& crew);

}  // namespace stereomend
