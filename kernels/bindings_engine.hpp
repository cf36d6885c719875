// The class `Engine` of the Python module, for bindings.cpp alone: checks shapes, releases the GIL, calls the engine.
#pragma once

#include <exception>
#include <optional>
#include <string>
#include <utility>

#include "bindings_arrays.hpp"

namespace stereomend {
namespace {

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
            engine_.solve(level, params, out.data(), tick ? GoOn(go_on) : nullptr);
        }
        if (raised) std::rethrow_exception(raised);
        return out;
    }

    // The means, 0 of nothing, and of how many pixels each; a reading is (right, u, valid).
    std::vector<std::pair<double, long>> mismatch(const Plane& left,
                                                  const std::vector<std::tuple<Plane, Plane, Flags>>& given) {
        check_same_shape(left);
        std::vector<Reading> readings;
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
        const Samples samples = samples_of(image, grey);
        if (height < 1 || width < 1 || height > image.shape(0) || width > image.shape(1))
            throw nb::value_error("size: expected sides of 1 px to those of the samples");
        std::vector<Output<float>> planes;
        Shrunk out{};
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
        return resized(u, valid, height, width, [&](const Sparse& from, Size to, float* out, bool* known) {
            engine_.shrink_sparse(from, to, half, out, known);
        });
    }

    std::pair<Output<float>, Output<bool>> sample_sparse(const Plane& u, const Flags& valid, size_t height,
                                                         size_t width) {
        return resized(u, valid, height, width, [&](const Sparse& from, Size to, float* out, bool* known) {
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
        Kinds kinds{kind.data(), {}};
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
        const Rivals rivals = rivals_of(views);
        check_same_shape(std::get<0>(views), matte, spoilt);
        Output<double> out = new_plane<double>(kPolls * cells_of(rivals.size.height),
                                               cells_of(rivals.size.width));
        nb::gil_scoped_release unlocked;
        engine_.poll(rivals, {matte.data(), spoilt.data()}, rule, out.data());
        return out;
    }

    Output<float> choose(const Views& views, const Facts& facts, const ChoiceRule& rule) {
        const Rivals rivals = rivals_of(views);
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
        const Channels given = channels_of(channels);
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
        const Channels given = channels_of(channels);
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

    std::pair<Output<bool>, Output<bool>> shown(const Plane& u, const Flags& valid) {
        check_same_shape(u, valid);
        Output<bool> shown = new_plane<bool>(u.shape(0), u.shape(1));
        Output<bool> hidden = new_plane<bool>(u.shape(0), u.shape(1));
        nb::gil_scoped_release unlocked;
        engine_.shown(size_of(u), u.data(), valid.data(), shown.data(), hidden.data());
        return {shown, hidden};
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

    static Channels channels_of(const std::vector<Plane>& channels) {
        if (channels.empty() || channels.size() > 3) throw nb::value_error("channels: expected 1 to 3");
        Channels given{size_of(channels[0]), static_cast<int>(channels.size()), {}};
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

    Engine engine_;
};

}  // namespace
}  // namespace stereomend
