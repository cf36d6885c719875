// Rows of a PNG: filters undone, and rows of 16 bits filtered.
#pragma once

#include <cstddef>
#include <cstdint>

namespace stereomend {

// Rows of a PNG without interlacing.
struct PngRows {
    size_t height;
    size_t stride;           // bytes of a row, without the filter's number: a multiple of bytes_per_pixel
    size_t bytes_per_pixel;  // 1, 2, 3, 4, 6 or 8
};

// Undoes the filters (PNG, third edition, section 9). filtered: height rows of 1 + stride bytes, the first of each the
// number of its filter; out: (height, stride) [out]. False where a row has a filter that PNG does not define.
bool unfilter(const PngRows& rows, const uint8_t* filtered, uint8_t* out);

// A plane as grey levels value * scale, rounded, halves to even, and no less than 1 nor more than 65535, in height rows
// of 1 + 2 * width bytes [out] with the filter Up: smooth planes become nearly all zero.
void filter_levels(const float* plane, size_t height, size_t width, float scale, uint8_t* out);

}  // namespace stereomend
