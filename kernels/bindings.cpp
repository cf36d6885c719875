// The Python module `stereomend._native`: checks shapes, releases the GIL, calls the sweeps.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <optional>

#include "ceilings.hpp"
#include "engine.hpp"
#include "png_chunks.hpp"
#include "png_rows.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using stereomend::half_of;
using stereomend::ConfidenceInput;
using stereomend::ConfidenceParams;
using stereomend::Level;
using stereomend::Size;
using stereomend::SolverParams;
using stereomend::SpeckleRule;
using stereomend::TrustParams;

namespace {

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

int check_threads(int threads) {
    if (threads < 1 || threads > 1024) throw nb::value_error("threads: expected 1 to 1024");
    return threads;
}

void check_window(int window) {
    if (window < 1 || window > static_cast<int>(kMaxSide) || window % 2 == 0)
        throw nb::value_error("window: expected an odd number of 1 to 1048575 px");
}

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

// The kernels with threads and buffers of their own; see engine.hpp.
class PyEngine {
public:
    PyEngine(int threads, const std::string& instruction_set)
        : engine_(check_threads(threads), instruction_set) {}

    Output<float> solve(const Plane& left, const Plane& right, const Plane& u, const std::optional<Plane>& weight,
                        const SolverParams& params, const std::optional<Plane>& edge, const std::optional<Plane>& prior,
                        const std::optional<Plane>& trust) {
        check_same_shape(left, right, u, weight ? *weight : u, edge ? *edge : u, prior ? *prior : u, trust ? *trust : u);
        Level level = level_of(left, right, weight ? weight->data() : nullptr);
        level.edge = edge ? edge->data() : nullptr;
        level.prior = prior ? prior->data() : nullptr;
        level.trust = trust ? trust->data() : nullptr;
        Output<float> out = copy_of<float>(u);
        nb::gil_scoped_release unlocked;
        engine_.solve(level, params, out.data());
        return out;
    }

    // The means, 0 of nothing, and of how many pixels each; a reading is (right, u, valid).
    std::vector<std::pair<double, long>> mismatch(const Plane& left,
                                                  const std::vector<std::tuple<Plane, Plane, Flags>>& given) {
        check_same_shape(left);
        std::vector<stereomend::Reading> readings;
        for (const auto& [right, u, valid] : given) {
            check_same_shape(left, right, u, valid);
            readings.push_back({right.data(), u.data(), valid.data()});
        }
        nb::gil_scoped_release unlocked;
        std::vector<std::pair<double, long>> means;
        for (const auto& [sum, count] : engine_.mismatch(size_of(left), left.data(), readings))
            means.emplace_back(count > 0 ? sum / static_cast<double>(count) : 0.0, count);
        return means;
    }

