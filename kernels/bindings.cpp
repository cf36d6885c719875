// The Python module `stereomend._native`.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "bindings_engine.hpp"

namespace nb = nanobind;
using namespace nb::literals;
using stereomend::BendRule;
using stereomend::ChoiceRule;
using stereomend::ConfidenceParams;
using stereomend::GroundRule;
using stereomend::PollRule;
using stereomend::PyEngine;
using stereomend::SolverParams;
using stereomend::SpeckleRule;
using stereomend::TrustParams;

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
        .def("shown", &PyEngine::shown, "u"_a.noconvert(), "valid"_a.noconvert(),
             "What the right image shows of the valid pixels; what it does not, or hardly.")
        .def("confidence", &PyEngine::confidence, "left"_a.noconvert(), "right"_a.noconvert(), "u"_a.noconvert(),
             "valid"_a.noconvert(), "matte"_a.noconvert(), "params"_a, "C_f at every pixel.")
        .def("fill", &PyEngine::fill, "u"_a.noconvert(), "known"_a.noconvert(), "steps"_a, "passes"_a,
             "u with what is not known replaced.");
}
