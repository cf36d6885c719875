// The parts of the Python module that read files and measure the machine.
#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>

#include "bindings.hpp"
#include "ceilings.hpp"
#include "png_chunks.hpp"
#include "png_rows.hpp"

namespace stereomend {

using namespace nb::literals;

namespace {

// The samples (height, stride) of filtered rows; see png_rows.hpp.
Output<uint8_t> unfiltered(const Bytes& filtered, size_t height, size_t stride, size_t bytes_per_pixel) {
    constexpr size_t kBytesPerPixel[] = {1, 2, 3, 4, 6, 8};
    const size_t* end = std::end(kBytesPerPixel);
    if (std::find(std::begin(kBytesPerPixel), end, bytes_per_pixel) == end || stride % bytes_per_pixel != 0)
        throw nb::value_error("bytes_per_pixel: expected 1, 2, 3, 4, 6 or 8, and rows of whole pixels");
    if (height < 1 || height > kMaxSide || stride < 1 || stride > kMaxSide * bytes_per_pixel)
        throw nb::value_error("a picture has no pixel, or a side over 1048576 px");
    if (filtered.size() != height * (1 + stride))
        throw nb::value_error("filtered: expected height rows of 1 + stride bytes");
    Output<uint8_t> out = new_plane<uint8_t>(height, stride);
    nb::gil_scoped_release unlocked;
    if (!stereomend::unfilter({height, stride, bytes_per_pixel}, filtered.data(), out.data()))
        throw std::invalid_argument("filtered: a row has a filter that PNG does not define");
    return out;
}

Output<uint8_t> filtered_levels(const Plane& plane, float scale) {
    check_same_shape(plane);
    const size_t height = plane.shape(0);
    const size_t width = plane.shape(1);
    Output<uint8_t> out = new_plane<uint8_t>(height, 1 + 2 * width);
    nb::gil_scoped_release unlocked;
    stereomend::filter_levels(plane.data(), height, width, scale, out.data());
    return out;
}

// (name, begin, size) of each chunk, and what is wrong: a value of PngFault; see png_chunks.hpp.
std::pair<std::vector<std::tuple<uint32_t, size_t, size_t>>, int> chunks_of(const Bytes& file, size_t at,
                                                                            size_t most) {
    if (at > file.size()) throw nb::value_error("at: expected a place in the file");
    std::vector<PngChunk> chunks;
    PngFault fault;
    {
        nb::gil_scoped_release unlocked;
        fault = stereomend::find_chunks(file.data(), file.size(), at, most, chunks);
    }
    std::vector<std::tuple<uint32_t, size_t, size_t>> found;
    for (const auto& chunk : chunks) found.emplace_back(chunk.name, chunk.begin, chunk.size);
    return {found, static_cast<int>(fault)};
}

double measure(double (*rate)(int), int threads) {
    check_threads(threads);
    nb::gil_scoped_release unlocked;
    return rate(threads);
}

}  // namespace

void bind_files(nb::module_& m) {
    m.def("triad", [](int threads) { return measure(triad, threads); }, "threads"_a,
          "Memory traffic of a = b + s * c [GB/s].");
    m.def("multiply_add", [](int threads) { return measure(multiply_add, threads); }, "threads"_a,
          "float32 multiply-adds of all threads together [GFlop/s].");
    m.def("find_chunks", &chunks_of, "file"_a.noconvert(), "at"_a, "most"_a,
          "(name, begin, size) of a PNG's chunks from byte at, and 0, or 1: cut off, 2: the last has a wrong checksum, "
          "3: more than most.");
    m.def("unfilter", &unfiltered, "filtered"_a.noconvert(), "height"_a, "stride"_a, "bytes_per_pixel"_a,
          "The bytes of a PNG's samples, (height, stride), from height rows of 1 + stride filtered ones.");
    m.def("filter_levels", &filtered_levels, "plane"_a.noconvert(), "scale"_a,
          "Rows of a PNG of 16 bits, filtered, (height, 1 + 2 * width): plane * scale within 1 and 65535.");
}

}  // namespace stereomend
