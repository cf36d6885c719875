// From one level of the pyramid to the next (R3, R4, R6).
#pragma once

#include "exponential.cuh"
#include "gdr_device.cuh"

namespace stereomend {

// Of an odd side of 2 n - 1 pixels, one of n larger ones covers pixel 2 i, a share of the one before and of the one
// after; of an even side, pixels 2 i and 2 i + 1.
struct Cover {
    int at;
    float before;
    float after;
    float scale;
};

DEVICE_FN Cover cover_of(int i, int side) {
    const int half = side / 2 + side % 2;
    const float slope = side % 2 ? 1.0f / static_cast<float>(half) : 0.0f;
    const bool last = 2 * i + 1 >= side;
    return {2 * i, slope * static_cast<float>(i), last ? 0.0f : 1.0f - slope * static_cast<float>(i + 1),
            static_cast<float>(half) / static_cast<float>(side)};
}

// The area mean of what pixel (x, y) of the smaller plane covers, of value(index).
template <class Value>
DEVICE_FN float mean_of(Extent from, int x, int y, Value value) {
    const Cover rows = cover_of(y, from.height);
    const Cover columns = cover_of(x, from.width);
    const auto row = [&](int at) {
        const long i = static_cast<long>(at) * from.width + columns.at;
        float sum = value(i);
        if (columns.before > 0.0f) sum += columns.before * value(i - 1);
        if (columns.after > 0.0f) sum += columns.after * value(i + 1);
        return sum;
    };
    float sum = row(rows.at);
    if (rows.before > 0.0f) sum += rows.before * row(rows.at - 1);
    if (rows.after > 0.0f) sum += rows.after * row(rows.at + 1);
    return rows.scale * columns.scale * sum;
}

DEVICE_FN Extent half_of(Extent from) {
    return {from.width / 2 + from.width % 2, from.height / 2 + from.height % 2};
}

DEVICE_FN int own_x() { return blockIdx.x * kLanes + threadIdx.x; }
DEVICE_FN int own_y() { return blockIdx.y * kBlockRows + threadIdx.y; }

// Planes (count, height, width) [in] at half of their size, sides rounded up, by the area mean [out]; plane `map`, of
// disparities, in pixels of the smaller size. A thread per pixel of the result, a layer of blocks per plane.
KERNEL halve(const float* planes, float* out, int width, int height, int map) {
    const Extent from{width, height};
    const Extent to = half_of(from);
    if (own_x() >= to.width || own_y() >= to.height) return;
    const float* plane = planes + static_cast<long>(blockIdx.z) * width * height;
    const float mean = mean_of(from, own_x(), own_y(), [&](long i) { return plane[i]; });
    const float ratio = blockIdx.z == map ? static_cast<float>(to.width) / static_cast<float>(width) : 1.0f;
    out[(static_cast<long>(blockIdx.z) * to.height + own_y()) * to.width + own_x()] = ratio * mean;
}

// A weight so small that it counts only where there is no other.
constexpr float kHardly = 1e-6f;

// Disparities u at half of their size, in its pixels, averaged with a weight; and the weight. Threads as `halve`.
KERNEL halve_weighed(const float* u, const float* weight, float* out, float* out_weight, int width, int height) {
    const Extent from{width, height};
    const Extent to = half_of(from);
    if (own_x() >= to.width || own_y() >= to.height) return;
    const float share = mean_of(from, own_x(), own_y(), [&](long i) { return weight[i]; });
    const float sum = mean_of(from, own_x(), own_y(), [&](long i) { return u[i] * (weight[i] + kHardly); });
    const float ratio = static_cast<float>(to.width) / static_cast<float>(width);
    const long i = static_cast<long>(own_y()) * to.width + own_x();
    out[i] = ratio * sum / (share + kHardly);
    out_weight[i] = share;
}

// Where the centre of pixel i of `to` lies among `from` pixels: in whole numbers, as rounding would shift it.
struct Centre {
    int at;
    int next;
    float fraction;
};

DEVICE_FN Centre centre_of(int i, int from, int to) {
    const long long twice = 2LL * to;
    const long long place = (2LL * i + 1) * from - to;
    const long long safe = place < 0 ? 0 : place;
    const int at = static_cast<int>(safe / twice);
    return {at, at + 1 < from ? at + 1 : at, static_cast<float>(safe - at * twice) / static_cast<float>(twice)};
}

DEVICE_FN float mix(float a, float b, float fraction) { return a + fraction * (b - a); }

// A map u of the size `from` at the size `to`, in its pixels, bilinearly [out]. A thread per pixel of the result.
KERNEL enlarge(const float* u, float* out, int from_width, int from_height, int width, int height) {
    const int x = own_x();
    const int y = own_y();
    if (x >= width || y >= height) return;
    const Centre column = centre_of(x, from_width, width);
    const Centre row = centre_of(y, from_height, height);
    const float* above = u + static_cast<long>(row.at) * from_width;
    const float* below = u + static_cast<long>(row.next) * from_width;
    const float value = mix(mix(above[column.at], above[column.next], column.fraction),
                            mix(below[column.at], below[column.next], column.fraction), row.fraction);
    out[static_cast<long>(y) * width + x] = value * (static_cast<float>(width) / static_cast<float>(from_width));
}

struct Edges {
    const float* channels;  // [in] (count, height, width), levels of 0 to 255
    float* out;             // weight of the smoothness, over 0 to 1
    int count;
    int width;
    int height;
    float level;
    float power;
    float floor;
};

// w (R4) from the steepest channel; a thread per pixel.
KERNEL edges(Edges in) {
    const int x = own_x();
    const int y = own_y();
    if (x >= in.width || y >= in.height) return;
    const long i = static_cast<long>(y) * in.width + x;
    const long right = x + 1 < in.width ? i + 1 : i;
    const long below = y + 1 < in.height ? i + in.width : i;
    float most = 0.0f;
    for (int k = 0; k < in.count; ++k) {
        const float* levels = in.channels + static_cast<long>(k) * in.width * in.height;
        const float along = levels[right] - levels[i];
        const float down = levels[below] - levels[i];
        most = larger(most, along * along + down * down);
    }
    in.out[i] = edge_weight(most * (1.0f / (in.level * in.level)), in.power, in.floor);
}

}  // namespace stereomend
