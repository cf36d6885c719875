// Changes of size: the row loops, and what they are given. Planes are row-major (height, width).
#pragma once

#include <stdint.h>

#include "ldr_sweeps.hpp"

namespace stereomend {

// What each pixel of a smaller row or column covers of a larger one: pixel i takes `taps` pixels from first[i] on, with
// weights from weight[i * taps] on, which sum to 1.
struct Cover {
    int taps;
    int count;
    const int* first;
    const float* weight;
};

// Samples of an image or a plane, (height, width, channels).
struct Samples {
    Size size;
    const void* data;
    int bytes;     // of a sample: 1, 2 for 0 to 65535 in place of 0 to 255, 4 for float32
    int channels;  // 1; 3 of 1 or 2 bytes: R, G, B
    bool grey;     // of three channels, first one grey level
};

// Where the samples go at their new size: one plane; or R, G, B, and the grey level of these.
struct Shrunk {
    float* plane[4];
};

// Floats in a row of scratch that holds one value per pixel, or R, G, B and one more.
constexpr int values_of(const Samples& from) { return from.channels == 3 && !from.grey ? 4 : 1; }

// Floats of scratch that a member needs to shrink: a row as it came, and at their new width the ones around it; of
// three channels their sum at both widths.
constexpr size_t shrink_floats(const Samples& from, const Cover& columns, const Cover& rows) {
    const size_t held = values_of(from) == 1 ? rows.taps : 1;
    return values_of(from) * (static_cast<size_t>(from.size.width) + held * columns.count);
}

// Where the pixels of a larger row or column are in a smaller one.
struct Places {
    const int* before;      // of the two neighbours
    const int* after;
    const float* fraction;  // of the way from the one to the other
    const int* nearest;     // the pixel that the centre falls on
};

// Two maps at working size and one of them at input size, px of their own size.
struct Offer {
    Size from;
    const float* u;
    const float* share;   // of the samples, 0 to 1
    const float* sample;  // of the upload
    Size to;
    const float* upload;
    const bool* valid;
    float ratio;  // of the widths
    float near;   // maps nearer than this are blended [px]
    float half;   // a share above is chosen
};

// Floats of scratch that a member needs to merge.
constexpr size_t merge_floats(const Offer& offer) {
    return 7 * static_cast<size_t>(offer.to.width) + 5 * (static_cast<size_t>(offer.from.width) + 2);
}

// A disparity map [px of its own size], 0 where it is not valid.
struct Sparse {
    Size size;
    const float* u;
    const bool* valid;
};

// What a map at input size (`to`) came from.
struct Origins {
    Size from;
    const bool* kept;  // at working size: nothing replaced the value
    Size to;
    const float* initial;  // disparity [px], 0 where it is not valid
    const bool* valid;
    const bool* scene;  // which pixels are part of the scene; null: all
    float within;       // a value moved by more counts as refined [px]
};

struct ResizeSweeps {
    // Writes some rows of the smaller planes, each pixel the mean of what it covers.
    void (*shrink)(const Samples&, const Cover& columns, const Cover& rows, Rows, float* scratch, const Shrunk&);
    // Writes some rows of both maps put together, (height, width) of the input, px.
    void (*merge)(const Offer&, const Places& columns, const Places& rows, Rows, float* scratch, float* out);
    // Makes a row of means [in/out] from means over all pixels and the share of valid ones, times `ratio`; valid from a
    // share of `half` on, else 0.
    void (*divide_row)(const float* share, int width, float ratio, float half, float* u, bool* valid);
    // Writes the values at some columns, times `ratio`.
    void (*sample_row)(const float* u, const bool* valid, const int* columns, int width, float ratio, float* out,
                       bool* out_valid);
    // Makes row y of what the right image does not show [in/out] the kinds of its pixels (`Provenance`), and counts
    // each; `columns` and `row`: the pixels of the working size; scratch: 2 * width.
    void (*tell_row)(const Origins&, const float* u, const int* columns, int row, int y, uint8_t* scratch, uint8_t* out,
                     long counts[4]);
};

extern const ResizeSweeps resize_sweeps_v2;
extern const ResizeSweeps resize_sweeps_v3;
extern const ResizeSweeps resize_sweeps_generic;

}  // namespace stereomend
