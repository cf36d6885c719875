#include "png_chunks.hpp"

#include <array>

namespace stereomend {
namespace {

constexpr uint32_t kEnd = 0x49454e44;  // IEND
constexpr size_t kAround = 12;         // length, name and checksum, four bytes each

constexpr size_t kStep = 16;
using Tables = std::array<std::array<uint32_t, 256>, kStep>;

// tables[k][b]: what byte b, followed by k zeros, does to a checksum.
constexpr Tables make_tables() {
    Tables tables{};
    for (uint32_t b = 0; b < 256; ++b) {
        uint32_t value = b;
        for (int bit = 0; bit < 8; ++bit) value = (value >> 1) ^ (value & 1 ? 0xedb88320 : 0);
        tables[0][b] = value;
    }
    for (size_t k = 1; k < kStep; ++k)
        for (size_t b = 0; b < 256; ++b) {
            const uint32_t before = tables[k - 1][b];
            tables[k][b] = (before >> 8) ^ tables[0][before & 255];
        }
    return tables;
}

constexpr Tables kTables = make_tables();

// CRC-32. Sixteen bytes at a time, whose lookups do not wait for each other as those of single bytes would.
uint32_t checksum(const uint8_t* bytes, size_t size) {
    uint32_t crc = ~uint32_t{0};
    for (; size >= kStep; size -= kStep, bytes += kStep) {
        uint32_t next = 0;
        for (size_t k = 4; k < kStep; ++k) next ^= kTables[kStep - 1 - k][bytes[k]];
        for (size_t k = 0; k < 4; ++k) next ^= kTables[kStep - 1 - k][bytes[k] ^ (crc >> 8 * k & 255)];
        crc = next;
    }
    for (; size > 0; --size, ++bytes) crc = (crc >> 8) ^ kTables[0][(crc ^ *bytes) & 255];
    return ~crc;
}

uint32_t big_endian(const uint8_t* p) {
    return uint32_t{p[0]} << 24 | uint32_t{p[1]} << 16 | uint32_t{p[2]} << 8 | uint32_t{p[3]};
}

}  // namespace

PngFault find_chunks(const uint8_t* file, size_t size, size_t at, size_t most, std::vector<PngChunk>& chunks) {
    while (chunks.size() < most) {
        const size_t length = size - at < kAround ? size : big_endian(file + at);
        if (length > size || length + kAround > size - at) return PngFault::cut_off;
        const PngChunk chunk{big_endian(file + at + 4), at + 8, length};
        chunks.push_back(chunk);
        const uint8_t* end = file + chunk.begin + length;
        if (checksum(file + at + 4, 4 + length) != big_endian(end)) return PngFault::wrong_checksum;
        if (chunk.name == kEnd) return PngFault::none;
        at += kAround + length;
    }
    return PngFault::too_many;
}

}  // namespace stereomend
