// The Python module `stereomend._native`: checks shapes, releases the GIL, calls the sweeps.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <memory>
#include <stdexcept>

#include "ldr.hpp"
#include "solver.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using stereomend::Level;

namespace {

using Plane = nb::ndarray<const float, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Flags = nb::ndarray<const bool, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
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

int check_threads(int threads) {
    if (threads < 1 || threads > 1024) throw nb::value_error("threads: expected 1 to 1024");
    return threads;
}

int width_of(const Plane& plane) { return static_cast<int>(plane.shape(1)); }
int height_of(const Plane& plane) { return static_cast<int>(plane.shape(0)); }

// A new array that owns its memory, not yet written.
template <class T>
Output<T> new_plane(size_t height, size_t width) {
    T* data = new T[height * width];
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<T*>(p); });
    return Output<T>(data, {height, width}, owner);
}

template <class T, class Source>
Output<T> copy_of(const Source& source) {
    Output<T> copy = new_plane<T>(source.shape(0), source.shape(1));
    std::copy(source.data(), source.data() + source.size(), copy.data());
    return copy;
}

Output<float> solve(const Plane& left, const Plane& right, const Plane& u, int warps, int iterations, float data_weight,
                    float huber_epsilon, float tau, float sigma, bool absolute, int threads,
                    const std::string& instruction_set) {
    check_same_shape(left, right, u);
    check_threads(threads);
    const stereomend::Sweeps& sweeps = stereomend::choose_sweeps(instruction_set);
    const Level level{width_of(left), height_of(left), left.data(), right.data()};
    const stereomend::SolverParams params{data_weight, huber_epsilon, tau, sigma, warps, iterations, absolute};
    Output<float> out = copy_of<float>(u);
    nb::gil_scoped_release unlocked;
    stereomend::solve_level(sweeps, level, params, out.data(), threads);
    return out;
}

Output<float> distance(const Plane& left, const Plane& right, const Plane& u, bool absolute, int threads) {
    check_same_shape(left, right, u);
    check_threads(threads);
    const Level level{width_of(left), height_of(left), left.data(), right.data()};
    Output<float> out = new_plane<float>(left.shape(0), left.shape(1));
    nb::gil_scoped_release unlocked;
    stereomend::descriptor_distance(stereomend::choose_sweeps(""), level, u.data(), absolute, out.data(), threads);
    return out;
}

Output<float> confidence(const Plane& left, const Plane& right, const Plane& u, const Flags& valid, const Flags& matte,
                         int window, float smoothness_weight, int smoothness_power, float photometric_weight,
                         int threads) {
    check_same_shape(left, right, u, valid, matte);
    check_threads(threads);
    const stereomend::ConfidenceInput input{{width_of(left), height_of(left)}, left.data(),  right.data(),
                                            u.data(),                          valid.data(), matte.data()};
    const stereomend::ConfidenceParams params{window, smoothness_weight, smoothness_power, photometric_weight};
    Output<float> out = new_plane<float>(left.shape(0), left.shape(1));
    nb::gil_scoped_release unlocked;
    stereomend::confidence(input, params, out.data(), threads);
    return out;
}

Output<float> fill(const Plane& u, const Flags& known, int steps, int passes, int threads) {
    check_same_shape(u, known);
    check_threads(threads);
    Output<float> out = copy_of<float>(u);
    Output<bool> seen = copy_of<bool>(known);
    nb::gil_scoped_release unlocked;
    stereomend::fill({width_of(u), height_of(u)}, out.data(), seen.data(), steps, passes, threads);
    return out;
}

}  // namespace

NB_MODULE(_native, m) {
    m.doc() = "LDR and GDR on the CPU. Planes are C-contiguous, (height, width), float32 or bool.";
    m.attr("KERNEL_HASH") = KERNEL_HASH;
    m.def("instruction_sets", &stereomend::instruction_sets, "What this machine can run, best first.");
    m.def("solve", &solve, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(), nb::kw_only(), "warps"_a,
          "iterations"_a, "data_weight"_a, "huber_epsilon"_a, "tau"_a, "sigma"_a, "absolute"_a, "threads"_a,
          "instruction_set"_a = "", "All warps of one level; returns the new u.");
    m.def("distance", &distance, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(), nb::kw_only(),
          "absolute"_a, "threads"_a, "The distance of the descriptors at every pixel.");
    m.def("confidence", &confidence, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
          "valid"_a.noconvert(), "matte"_a.noconvert(), nb::kw_only(), "window"_a, "smoothness_weight"_a,
          "smoothness_power"_a, "photometric_weight"_a, "threads"_a, "C_f at every pixel.");
    m.def("fill", &fill, "u"_a.noconvert(), "known"_a.noconvert(), nb::kw_only(), "steps"_a, "passes"_a, "threads"_a,
          "u with what is not known replaced.");
}
