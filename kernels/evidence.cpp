#include "evidence.hpp"

#include <algorithm>

#include "gang.hpp"

namespace stereomend {

void evidence(const Pair& pair, const std::vector<const float*>& maps, const std::vector<float*>& found,
              const EvidenceCrew& crew) {
    const Gang gang(crew, pair.size);
    gang.run([&](int member) {
        for (size_t first = 0; first < maps.size(); first += kMostMaps) {
            Maps some{static_cast<int>(std::min<size_t>(kMostMaps, maps.size() - first)), {}, {}};
            std::copy_n(maps.begin() + first, some.count, some.u);
            std::copy_n(found.begin() + first, some.count, some.found);
            crew.sweeps.evidence(pair, some, gang.rows(member), gang.scratch(member));
        }
    });
}

void speckles(const Steps& map, int largest, bool* out, const EvidenceCrew& crew) {
    const Gang gang(crew, map.size);
    const Patches patches = patches_of(map.size, crew.buffers);
    const int width = map.size.width;
    gang.run([&](int member) {
        const Rows rows = gang.rows(member);
        crew.sweeps.label(map, patches, rows, gang.flags(member));
        gang.meet();
        if (member == 0) join_bands(patches, gang);
        gang.meet();
        for (int y = rows.begin; y < rows.end; ++y) {
            bool* row = out + static_cast<long>(y) * width;
            std::fill(row, row + width, false);
            crew.sweeps.flag_small(patches, width, y, largest, row);
        }
    });
}

void trust(const ConfidenceInput& input, const TrustParams& params, const SpeckleRule& rule, float* out,
           const EvidenceCrew& crew) {
    const Gang gang(crew, input.size);
    const Patches patches = patches_of(input.size, crew.buffers);
    const int width = input.size.width;
    const Steps map{input.size, input.u, input.valid, rule.step, nullptr};
    const Pair pair{input.size, input.left, input.right};
    const Maps maps{1, {input.u}, {out}};
    gang.run([&](int member) {
        const Rows rows = gang.rows(member);
        bool* flags = gang.row_of_flags(member);
        crew.sweeps.label(map, patches, rows, gang.flags(member));
        gang.meet();
        if (member == 0) join_bands(patches, gang);
        crew.sweeps.evidence(pair, maps, rows, gang.scratch(member));
        gang.meet();
        for (int y = rows.begin; y < rows.end; ++y) {
            const long o = static_cast<long>(y) * width;
            crew.ldr.unobserved_row(input.u + o, width, flags);
            crew.sweeps.flag_small(patches, width, y, rule.largest, flags);
            crew.sweeps.trust(input, params, y, flags, gang.scratch(member), out + o);
        }
    });
}

void better(const Pair& pair, const float* u, const float* other, const ReuseRule& rule, float* out,
            const EvidenceCrew& crew) {
    const Gang gang(crew, pair.size);
    const int width = pair.size.width;
    reserve(crew.buffers.planes, 2 * pixels_of(pair.size));
    float* n = crew.buffers.planes.data();
    float* other_n = n + pixels_of(pair.size);
    gang.run([&](int member) {
        const Rows rows = gang.rows(member);
        bool* hidden = gang.row_of_flags(member);
        crew.sweeps.evidence(pair, {2, {u, other}, {n, other_n}}, rows, gang.scratch(member));
        for (int y = rows.begin; y < rows.end; ++y) {
            const long o = static_cast<long>(y) * width;
            crew.ldr.unobserved_row(other + o, width, hidden);
            crew.sweeps.better_row(u + o, n + o, other + o, other_n + o, hidden, width, rule, out + o);
        }
    });
}

void halve(Size from, const std::vector<const float*>& planes, const std::vector<float*>& out,
           const EvidenceCrew& crew) {
    const Gang gang(crew, from);
    gang.run([&](int member) {
        const Rows rows = band(half_of(from.height), member, gang.count);
        for (size_t k = 0; k < planes.size(); ++k)
            for (int y = rows.begin; y < rows.end; ++y)
                crew.sweeps.halve_row(planes[k], from, y, gang.scratch(member),
                                      out[k] + static_cast<long>(y) * half_of(from.width));
    });
}

void halve_weighed(Size from, const Weighed& map, const EvidenceCrew& crew) {
    const Gang gang(crew, from);
    gang.run([&](int member) {
        const Rows rows = band(half_of(from.height), member, gang.count);
        for (int y = rows.begin; y < rows.end; ++y) {
            const long o = static_cast<long>(y) * half_of(from.width);
            crew.sweeps.halve_weighed_row(map.u, map.weight, from, y, gang.scratch(member), map.out + o,
                                          map.out_weight + o);
        }
    });
}

void edge_weights(const Channels& channels, const EdgeParams& params, float* out, const EvidenceCrew& crew) {
    const Gang gang(crew, channels.size);
    gang.run([&](int member) {
        const Rows rows = gang.rows(member);
        for (int y = rows.begin; y < rows.end; ++y)
            crew.sweeps.edge_row(channels, params, y, out + static_cast<long>(y) * channels.size.width);
    });
}

void glints(const Channels& channels, const GlintRule& rule, bool* found, bool* nearly, const EvidenceCrew& crew) {
    const Gang gang(crew, channels.size);
    gang.run([&](int member) {
        const Rows rows = gang.rows(member);
        for (int y = rows.begin; y < rows.end; ++y) {
            const long o = static_cast<long>(y) * channels.size.width;
            crew.sweeps.glint_row(channels, rule, y, found + o, nearly + o);
        }
    });
}

}  // namespace stereomend
