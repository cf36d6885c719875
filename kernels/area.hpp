// Smaller pictures by the area mean.
//
// For resize_cpu.cpp alone, which is compiled once per instruction set: everything is local to it.
#pragma once

#include "resize_sweeps.hpp"

namespace stereomend {
namespace {

// R, G, B and one more.
typedef float Four __attribute__((vector_size(16), aligned(4), may_alias));

PIXEL_FN float multiply_add(float a, float b, float c) {
#ifdef __FMA__
    return __builtin_fmaf(a, b, c);
#else
    return a * b + c;
#endif
}

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
void colour_row(const Sample* from, int width, float* out) {
    for (int x = 0; x < width; ++x) {
        for (int k = 0; k < 3; ++k) out[4 * x + k] = level_of(from[3 * x + k]);
        out[4 * x + 3] = 0.0f;
    }
}

template <class Sample>
const float* levels_row(const Samples& from, int y, float* out) {
    const int width = from.size.width;
    const Sample* row = static_cast<const Sample*>(from.data) + static_cast<long>(y) * width * from.channels;
    if (from.channels == 1) single_row(row, width, out);
    else if (from.grey) grey_row(row, width, out);
    else colour_row(row, width, out);
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

template <class Value, int Taps>
void shrink_along(const Value* row, const Cover& cover, Value* out) {
    const int taps = Taps > 0 ? Taps : cover.taps;
    for (int x = 0; x < cover.count; ++x) {
        const Value* from = row + cover.first[x];
        const float* weight = cover.weight + static_cast<long>(x) * taps;
        Value sum = from[0] * weight[0];
        for (int k = 1; k < taps; ++k) sum += from[k] * weight[k];
        out[x] = sum;
    }
}

template <class Value>
void along(const float* row, const Cover& cover, float* out) {
    const Value* from = reinterpret_cast<const Value*>(row);
    Value* to = reinterpret_cast<Value*>(out);
    if (cover.taps == 1) shrink_along<Value, 1>(from, cover, to);
    else if (cover.taps == 2) shrink_along<Value, 2>(from, cover, to);
    else if (cover.taps == 3) shrink_along<Value, 3>(from, cover, to);
    else shrink_along<Value, 0>(from, cover, to);
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

// Rows at their new width, as far as a band has come.
class Shrinking {
public:
    Shrinking(const Samples& from, const Cover& columns, const Cover& rows, float* scratch)
        : from_(from), columns_(columns), rows_(rows), values_(values_of(from)), stride_(1L * values_ * columns.count),
          loaded_(scratch), ring_(scratch + static_cast<long>(values_) * from.size.width),
          result_(ring_ + rows.taps * stride_) {}

    void run(Rows band, const Shrunk& out) {
        int next = rows_.first[band.begin];
        for (int y = band.begin; y < band.end; ++y) {
            const int first = rows_.first[y];
            for (next = next > first ? next : first; next < first + rows_.taps; ++next) narrow(next);
            write(y, first, out);
        }
    }

private:
    float* row(int y) const { return ring_ + (y % rows_.taps) * stride_; }

    void narrow(int y) {
        const float* loaded = load_row(from_, y, loaded_);
        if (values_ == 4) along<Four>(loaded, columns_, row(y));
        else if (columns_.taps == 2 && 2 * columns_.count == from_.size.width) halve_along(loaded, columns_, row(y));
        else along<float>(loaded, columns_, row(y));
    }

    void write(int y, int first, const Shrunk& out) {
        const long o = static_cast<long>(y) * columns_.count;
        float* to = values_ == 4 ? result_ : out.plane[0] + o;
        const float* weight = rows_.weight + static_cast<long>(y) * rows_.taps;
        for (int k = 0; k < rows_.taps; ++k) {
            const float* covered = row(first + k);
            add_row(covered, weight[k], k == 0, to);
        }
        if (values_ == 4) split_row(result_, columns_.count, o, out);
    }

    void add_row(const float* covered, float share, bool first, float* to) const {
        if (first) {
#pragma GCC ivdep
            for (long x = 0; x < stride_; ++x) to[x] = covered[x] * share;
        } else {
#pragma GCC ivdep
            for (long x = 0; x < stride_; ++x) to[x] += covered[x] * share;
        }
    }

    const Samples& from_;
    const Cover& columns_;
    const Cover& rows_;
    const int values_;
    const long stride_;
    float* const loaded_;
    float* const ring_;
    float* const result_;
};

void shrink(const Samples& from, const Cover& columns, const Cover& rows, Rows band, float* scratch,
            const Shrunk& out) {
    if (band.begin < band.end) Shrinking(from, columns, rows, scratch).run(band, out);
}

}  // namespace
}  // namespace stereomend
