#include "png_rows.hpp"

#include <cstdlib>
#include <cstring>
#include <vector>

namespace stereomend {
namespace {

// What a filter adds to a byte: a function of the same byte of the pixels to its left, above it and above that one.
// Left of a row and above the first one all is 0.
using Prediction = int(int left, int up, int corner);

int left_of(int left, int, int) { return left; }

int average(int left, int up, int) { return (left + up) >> 1; }

// `a` where the condition holds, else `b`, without a branch that noise would mispredict.
int choose(bool condition, int a, int b) { return b ^ ((a ^ b) & -static_cast<int>(condition)); }

int paeth(int left, int up, int corner) {
    const int from_left = std::abs(up - corner);
    const int from_up = std::abs(left - corner);
    const int from_corner = std::abs(left + up - 2 * corner);
    const int vertical = choose(from_up <= from_corner, up, corner);
    return choose((from_left <= from_up) & (from_left <= from_corner), left, vertical);
}

template <size_t BytesPerPixel, Prediction predict>
void undo(const uint8_t* row, const uint8_t* above, size_t stride, uint8_t* __restrict out) {
    int left[BytesPerPixel] = {};
    int corner[BytesPerPixel] = {};
    for (size_t x = 0; x < stride; x += BytesPerPixel)
        for (size_t k = 0; k < BytesPerPixel; ++k) {
            const int up = above[x + k];
            left[k] = (row[x + k] + predict(left[k], up, corner[k])) & 255;
            corner[k] = up;
            out[x + k] = static_cast<uint8_t>(left[k]);
        }
}

void undo_none(const uint8_t* row, const uint8_t*, size_t stride, uint8_t* out) { std::memcpy(out, row, stride); }

void undo_up(const uint8_t* row, const uint8_t* above, size_t stride, uint8_t* __restrict out) {
    for (size_t x = 0; x < stride; ++x) out[x] = static_cast<uint8_t>(row[x] + above[x]);
}

// By the number of the filter.
constexpr int kFilters = 5;
using Undo = void(const uint8_t* row, const uint8_t* above, size_t stride, uint8_t* out);

template <size_t BytesPerPixel>
constexpr Undo* kUndo[kFilters] = {undo_none, undo<BytesPerPixel, left_of>, undo_up, undo<BytesPerPixel, average>,
                                   undo<BytesPerPixel, paeth>};

Undo* const* filters_of(size_t bytes_per_pixel) {
    switch (bytes_per_pixel) {
        case 1: return kUndo<1>;
        case 2: return kUndo<2>;
        case 3: return kUndo<3>;
        case 4: return kUndo<4>;
        case 6: return kUndo<6>;
        default: return kUndo<8>;
    }
}

// ISA-L inflates with wide vectors and leaves their upper parts in use. Until those are cleared, whatever was compiled
// for processors without them, most of NumPy and OpenCV too, runs at about half its speed in the same thread.
#ifdef __x86_64__
__attribute__((target("avx"))) void clear_upper_parts() { __builtin_ia32_vzeroupper(); }
#endif

void end_wide_vectors() {
#ifdef __x86_64__
    if (__builtin_cpu_supports("avx")) clear_upper_parts();
#endif
}

constexpr uint8_t kUp = 2;
constexpr float kMost = 65535.0f;
constexpr float kWhole = 12582912.0f;  // 1.5 * 2^23: floats of this size have no fraction

// Big-endian, as a PNG stores them.
void levels_of(const float* row, size_t width, float scale, uint16_t* out) {
    for (size_t x = 0; x < width; ++x) {
        const float rounded = (row[x] * scale + kWhole) - kWhole;
        // What is no number becomes 1.
        const float least = rounded > 1.0f ? rounded : 1.0f;
        const int level = static_cast<int>(least < kMost ? least : kMost);
        out[x] = static_cast<uint16_t>(level >> 8 | level << 8);
    }
}

void filter_up(const uint8_t* row, const uint8_t* above, size_t stride, uint8_t* __restrict out) {
    for (size_t x = 0; x < stride; ++x) out[x] = static_cast<uint8_t>(row[x] - above[x]);
}

}  // namespace

bool unfilter(const PngRows& rows, const uint8_t* filtered, uint8_t* out) {
    end_wide_vectors();
    Undo* const* undo_filter = filters_of(rows.bytes_per_pixel);
    const std::vector<uint8_t> outside(rows.stride);
    const uint8_t* above = outside.data();
    for (size_t y = 0; y < rows.height; ++y) {
        if (filtered[0] >= kFilters) return false;
        undo_filter[filtered[0]](filtered + 1, above, rows.stride, out);
        above = out;
        filtered += 1 + rows.stride;
        out += rows.stride;
    }
    return true;
}

void filter_levels(const float* plane, size_t height, size_t width, float scale, uint8_t* out) {
    std::vector<uint16_t> row(width);
    std::vector<uint16_t> above(width);
    for (size_t y = 0; y < height; ++y, plane += width, out += 1 + 2 * width) {
        levels_of(plane, width, scale, row.data());
        out[0] = kUp;
        filter_up(reinterpret_cast<uint8_t*>(row.data()), reinterpret_cast<uint8_t*>(above.data()), 2 * width, out + 1);
        row.swap(above);
    }
}

}  // namespace stereomend
