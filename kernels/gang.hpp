// Who works on one call, and with which memory: for the drivers of evidence and fusion.
#pragma once

#include <algorithm>
#include <functional>

#include "evidence.hpp"

namespace stereomend {
namespace {

// Smaller pictures are done before the others are awake [px].
constexpr long kAlone = 3000;

long pixels_of(Size size) { return static_cast<long>(size.width) * size.height; }

size_t flags_of(Size size) { return 64 * words_of(size.width); }

template <class T>
void reserve(std::vector<T>& buffer, size_t count) {
    buffer.resize(std::max(buffer.size(), count));
}

// Members of the team, or the caller alone.
struct Gang {
    const EvidenceCrew& crew;
    Size size;
    int count;

    Gang(const EvidenceCrew& crew_, Size size_)
        : crew(crew_), size(size_), count(pixels_of(size) < kAlone ? 1 : crew.team.size()) {
        reserve(crew.buffers.scratch, evidence_floats(size.width) * count);
        reserve(crew.buffers.flags, flags_of(size) * count);
    }

    // Runs body(member) in each.
    template <class Body>
    void run(const Body& body) const {
        if (count == 1) body(0);
        else crew.team.run(std::ref(body));
    }

    void meet() const {
        if (count > 1) crew.team.meet();
    }

    Rows rows(int member) const { return band(size.height, member, count); }
    float* scratch(int member) const { return crew.buffers.scratch.data() + evidence_floats(size.width) * member; }
    uint8_t* flags(int member) const { return crew.buffers.flags.data() + flags_of(size) * member; }
    bool* row_of_flags(int member) const { return reinterpret_cast<bool*>(flags(member)); }
};

Patches patches_of(Size size, EvidenceBuffers& buffers) {
    const size_t words = words_of(size.width) * size.height;
    reserve(buffers.bits, 3 * words);
    reserve(buffers.runs, pixels_of(size));
    uint64_t* bits = buffers.bits.data();
    return {bits, bits + words, bits + 2 * words, buffers.runs.data()};
}

// Where one band ends and the next begins.
void join_bands(const Patches& patches, const Gang& gang) {
    for (int member = 1; member < gang.count; ++member) {
        const int y = gang.rows(member).begin;
        if (y > gang.rows(member - 1).begin && y < gang.size.height)
            gang.crew.sweeps.join(patches, gang.size.width, y);
    }
}

}  // namespace
}  // namespace stereomend
