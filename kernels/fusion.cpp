#include "fusion.hpp"

#include <algorithm>
#include <numeric>
#include <vector>

#include "gang.hpp"

namespace stereomend {
namespace {

Choice choice_of(const Rivals& rivals, float* share, EvidenceBuffers& buffers) {
    const long pixels = pixels_of(rivals.size);
    reserve(buffers.marks, 9 * pixels);
    uint8_t* marks = buffers.marks.data();
    bool* flags = reinterpret_cast<bool*>(marks + pixels);
    return {marks, flags, flags + pixels, flags + 2 * pixels, flags + 3 * pixels, flags + 4 * pixels, flags + 5 * pixels,
            flags + 6 * pixels, flags + 7 * pixels, share};
}

// The columns of the picture that a member walks down and up.
void walk_columns(const Terrain& terrain, int member, const Gang& gang, bool* reached) {
    const Rows columns = band(terrain.size.width, member, gang.count);
    const LdrSweeps& sweeps = gang.crew.ldr;
    for (int y = 1; y < terrain.size.height; ++y) sweeps.reach_across(terrain, y - 1, y, columns, reached);
    for (int y = terrain.size.height - 2; y >= 0; --y) sweeps.reach_across(terrain, y + 1, y, columns, reached);
}

// Bridges along the member's rows, and down its columns.
void build_bridges(const Terrain& terrain, int member, const Gang& gang, const FusionSweeps& sweeps,
                   const Choice& choice) {
    const Size size = terrain.size;
    const Rows rows = gang.rows(member);
    const Rows columns = band(size.width, member, gang.count);
    uint8_t* scratch = gang.flags(member);
    for (int y = rows.begin; y < rows.end; ++y)
        sweeps.bridge(terrain, {y, {1, size.width}}, 1, choice.reached, scratch, choice.along);
    for (int y = 1; y < size.height; ++y)
        sweeps.bridge(terrain, {y, columns}, size.width, choice.reached, scratch, choice.across);
}

}  // namespace

void poll(const Rivals& rivals, const PollMarks& marks, const PollRule& rule, double* out, const FusionCrew& crew) {
    const Gang gang(crew.evidence, rivals.size);
    const int height = cells_of(rivals.size.height);
    const int width = cells_of(rivals.size.width);
    gang.run([&](int member) {
        const Rows rows = band(height, member, gang.count);
        for (int row = rows.begin; row < rows.end; ++row)
            crew.sweeps.poll(rivals, marks, rule, row, gang.scratch(member), static_cast<long>(height) * width,
                             out + static_cast<long>(row) * width);
    });
}

void choose(const Rivals& rivals, const Grounds& grounds, const ChoiceRule& rule, float* out, const FusionCrew& crew) {
    const Gang gang(crew.evidence, rivals.size);
    const int width = rivals.size.width;
    const Choice choice = choice_of(rivals, out, crew.evidence.buffers);
    const Patches patches = patches_of(rivals.size, crew.evidence.buffers);
    const Steps steps{rivals.size, rivals.upload, choice.kept, rule.step, choice.even};
    const Terrain terrain{rivals.size, rivals.upload, choice.passing, choice.soft, rule.step};
    std::vector<long> counts(gang.count);
    // How many pixels there are in all, told to every member.
    const auto known = [&](int member, const bool* reached) {
        const Rows rows = gang.rows(member);
        counts[member] = std::count(reached + static_cast<long>(rows.begin) * width,
                                    reached + static_cast<long>(rows.end) * width, true);
        gang.meet();
        return std::accumulate(counts.begin(), counts.end(), 0L);
    };
    // Along rows, then along columns: ends with a meeting.
    const auto walk = [&](int member) {
        const Rows rows = gang.rows(member);
        for (int y = rows.begin; y < rows.end; ++y) gang.crew.ldr.reach_along(terrain, y, choice.reached);
        gang.meet();
        walk_columns(terrain, member, gang, choice.reached);
        gang.meet();
    };
    gang.run([&](int member) {
        const Rows rows = gang.rows(member);
        float* scratch = gang.scratch(member);
        for (int y = rows.begin; y < rows.end; ++y)
            crew.sweeps.look(rivals, rule, y, scratch, choice);
        gang.meet();
        for (int y = rows.begin; y < rows.end; ++y) crew.sweeps.settle(rivals, grounds, rule, y, scratch, choice);
        walk(member);
        gang.crew.sweeps.label(steps, patches, rows, gang.flags(member));
        for (int y = rows.begin; y < rows.end; ++y) crew.sweeps.narrow(rivals, y, choice);
        long before = -1;
        for (long now = known(member, choice.reached); now != before; now = known(member, choice.reached)) {
            before = now;
            walk(member);
        }
        if (member == 0) join_bands(patches, gang);
        gang.meet();
        for (int y = rows.begin; y < rows.end; ++y) {
            bool* small = gang.row_of_flags(member);
            std::fill(small, small + width, false);
            gang.crew.sweeps.flag_small(patches, width, y, rule.largest_patch, small);
            crew.sweeps.sift(rivals, y, small, choice);
        }
        const long first = static_cast<long>(rows.begin) * width;
        const long last = static_cast<long>(rows.end) * width;
        std::fill(choice.along + first, choice.along + last, false);
        std::fill(choice.across + first, choice.across + last, false);
        gang.meet();
        build_bridges(terrain, member, gang, crew.sweeps, choice);
        gang.meet();
        for (int y = rows.begin; y < rows.end; ++y) crew.sweeps.conclude(rivals, y, choice);
    });
}

}  // namespace stereomend
