// A fuzz target over all entry points of the kernels: any bits as grey levels and disparities, any small size.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

#include "../../kernels/png_chunks.hpp"
#include "../../kernels/png_rows.hpp"
#include "scenes.hpp"

namespace {

constexpr int kLargestSide = 40;
constexpr int kLargestWidth = 140;  // flags are walked in words of 64

// Takes bytes from the input as long as there are any, then zeros.
class Bytes {
public:
    Bytes(const uint8_t* data, size_t size) : data_(data), left_(size) {}

    int upto(int most) { return next<uint8_t>() % (most + 1); }

    template <class T>
    T next() {
        T value{};
        const size_t count = std::min(left_, sizeof value);
        std::memcpy(&value, data_, count);
        data_ += count;
        left_ -= count;
        return value;
    }

private:
    const uint8_t* data_;
    size_t left_;
};

// Rows with any bytes, in memory of exactly their size.
void unfilter_any(Bytes& bytes) {
    constexpr size_t kBytesPerPixel[] = {1, 2, 3, 4, 6, 8};
    const size_t pixel = kBytesPerPixel[bytes.upto(5)];
    const stereomend::PngRows rows{1u + bytes.upto(kLargestSide), pixel * (1u + bytes.upto(kLargestSide)), pixel};
    std::vector<uint8_t> filtered(rows.height * (1 + rows.stride)), out(rows.height * rows.stride);
    for (uint8_t& byte : filtered) byte = bytes.next<uint8_t>();
    for (size_t y = 0; y < rows.height; ++y) filtered[y * (1 + rows.stride)] %= 6;  // five filters, and none
    stereomend::unfilter(rows, filtered.data(), out.data());
}

// Any floats as levels, which come back between their bounds.
void filter_any(Bytes& bytes) {
    const size_t height = 1 + bytes.upto(9);
    const size_t width = 1 + bytes.upto(kLargestSide);
    std::vector<float> plane(height * width);
    for (float& value : plane) value = bytes.next<float>();
    std::vector<uint8_t> filtered(height * (1 + 2 * width)), out(height * 2 * width);
    stereomend::filter_levels(plane.data(), height, width, 256.0f, filtered.data());
    if (!stereomend::unfilter({height, 2 * width, 2}, filtered.data(), out.data())) std::abort();
    for (size_t i = 0; i < plane.size(); ++i) {
        const float level = static_cast<float>(out[2 * i] << 8 | out[2 * i + 1]);
        const float wanted = std::min(std::max(1.0f, plane[i] * 256.0f), 65535.0f);
        if (level < 1.0f || std::fabs(level - wanted) > 0.5f) std::abort();
    }
}

// Any bytes as chunks, in memory of exactly their size.
void find_any_chunks(Bytes& bytes) {
    std::vector<uint8_t> file(bytes.upto(255));
    for (uint8_t& byte : file) byte = bytes.next<uint8_t>();
    std::vector<stereomend::PngChunk> chunks;
    stereomend::find_chunks(file.data(), file.size(), std::min<size_t>(bytes.upto(40), file.size()), 9, chunks);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    static stereomend::Engine engines[] = {{1, ""}, {2, ""}, {3, ""}};
    Bytes bytes(data, size);
    const int width = 1 + bytes.upto(kLargestWidth - 1);
    const int height = 1 + bytes.upto(kLargestSide - 1);
    Scene scene = noisy_scene(width, height, bytes.next<uint8_t>());
    stereomend::Engine& engine = engines[bytes.upto(2)];
    const stereomend::SolverParams params{bytes.next<float>(), bytes.next<float>(), 0.25f, 0.5f,
                                          bytes.upto(3),       bytes.upto(9),       bytes.upto(1) == 1,
                                          bytes.upto(1) == 1,  bytes.upto(16) / 4.0f};
    for (std::vector<uint8_t>* flags : {&scene.known, &scene.soft})
        for (uint8_t& flag : *flags) flag = bytes.upto(1);
    for (std::vector<float>* plane : {&scene.left, &scene.right, &scene.u, &scene.weight, &scene.edge, &scene.prior,
                                      &scene.trust})
        for (float& value : *plane)
            if (bytes.upto(7) == 0) value = bytes.next<float>();
    unfilter_any(bytes);
    filter_any(bytes);
    find_any_chunks(bytes);
    run_all(engine, scene, params);
    return 0;
}