    // n of each map.
    std::vector<Output<float>> evidence(const Plane& left, const Plane& right, const std::vector<Plane>& maps) {
        check_same_shape(left, right);
        const Batch batch(left, maps, left.shape(0), left.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.evidence({size_of(left), left.data(), right.data()}, batch.in, batch.out);
        return batch.arrays;
    }

    Output<float> better(const Plane& left, const Plane& right, const Plane& u, const Plane& other, float margin,
                         float least, float apart) {
        check_same_shape(left, right, u, other);
        Output<float> out = new_plane<float>(left.shape(0), left.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.better({size_of(left), left.data(), right.data()}, u.data(), other.data(), {margin, least, apart},
                       out.data());
        return out;
    }

    std::vector<Output<float>> halve(const std::vector<Plane>& planes) {
        if (planes.empty()) return {};
        const Size from = size_of(planes[0]);
        const Batch batch(planes[0], planes, half_of(from.height), half_of(from.width));
        nb::gil_scoped_release unlocked;
        engine_.halve(from, batch.in, batch.out);
        return batch.arrays;
    }

    std::pair<Output<float>, Output<float>> halve_weighed(const Plane& u, const Plane& weight) {
        check_same_shape(u, weight);
        const Size from = size_of(u);
        Output<float> out = new_plane<float>(half_of(from.height), half_of(from.width));
        Output<float> out_weight = new_plane<float>(half_of(from.height), half_of(from.width));
        nb::gil_scoped_release unlocked;
        engine_.halve_weighed(from, {u.data(), weight.data(), out.data(), out_weight.data()});
        return {out, out_weight};
    }

    Output<float> trust(const Plane& left, const Plane& right, const Plane& u, const Flags& valid, const Flags& matte,
                        const TrustParams& params, const SpeckleRule& rule) {
        check_same_shape(left, right, u, valid, matte);
        const ConfidenceInput input{size_of(left), left.data(), right.data(), u.data(), valid.data(), matte.data()};
        Output<float> out = new_plane<float>(left.shape(0), left.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.trust(input, params, rule, out.data());
        return out;
    }

    Output<bool> speckles(const Plane& u, const Flags& valid, const SpeckleRule& rule) {
        check_same_shape(u, valid);
        Output<bool> out = new_plane<bool>(u.shape(0), u.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.speckles({size_of(u), u.data(), valid.data(), rule.step}, rule.largest, out.data());
        return out;
    }

    Output<float> edge_weights(const std::vector<Plane>& channels, float falloff, float power, float floor) {
        if (channels.empty() || channels.size() > 3) throw nb::value_error("channels: expected 1 to 3");
        stereomend::Channels given{size_of(channels[0]), static_cast<int>(channels.size()), {}};
        for (size_t k = 0; k < channels.size(); ++k) {
            check_same_shape(channels[0], channels[k]);
            given.levels[k] = channels[k].data();
        }
        Output<float> out = new_plane<float>(channels[0].shape(0), channels[0].shape(1));
        nb::gil_scoped_release unlocked;
        engine_.edge_weights(given, {falloff, power, floor}, out.data());
        return out;
    }

    std::pair<Output<float>, Output<bool>> fill_occlusions(const Plane& u, const Flags& known, float step,
                                                           float stretch, float slack) {
        check_same_shape(u, known);
        Output<float> out = copy_of<float>(u);
        Output<bool> filled = new_plane<bool>(u.shape(0), u.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.fill_occlusions({size_of(u), out.data(), known.data()}, {step, stretch, slack}, filled.data());
        return {out, filled};
    }

    Output<bool> reach(const Flags& seeds, const Flags& passing, const Flags& soft, const Plane& u, float step) {
        check_same_shape(u, seeds, passing, soft);
        Output<bool> out = copy_of<bool>(seeds);
        nb::gil_scoped_release unlocked;
        engine_.reach({size_of(u), u.data(), passing.data(), soft.data(), step}, out.data());
        return out;
    }

    Output<bool> unobserved(const Plane& u) {
        check_same_shape(u);
        Output<bool> out = new_plane<bool>(u.shape(0), u.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.unobserved(size_of(u), u.data(), out.data());
        return out;
    }

    Output<float> confidence(const Plane& left, const Plane& right, const Plane& u, const Flags& valid,
                             const Flags& matte, const ConfidenceParams& params) {
        check_same_shape(left, right, u, valid, matte);
        check_window(params.window);
        const ConfidenceInput input{size_of(left), left.data(), right.data(), u.data(), valid.data(), matte.data()};
        Output<float> out = new_plane<float>(left.shape(0), left.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.confidence(input, params, out.data());
        return out;
    }

    Output<float> fill(const Plane& u, const Flags& known, int steps, int passes) {
        check_same_shape(u, known);
        Output<float> out = copy_of<float>(u);
        nb::gil_scoped_release unlocked;
        engine_.fill({size_of(u), out.data(), known.data()}, steps, passes);
        return out;
    }

private:
    static Size size_of(const Plane& plane) {
        return {static_cast<int>(plane.shape(1)), static_cast<int>(plane.shape(0))};
    }

    static Level level_of(const Plane& left, const Plane& right, const float* weight) {
        const Size size = size_of(left);
        return {size.width, size.height, left.data(), right.data(), weight, nullptr, nullptr, nullptr};
    }

    stereomend::Engine engine_;
};

// The samples (height, stride) of filtered rows; see png_rows.hpp.
Output<uint8_t> unfilter(const Bytes& filtered, size_t height, size_t stride, size_t bytes_per_pixel) {
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

// (name, begin, size) of each chunk, and what is wrong: a value of PngFault; see png_chunks.hpp.
std::pair<std::vector<std::tuple<uint32_t, size_t, size_t>>, int> find_chunks(const Bytes& file, size_t at,
                                                                              size_t most) {
    if (at > file.size()) throw nb::value_error("at: expected a place in the file");
    std::vector<stereomend::PngChunk> chunks;
    stereomend::PngFault fault;
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

NB_MODULE(_native, m) {
    // An engine may live as long as the interpreter, in a variable of a program or a traceback that something keeps.
    nb::set_leak_warnings(false);
    m.doc() = "LDR and GDR on the CPU. Planes are C-contiguous, (height, width), float32 or bool.";
    m.attr("KERNEL_HASH") = KERNEL_HASH;
    m.def("instruction_sets", &stereomend::instruction_sets, "What this machine can run, best first.");
    m.def("triad", [](int threads) { return measure(stereomend::triad, threads); }, "threads"_a,
          "Memory traffic of a = b + s * c [GB/s].");
    m.def("multiply_add", [](int threads) { return measure(stereomend::multiply_add, threads); }, "threads"_a,
          "float32 multiply-adds of all threads together [GFlop/s].");
    m.def("find_chunks", &find_chunks, "file"_a.noconvert(), "at"_a, "most"_a,
          "(name, begin, size) of a PNG's chunks from byte at, and 0, or 1: cut off, 2: the last has a wrong checksum, "
          "3: more than most.");
    m.def("unfilter", &unfilter, "filtered"_a.noconvert(), "height"_a, "stride"_a, "bytes_per_pixel"_a,
          "The bytes of a PNG's samples, (height, stride), from height rows of 1 + stride filtered ones.");
    nb::class_<SolverParams>(m, "SolverParams", "data_weight, huber_epsilon, tau, sigma, warps, iterations, absolute, observed_only, averaging.")
        .def(nb::init<float, float, float, float, int, int, bool, bool, float>(), nb::kw_only(), "data_weight"_a,
             "huber_epsilon"_a, "tau"_a, "sigma"_a, "warps"_a, "iterations"_a, "absolute"_a,
             "observed_only"_a = false, "averaging"_a = 0.0f);
    nb::class_<ConfidenceParams>(m, "ConfidenceParams", "Of Eq. 1 and 2; the window in px.")
        .def(nb::init<int, float, int, float>(), nb::kw_only(), "window"_a, "smoothness_weight"_a,
             "smoothness_power"_a, "photometric_weight"_a);
    nb::class_<TrustParams>(m, "TrustParams", "Evidence where confidence begins and is full; and px that say nothing.")
        .def(nb::init<float, float, float>(), nb::kw_only(), "least"_a, "full"_a, "smallest"_a);
    nb::class_<SpeckleRule>(m, "SpeckleRule", "The most pixels of a speckle, and the largest step inside of one, px.")
        .def(nb::init<int, float>(), nb::kw_only(), "largest"_a, "step"_a);
    nb::class_<PyEngine>(m, "Engine", "The kernels with threads and buffers of their own; one call at a time.")
        .def(nb::init<int, const std::string&>(), "threads"_a, "instruction_set"_a = "")
        .def("solve", &PyEngine::solve, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
             "weight"_a.noconvert().none(), "params"_a, "edge"_a.noconvert().none() = nb::none(),
             "prior"_a.noconvert().none() = nb::none(), "trust"_a.noconvert().none() = nb::none(),
             "All warps of one level; returns the new u.")
        .def("evidence", &PyEngine::evidence, "left"_a.noconvert(), "right"_a.noconvert(), "maps"_a.noconvert(),
             "n of each map.")
        .def("better", &PyEngine::better, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
             "other"_a.noconvert(), "margin"_a, "least"_a, "apart"_a, "u, or the other map where more speaks for it.")
        .def("halve", &PyEngine::halve, "planes"_a.noconvert(), "The planes at half of their size, rounded up.")
        .def("halve_weighed", &PyEngine::halve_weighed, "u"_a.noconvert(), "weight"_a.noconvert(),
             "Disparities at half of their size, averaged with the weight, and the weight.")
        .def("trust", &PyEngine::trust, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
             "valid"_a.noconvert(), "matte"_a.noconvert(), "params"_a, "rule"_a, "c at every pixel.")
        .def("speckles", &PyEngine::speckles, "u"_a.noconvert(), "valid"_a.noconvert(), "rule"_a,
             "Which valid pixels belong to small patches.")
        .def("edge_weights", &PyEngine::edge_weights, "channels"_a.noconvert(), "falloff"_a, "power"_a, "floor"_a,
             "Weights of the smoothness.")
        .def("fill_occlusions", &PyEngine::fill_occlusions, "u"_a.noconvert(), "known"_a.noconvert(), "step"_a,
             "stretch"_a, "slack"_a, "u with its occlusions filled, and which pixels those are.")
        .def("reach", &PyEngine::reach, "seeds"_a.noconvert(), "passing"_a.noconvert(), "soft"_a.noconvert(),
             "u"_a.noconvert(), "step"_a, "What can be reached from the seeds.")
        .def("mismatch", &PyEngine::mismatch, "left"_a.noconvert(), "readings"_a.noconvert(),
             "Mean distance of the descriptors over valid observed pixels, and their number, of each reading.")
        .def("unobserved", &PyEngine::unobserved, "u"_a.noconvert(), "What the right image does not show.")
        .def("confidence", &PyEngine::confidence, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
             "valid"_a.noconvert(), "matte"_a.noconvert(), "params"_a, "C_f at every pixel.")
        .def("fill", &PyEngine::fill, "u"_a.noconvert(), "known"_a.noconvert(), "steps"_a, "passes"_a,
             "u with what is not known replaced.");
}
