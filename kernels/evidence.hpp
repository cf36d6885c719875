// What the pair says for a map, on the CPU (R1), and the weights of the smoothness (R4).
#pragma once

#include <vector>

#include "evidence_sweeps.hpp"
#include "team.hpp"

namespace stereomend {

// Memory that stays from one call to the next.
struct EvidenceBuffers {
    std::vector<float> scratch;
    std::vector<float> planes;
    std::vector<uint8_t> flags;
    std::vector<uint8_t> marks;
    std::vector<uint64_t> bits;
    std::vector<Run> runs;
};

// Who works, where and with what.
struct EvidenceCrew {
    Team& team;
    EvidenceBuffers& buffers;
    const EvidenceSweeps& sweeps;
    const LdrSweeps& ldr;
};

// n of each map, -1 to 1 [out, (height, width) each].
void evidence(const Pair& pair, const std::vector<const float*>& maps, const std::vector<float*>& found,
              const EvidenceCrew& crew);

// Patches of at most `largest` pixels, whose disparity changes by at most `step` [px], are speckles.
struct SpeckleRule {
    int largest;
    float step;
};

// Which valid pixels belong to speckles [out]; patches are connected along rows and columns.
void speckles(const Steps& map, int largest, bool* out, const EvidenceCrew& crew);

// c of a map, 0 to 1 [out]: n and smoothness, 0 for what is not valid and matte, hidden or a speckle.
void trust(const ConfidenceInput& input, const TrustParams& params, const SpeckleRule& rule, float* out,
           const EvidenceCrew& crew);

// What is bright and colourless, and what is nearly as bright [out, (height, width)].
void glints(const Channels& channels, const GlintRule& rule, bool* found, bool* nearly, const EvidenceCrew& crew);

// u, or the other map where the pair says more for that [out].
void better(const Pair& pair, const float* u, const float* other, const ReuseRule& rule, float* out,
            const EvidenceCrew& crew);

// Planes of one size at half of it, sides rounded up, by the area mean [out].
void halve(Size from, const std::vector<const float*>& planes, const std::vector<float*>& out,
           const EvidenceCrew& crew);

// The same of disparities, in pixels of the smaller plane, averaged with a weight; and of the weight [out].
struct Weighed {
    const float* u;
    const float* weight;
    float* out;
    float* out_weight;
};
void halve_weighed(Size from, const Weighed& map, const EvidenceCrew& crew);

// Weights of the smoothness, over 0 to 1 [out].
void edge_weights(const Channels& channels, const EdgeParams& params, float* out, const EvidenceCrew& crew);

}  // namespace stereomend
