// Smaller pictures by the area mean.
//
// For resize_cpu.cpp alone, which is compiled once per instruction set: everything is local to it.
#pragma once

#include <string.h>

#include "resize_sweeps.hpp"

namespace stereomend {
namespace {

// R, G, B and one more.
typedef float Four __attribute__((vector_size(16)));

PIXEL_FN float multiply_add(float a, float b, float c) {
#ifdef __FMA__
    return __builtin_fmaf(a, b, c);
#else
    return a * b + c;
#endif
}

PIXEL_FN float level_of(float sample) { return sample; }
PIXEL_FN float level_of(uint8_t sample) { return static_cast<float>(sample); }
PIXEL_FN float level_of(uint16_t sample) { return static_cast<float>(sample) / 257.0f; }

// BT.601.
constexpr float kRed = 0.299f;
constexpr float kGreen = 0.587f;
constexpr float kBlue = 0.114f;

template <class Sample>
void single_row(const Sample* from, int width, float* out) {
    for (int x = 0; x < width; ++x) out[x] = level_of(from[x]);
}

template <class Sample>
void grey_row(const Sample* from, int width, float* out) {
    for (int x = 0; x < width; ++x) {
        const float red = level_of(from[3 * x]);
        const float green = level_of(from[3 * x + 1]);
        const float blue = level_of(from[3 * x + 2]);
        out[x] = multiply_add(blue, kBlue, multiply_add(green, kGreen, red * kRed));
    }
}

template <class Sample>
const float* levels_row(const Samples& from, int y, float* out) {
    const int width = from.size.width;
    const Sample* row = static_cast<const Sample*>(from.data) + static_cast<long>(y) * width * from.channels;
    if (from.channels == 1) single_row(row, width, out);
    else grey_row(row, width, out);
    return out;
}

// Row y as float32; planes of that are left where they are.
const float* load_row(const Samples& from, int y, float* scratch) {
    if (from.bytes == 1) return levels_row<uint8_t>(from, y, scratch);
    if (from.bytes == 2) return levels_row<uint16_t>(from, y, scratch);
    return static_cast<const float*>(from.data) + static_cast<long>(y) * from.size.width;
}

// Half of a row, where each pixel covers two whole ones: without places to look up.
void halve_along(const float* row, const Cover& cover, float* out) {
#pragma GCC ivdep
    for (int x = 0; x < cover.count; ++x) out[x] = row[2 * x] * 0.5f + row[2 * x + 1] * 0.5f;
}

// Wherever it lies: template arguments lose the alignment of their type.
template <class Value>
PIXEL_FN Value value_at(const float* place) {
    Value value;
    memcpy(&value, place, sizeof value);
    return value;
}

// Of pixels of `Channels` floats; what comes after the third of three is read, and not used.
template <class Value, int Channels, int Taps>
void shrink_along(const float* row, const Cover& cover, float* out) {
    constexpr int kFloats = sizeof(Value) / sizeof(float);
    const int taps = Taps > 0 ? Taps : cover.taps;
    for (int x = 0; x < cover.count; ++x) {
        const float* from = row + static_cast<long>(Channels) * cover.first[x];
        const float* weight = cover.weight + static_cast<long>(x) * taps;
        Value sum = value_at<Value>(from) * weight[0];
        for (int k = 1; k < taps; ++k) sum += value_at<Value>(from + Channels * k) * weight[k];
        memcpy(out + static_cast<long>(kFloats) * x, &sum, sizeof sum);
    }
}

template <class Value, int Channels>
void along(const float* row, const Cover& cover, float* out) {
    if (cover.taps == 1) shrink_along<Value, Channels, 1>(row, cover, out);
    else if (cover.taps == 2) shrink_along<Value, Channels, 2>(row, cover, out);
    else if (cover.taps == 3) shrink_along<Value, Channels, 3>(row, cover, out);
    else shrink_along<Value, Channels, 0>(row, cover, out);
}

// Apart again, with the grey level of each pixel.
void split_row(const float* row, int width, long o, const Shrunk& out) {
    float* red = out.plane[0] + o;
    float* green = out.plane[1] + o;
    float* blue = out.plane[2] + o;
    float* grey = out.plane[3] + o;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        red[x] = row[4 * x];
        green[x] = row[4 * x + 1];
        blue[x] = row[4 * x + 2];
        grey[x] = (kRed * row[4 * x] + kGreen * row[4 * x + 1]) + kBlue * row[4 * x + 2];
    }
}

// Adds a share of a row to a sum.
template <class Sample>
void add_row(const Sample* row, long count, float share, bool first, float* sum) {
    if (first) {
#pragma GCC ivdep
        for (long i = 0; i < count; ++i) sum[i] = level_of(row[i]) * share;
    } else {
#pragma GCC ivdep
        for (long i = 0; i < count; ++i) sum[i] += level_of(row[i]) * share;
    }
}

// Rows of a plane at their new width, as far as a band has come.
class Shrinking {
public:
    Shrinking(const Samples& from, const Cover& columns, const Cover& rows, float* scratch)
        : from_(from), columns_(columns), rows_(rows), loaded_(scratch), ring_(scratch + from.size.width) {}

    void run(Rows band, float* out) {
        int next = rows_.first[band.begin];
        for (int y = band.begin; y < band.end; ++y) {
            const int first = rows_.first[y];
            for (next = next > first ? next : first; next < first + rows_.taps; ++next) narrow(next);
            const float* weight = rows_.weight + static_cast<long>(y) * rows_.taps;
            float* to = out + static_cast<long>(y) * columns_.count;
            for (int k = 0; k < rows_.taps; ++k) add_row(row(first + k), columns_.count, weight[k], k == 0, to);
        }
    }

private:
    float* row(int y) const { return ring_ + (y % rows_.taps) * static_cast<long>(columns_.count); }

    void narrow(int y) {
        const float* loaded = load_row(from_, y, loaded_);
        if (columns_.taps == 2 && 2 * columns_.count == from_.size.width) halve_along(loaded, columns_, row(y));
        else along<float, 1>(loaded, columns_, row(y));
    }

    const Samples& from_;
    const Cover& columns_;
    const Cover& rows_;
    float* const loaded_;
    float* const ring_;
};

// Three channels, down before along: so all steps but the last take samples side by side as they lie.
template <class Sample>
void shrink_colours(const Samples& from, const Cover& columns, const Cover& rows, Rows band, float* scratch,
                    const Shrunk& out) {
    const long count = 3L * from.size.width;
    float* sum = scratch;
    float* result = scratch + 4L * from.size.width;
    for (int y = band.begin; y < band.end; ++y) {
        const float* weight = rows.weight + static_cast<long>(y) * rows.taps;
        const Sample* row = static_cast<const Sample*>(from.data) + rows.first[y] * count;
        for (int k = 0; k < rows.taps; ++k) add_row(row + k * count, count, weight[k], k == 0, sum);
        along<Four, 3>(sum, columns, result);
        split_row(result, columns.count, static_cast<long>(y) * columns.count, out);
    }
}

void shrink(const Samples& from, const Cover& columns, const Cover& rows, Rows band, float* scratch,
            const Shrunk& out) {
    if (band.begin >= band.end) return;
    if (values_of(from) == 1) Shrinking(from, columns, rows, scratch).run(band, out.plane[0]);
    else if (from.bytes == 1) shrink_colours<uint8_t>(from, columns, rows, band, scratch, out);
    else shrink_colours<uint16_t>(from, columns, rows, band, scratch, out);
}

}  // namespace
}  // namespace stereomend
