// What both parts of the Python module share.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>

namespace stereomend {

namespace nb = nanobind;

using Plane = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const bool, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<const uint8_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <class T>
using Output = nb::ndarray<nb::numpy, T, nb::ndim<2>>;

constexpr size_t kMaxSide = 1 << 20;

template <class Array, class... Others>
void check_same_shape(const Array& first, const Others&... others) {
    if (first.shape(0) == 0 || first.shape(1) == 0 || first.shape(0) > kMaxSide || first.shape(1) > kMaxSide)
        throw nb::value_error("a plane has no pixel, or a side over 1048576 px");
    if (!((others.shape(0) == first.shape(0) && others.shape(1) == first.shape(1)) && ...))
        throw nb::value_error("planes differ in shape");
}

inline int check_threads(int threads) {
    if (threads < 1 || threads > 1024) throw nb::value_error("threads: expected 1 to 1024");
    return threads;
}

// A new array that owns its memory, not yet written.
template <class T>
Output<T> new_plane(size_t height, size_t width) {
    T* data = new T[height * width];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return Output<T>(data, {height, width}, owner);
}

// Adds what reads files and what measures the machine.
void bind_files(nb::module_& m);

}  // namespace stereomend
