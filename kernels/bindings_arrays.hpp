// Arrays of Python as the engine's inputs, for bindings_engine.hpp.
#pragma once

#include <algorithm>
#include <tuple>
#include <vector>

#include "bindings.hpp"
#include "engine.hpp"

namespace stereomend {
namespace {

void check_window(int window) {
    if (window < 1 || window > static_cast<int>(kMaxSide) || window % 2 == 0)
        throw nb::value_error("window: expected an odd number of 1 to 1048575 px");
}

// Two maps: (upload, valid, u, evidence for the upload, for u, upload shown, u shown).
using Views = std::tuple<Plane, Flags, Plane, Plane, Plane, Flags, Flags>;

Rivals rivals_of(const Views& views) {
    const auto& [upload, valid, u, for_upload, for_u, upload_shown, u_shown] = views;
    check_same_shape(upload, valid, u, for_upload, for_u, upload_shown, u_shown);
    return {{static_cast<int>(u.shape(1)), static_cast<int>(u.shape(0))}, upload.data(), u.data(), for_upload.data(),
            for_u.data(), valid.data(), upload_shown.data(), u_shown.data()};
}

// Polls, one plane of cells below the other.
using Cells = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

Size size_of_cells(const Cells& polls, size_t height, size_t width) {
    const Size size{static_cast<int>(width), static_cast<int>(height)};
    if (height < 1 || width < 1 || height > kMaxSide || width > kMaxSide ||
        polls.shape(0) != static_cast<size_t>(kPolls * cells_of(size.height)) ||
        polls.shape(1) != static_cast<size_t>(cells_of(size.width)))
        throw nb::value_error("polls: expected a plane of cells for each poll, of the picture's size");
    return size;
}

// (level, equal, usual, edge, glints, beside).
using Facts = std::tuple<Plane, Plane, Plane, Plane, Flags, Flags>;

template <class T, class Source>
Output<T> copy_of(const Source& source) {
    Output<T> copy = new_plane<T>(source.shape(0), source.shape(1));
    std::copy(source.data(), source.data() + source.size(), copy.data());
    return copy;
}

// Samples of (height, width) or (height, width, 3): bool or uint8, uint16, or float32 planes.
using Image = nb::ndarray<nb::ro, nb::c_contig, nb::device::cpu>;

Samples samples_of(const Image& image, bool grey) {
    const nb::dlpack::dtype type = image.dtype();
    const int bytes = type == nb::dtype<float>() ? 4 : type == nb::dtype<uint16_t>() ? 2 : 1;
    if (bytes == 1 && type != nb::dtype<uint8_t>() && type != nb::dtype<bool>())
        throw nb::type_error("samples: expected bool, uint8, uint16 or float32");
    const bool colour = image.ndim() == 3 && image.shape(2) == 3 && bytes < 4;
    if (image.ndim() != 2 && !colour) throw nb::value_error("samples: expected (height, width), or an image of 3 channels");
    check_same_shape(image);
    const Size size{static_cast<int>(image.shape(1)), static_cast<int>(image.shape(0))};
    return {size, image.data(), bytes, colour ? 3 : 1, grey};
}

// Planes of one shape, and a new one for each.
struct Batch {
    std::vector<const float*> in;
    std::vector<float*> out;
    std::vector<Output<float>> arrays;

    Batch(const Plane& like, const std::vector<Plane>& planes, size_t height, size_t width) {
        for (const Plane& plane : planes) {
            check_same_shape(like, plane);
            in.push_back(plane.data());
            arrays.push_back(new_plane<float>(height, width));
            out.push_back(arrays.back().data());
        }
    }
};

}  // namespace
}  // namespace stereomend
