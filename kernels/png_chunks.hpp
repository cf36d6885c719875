// The chunks of a PNG, checked.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace stereomend {

struct PngChunk {
    uint32_t name;  // its four letters, the first in the highest byte
    size_t begin;   // of its body, from the start of the file
    size_t size;    // of its body, bytes
};

enum class PngFault { none, cut_off, wrong_checksum, too_many };

// Finds the chunks from byte `at` up to and with IEND, at most `most`, and checks their lengths and checksums (PNG, third
// edition, section 5). After wrong_checksum the last of `chunks` [out] is the one that has it.
PngFault find_chunks(const uint8_t* file, size_t size, size_t at, size_t most, std::vector<PngChunk>& chunks);

}  // namespace stereomend
