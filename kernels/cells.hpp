// Wide means on a coarse grid on the CPU: what the choice between two maps is made on (R7 to R9).
#pragma once

#include "fusion.hpp"

namespace stereomend {

// Lengths in px, the rest without unit; see docs/robust.md.
struct GroundRule {
    double trust;      // standard deviation of the window of trust
    double evidence;   // and of that evidence is compared in
    double far;        // times as wide: the faint window that carries trust over gaps
    double far_share;  // its weight
    double min_trust;
    double full_trust;
    double worse_by;
    double equal_within;
};

// Trust, where the upload is as good, and the usual evidence, from what pixels voted (`poll`) [out, (height, width)].
void ground(Size size, const double* polls, const GroundRule& rule, float* const out[3], const FusionCrew& crew);

// A map [px] bent towards the plane around it where its match lies outside of the right image [out].
void bend(Size size, const float* u, const double* polls, const BendRule& rule, float* out, const FusionCrew& crew);

}  // namespace stereomend
