// The Python module `stereomend._native`: checks shapes, releases the GIL, calls the sweeps.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <exception>
#include <optional>

#include "bindings.hpp"
#include "engine.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using stereomend::BendRule;
using stereomend::check_same_shape;
using stereomend::check_threads;
using stereomend::ChoiceRule;
using stereomend::ConfidenceInput;
using stereomend::ConfidenceParams;
using stereomend::Flags;
using stereomend::GroundRule;
using stereomend::half_of;
using stereomend::kMaxSide;
using stereomend::Level;
using stereomend::PollRule;
using stereomend::new_plane;
using stereomend::Output;
using stereomend::Plane;
using stereomend::Size;
using stereomend::SolverParams;
using stereomend::SpeckleRule;
using stereomend::TrustParams;

namespace {

void check_window(int window) {
    if (window < 1 || window > static_cast<int>(kMaxSide) || window % 2 == 0)
        throw nb::value_error("window: expected an odd number of 1 to 1048575 px");
}

// Two maps: (upload, valid, u, evidence for the upload, for u, upload shown, u shown).
using Views = std::tuple<Plane, Flags, Plane, Plane, Plane, Flags, Flags>;

stereomend::Rivals rivals_of(const Views& views) {
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
        polls.shape(0) != static_cast<size_t>(stereomend::kPolls * stereomend::cells_of(size.height)) ||
        polls.shape(1) != static_cast<size_t>(stereomend::cells_of(size.width)))
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

stereomend::Samples samples_of(const Image& image, bool grey) {
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

// The kernels with threads and buffers of their own; see engine.hpp.
class PyEngine {
public:
    PyEngine(int threads, const std::string& instruction_set)
        : engine_(check_threads(threads), instruction_set) {}

    Output<float> solve(const Plane& left, const Plane& right, const Plane& u, const std::optional<Plane>& weight,
                        const SolverParams& params, const std::optional<Plane>& edge, const std::optional<Plane>& prior,
                        const std::optional<Plane>& trust, const std::optional<nb::callable>& tick) {
        check_same_shape(left, right, u, weight ? *weight : u, edge ? *edge : u, prior ? *prior : u, trust ? *trust : u);
        Level level = level_of(left, right, weight ? weight->data() : nullptr);
        level.edge = edge ? edge->data() : nullptr;
        level.prior = prior ? prior->data() : nullptr;
        level.trust = trust ? trust->data() : nullptr;
        Output<float> out = copy_of<float>(u);
        std::exception_ptr raised;
        const auto go_on = [&] {
            nb::gil_scoped_acquire locked;
            try {
                (*tick)();
            } catch (...) {
                raised = std::current_exception();
            }
            return !raised;
        };
        {
            nb::gil_scoped_release unlocked;
            engine_.solve(level, params, out.data(), tick ? stereomend::GoOn(go_on) : nullptr);
        }
        if (raised) std::rethrow_exception(raised);
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

    // One plane, or R, G, B and their grey level.
    std::vector<Output<float>> shrink(const Image& image, size_t height, size_t width, bool grey) {
        const stereomend::Samples samples = samples_of(image, grey);
        if (height < 1 || width < 1 || height > image.shape(0) || width > image.shape(1))
            throw nb::value_error("size: expected sides of 1 px to those of the samples");
        std::vector<Output<float>> planes;
        stereomend::Shrunk out{};
        for (int k = 0; k < values_of(samples); ++k) {
            planes.push_back(new_plane<float>(height, width));
            out.plane[k] = planes.back().data();
        }
        nb::gil_scoped_release unlocked;
        engine_.shrink(samples, {static_cast<int>(width), static_cast<int>(height)}, out);
        return planes;
    }

    Output<float> merge(const Plane& u, const Plane& share, const Plane& sample, const Plane& upload,
                        const Flags& valid, float near, float half) {
        check_same_shape(u, share, sample);
        check_same_shape(upload, valid);
        if (u.shape(0) > upload.shape(0) || u.shape(1) > upload.shape(1))
            throw nb::value_error("upload: expected no smaller sides than those of the working size");
        const Size from = size_of(u);
        const Size to = size_of(upload);
        const float ratio = static_cast<float>(static_cast<double>(to.width) / from.width);
        Output<float> out = new_plane<float>(to.height, to.width);
        nb::gil_scoped_release unlocked;
        engine_.merge({from, u.data(), share.data(), sample.data(), to, upload.data(), valid.data(), ratio, near, half},
                      out.data());
        return out;
    }

    std::pair<Output<float>, Output<bool>> shrink_sparse(const Plane& u, const Flags& valid, size_t height,
                                                         size_t width, float half) {
        return resized(u, valid, height, width, [&](const stereomend::Sparse& from, Size to, float* out, bool* known) {
            engine_.shrink_sparse(from, to, half, out, known);
        });
    }

    std::pair<Output<float>, Output<bool>> sample_sparse(const Plane& u, const Flags& valid, size_t height,
                                                         size_t width) {
        return resized(u, valid, height, width, [&](const stereomend::Sparse& from, Size to, float* out, bool* known) {
            engine_.sample_sparse(from, to, out, known);
        });
    }

    // The kinds, and how many pixels of each there are.
    std::pair<Output<uint8_t>, std::vector<long>> tell(const Plane& u, const Plane& initial, const Flags& valid,
                                                       const Flags& kept, const std::optional<Flags>& scene,
                                                       float within) {
        check_same_shape(u, initial, valid, scene ? *scene : valid);
        check_same_shape(kept);
        if (kept.shape(0) > u.shape(0) || kept.shape(1) > u.shape(1))
            throw nb::value_error("u: expected no smaller sides than those of kept");
        Output<uint8_t> kind = new_plane<uint8_t>(u.shape(0), u.shape(1));
        const Size from{static_cast<int>(kept.shape(1)), static_cast<int>(kept.shape(0))};
        stereomend::Kinds kinds{kind.data(), {}};
        nb::gil_scoped_release unlocked;
        engine_.tell({from, kept.data(), size_of(u), initial.data(), valid.data(), scene ? scene->data() : nullptr, within},
                     u.data(), kinds);
        return {kind, {kinds.counts, kinds.counts + 4}};
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
        engine_.speckles({size_of(u), u.data(), valid.data(), rule.step, nullptr}, rule.largest, out.data());
        return out;
    }

    // The polls' cells one below the other.
    Output<double> poll(const Views& views, const Flags& matte, const Flags& spoilt, const PollRule& rule) {
        const stereomend::Rivals rivals = rivals_of(views);
        check_same_shape(std::get<0>(views), matte, spoilt);
        Output<double> out = new_plane<double>(stereomend::kPolls * stereomend::cells_of(rivals.size.height),
                                               stereomend::cells_of(rivals.size.width));
        nb::gil_scoped_release unlocked;
        engine_.poll(rivals, {matte.data(), spoilt.data()}, rule, out.data());
        return out;
    }

    Output<float> choose(const Views& views, const Facts& facts, const ChoiceRule& rule) {
        const stereomend::Rivals rivals = rivals_of(views);
        const auto& [level, equal, usual, edge, glints, beside] = facts;
        check_same_shape(std::get<0>(views), level, equal, usual, edge, glints, beside);
        Output<float> out = new_plane<float>(rivals.size.height, rivals.size.width);
        nb::gil_scoped_release unlocked;
        engine_.choose(rivals, {level.data(), equal.data(), usual.data(), edge.data(), glints.data(), beside.data()},
                       rule, out.data());
        return out;
    }

    // What is bright and colourless, and what is nearly as bright.
    std::pair<Output<bool>, Output<bool>> glints(const std::vector<Plane>& channels, float saturation, float bright,
                                                 float nearly) {
        const stereomend::Channels given = channels_of(channels);
        Output<bool> found = new_plane<bool>(given.size.height, given.size.width);
        Output<bool> almost = new_plane<bool>(given.size.height, given.size.width);
        nb::gil_scoped_release unlocked;
        engine_.glints(given, {saturation, bright, nearly}, found.data(), almost.data());
        return {found, almost};
    }

    // Trust, where the upload is as good, and the usual evidence, each (height, width).
    std::vector<Output<float>> ground(const Cells& polls, size_t height, size_t width, const GroundRule& rule) {
        const Size size = size_of_cells(polls, height, width);
        std::vector<Output<float>> planes;
        float* out[3];
        for (float*& plane : out) {
            planes.push_back(new_plane<float>(height, width));
            plane = planes.back().data();
        }
        nb::gil_scoped_release unlocked;
        engine_.ground(size, polls.data(), rule, out);
        return planes;
    }

    Output<float> bend(const Plane& u, const Cells& polls, const BendRule& rule) {
        check_same_shape(u);
        const Size size = size_of_cells(polls, u.shape(0), u.shape(1));
        Output<float> out = new_plane<float>(u.shape(0), u.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.bend(size, u.data(), polls.data(), rule, out.data());
        return out;
    }

    Output<float> edge_weights(const std::vector<Plane>& channels, float level, float power, float floor) {
        const stereomend::Channels given = channels_of(channels);
        Output<float> out = new_plane<float>(channels[0].shape(0), channels[0].shape(1));
        nb::gil_scoped_release unlocked;
        engine_.edge_weights(given, {level, power, floor}, out.data());
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
    template <class Body>
    std::pair<Output<float>, Output<bool>> resized(const Plane& u, const Flags& valid, size_t height, size_t width,
                                                   const Body& body) {
        check_same_shape(u, valid);
        if (height < 1 || width < 1 || height > u.shape(0) || width > u.shape(1))
            throw nb::value_error("size: expected sides of 1 px to those of u");
        Output<float> out = new_plane<float>(height, width);
        Output<bool> known = new_plane<bool>(height, width);
        nb::gil_scoped_release unlocked;
        body({size_of(u), u.data(), valid.data()}, {static_cast<int>(width), static_cast<int>(height)}, out.data(),
             known.data());
        return {out, known};
    }

    static stereomend::Channels channels_of(const std::vector<Plane>& channels) {
        if (channels.empty() || channels.size() > 3) throw nb::value_error("channels: expected 1 to 3");
        stereomend::Channels given{size_of(channels[0]), static_cast<int>(channels.size()), {}};
        for (size_t k = 0; k < channels.size(); ++k) {
            check_same_shape(channels[0], channels[k]);
            given.levels[k] = channels[k].data();
        }
        return given;
    }

    static Size size_of(const Plane& plane) {
        return {static_cast<int>(plane.shape(1)), static_cast<int>(plane.shape(0))};
    }

    static Level level_of(const Plane& left, const Plane& right, const float* weight) {
        const Size size = size_of(left);
        return {size.width, size.height, left.data(), right.data(), weight, nullptr, nullptr, nullptr};
    }

    stereomend::Engine engine_;
};

}  // namespace

NB_MODULE(_native, m) {
    // An engine may live as long as the interpreter, in a variable of a program or a traceback that something keeps.
    nb::set_leak_warnings(false);
    m.doc() = "LDR and GDR on the CPU. Planes are C-contiguous, (height, width), float32 or bool.";
    m.attr("KERNEL_HASH") = KERNEL_HASH;
    m.def("instruction_sets", &stereomend::instruction_sets, "What this machine can run, best first.");
    stereomend::bind_files(m);
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
    nb::class_<PollRule>(m, "PollRule", "Who votes on the upload; lengths in px, evidence without unit.")
        .def(nb::init<float, float, float, float, float, float, float>(), nb::kw_only(), "tolerance"_a, "near"_a,
             "lack"_a, "most"_a, "least"_a, "full"_a, "frame"_a);
    nb::class_<GroundRule>(m, "GroundRule", "Windows in px and constants of R8 and R9.")
        .def(nb::init<double, double, double, double, double, double, double, double>(), nb::kw_only(), "trust"_a,
             "evidence"_a, "far"_a, "far_share"_a, "min_trust"_a, "full_trust"_a, "worse_by"_a, "equal_within"_a);
    nb::class_<BendRule>(m, "BendRule", "The window in px, and the constants of R7.")
        .def(nb::init<double, float, float>(), nb::kw_only(), "window"_a, "bend"_a, "flat"_a);
    nb::class_<ChoiceRule>(m, "ChoiceRule", "The constants of R10; lengths in px.")
        .def(nb::init<float, float, float, float, float, float, float, float, float, float, float, int>(),
             nb::kw_only(), "near"_a, "enough"_a, "full_trust"_a, "high_trust"_a, "win_margin"_a, "trusted_margin"_a,
             "weak_share"_a, "spike"_a, "rough_share"_a, "step"_a, "soft_edge"_a, "largest_patch"_a);
    nb::class_<PyEngine>(m, "Engine", "The kernels with threads and buffers of their own; one call at a time.")
        .def(nb::init<int, const std::string&>(), "threads"_a, "instruction_set"_a = "")
        .def("solve", &PyEngine::solve, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
             "weight"_a.noconvert().none(), "params"_a, "edge"_a.noconvert().none() = nb::none(),
             "prior"_a.noconvert().none() = nb::none(), "trust"_a.noconvert().none() = nb::none(),
             "tick"_a.none() = nb::none(),
             "All warps of one level; returns the new u. Calls tick() before each; what it raises ends the solve.")
        .def("evidence", &PyEngine::evidence, "left"_a.noconvert(), "right"_a.noconvert(), "maps"_a.noconvert(),
             "n of each map.")
        .def("better", &PyEngine::better, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
             "other"_a.noconvert(), "margin"_a, "least"_a, "apart"_a, "u, or the other map where more speaks for it.")
        .def("halve", &PyEngine::halve, "planes"_a.noconvert(), "The planes at half of their size, rounded up.")
        .def("halve_weighed", &PyEngine::halve_weighed, "u"_a.noconvert(), "weight"_a.noconvert(),
             "Disparities at half of their size, averaged with the weight, and the weight.")
        .def("shrink", &PyEngine::shrink, "samples"_a.noconvert(), "height"_a, "width"_a, "grey"_a = false,
             "The area means of a plane, or of R, G, B and the grey level of these; with grey, of the grey level.")
        .def("merge", &PyEngine::merge, "u"_a.noconvert(), "share"_a.noconvert(), "sample"_a.noconvert(),
             "upload"_a.noconvert(), "valid"_a.noconvert(), "near"_a, "half"_a,
             "A map and the upload put together at the upload's size.")
        .def("shrink_sparse", &PyEngine::shrink_sparse, "u"_a.noconvert(), "valid"_a.noconvert(), "height"_a,
             "width"_a, "half"_a, "Means of disparities over their valid pixels, and which of them are valid.")
        .def("sample_sparse", &PyEngine::sample_sparse, "u"_a.noconvert(), "valid"_a.noconvert(), "height"_a,
             "width"_a, "Disparities and their validity at the centres of larger pixels.")
        .def("tell", &PyEngine::tell, "u"_a.noconvert(), "initial"_a.noconvert(), "valid"_a.noconvert(),
             "kept"_a.noconvert(), "scene"_a.noconvert().none(), "within"_a,
             "Where values come from, and how many pixels of each kind there are.")
        .def("trust", &PyEngine::trust, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
             "valid"_a.noconvert(), "matte"_a.noconvert(), "params"_a, "rule"_a, "c at every pixel.")
        .def("speckles", &PyEngine::speckles, "u"_a.noconvert(), "valid"_a.noconvert(), "rule"_a,
             "Which valid pixels belong to small patches.")
        .def("edge_weights", &PyEngine::edge_weights, "channels"_a.noconvert(), "level"_a, "power"_a, "floor"_a,
             "Weights of the smoothness.")
        .def("glints", &PyEngine::glints, "channels"_a.noconvert(), "saturation"_a, "bright"_a, "nearly"_a,
             "What is bright and colourless, and what is nearly as bright.")
        .def("poll", &PyEngine::poll, "views"_a, "matte"_a.noconvert(), "spoilt"_a.noconvert(), "rule"_a,
             "Means over cells of what pixels vote, one plane below the other.")
        .def("choose", &PyEngine::choose, "views"_a, "facts"_a, "rule"_a, "The share of the upload at every pixel.")
        .def("ground", &PyEngine::ground, "polls"_a.noconvert(), "height"_a, "width"_a, "rule"_a,
             "Trust, where the upload is as good, and the usual evidence at every pixel.")
        .def("bend", &PyEngine::bend, "u"_a.noconvert(), "polls"_a.noconvert(), "rule"_a,
             "u, bent towards the plane around it where its match lies outside of the right image.")
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
