// The numerics of one worker: threads and buffers that stay from one call to the next.
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "cells.hpp"
#include "crowd.hpp"
#include "evidence.hpp"
#include "fusion.hpp"
#include "ldr.hpp"
#include "resize.hpp"
#include "sweeps.hpp"
#include "team.hpp"

namespace stereomend {

// Names of the instruction sets this machine can run, best first.
std::vector<std::string> instruction_sets();

// How the iterations of a warp are shared out: `count` laps of up to `length` iterations, in turn among `crew` members.
struct Laps {
    int length;
    int count;
    int crew;
};

// What one of `crew` members does.
struct Part {
    Rows rows;
    int member;
    int crew;
};

// One way to see a left image: the right one, the disparity and which pixels count, each row-major (height, width).
struct Reading {
    const float* right;
    const float* u;
    const bool* valid;
};

// Sum of the distances of descriptors, each 0 to 2, and their number.
struct Mismatch {
    double sum;
    long count;
};

// Asked before each warp of a solve, in the thread that called it: false ends the solve there, with u as far as it came.
// Must not throw, nor call the engine.
using GoOn = std::function<bool()>;

// One call at a time; calls from several threads wait for each other. Results are bitwise equal for any number of
// threads. Buffers grow to the largest image seen: nothing is allocated inside a solve.
class Engine {
public:
    // An empty instruction set takes the best. A wary engine leaves to one thread what takes longer with several while
    // other processes are on their cores. Throws std::invalid_argument for an instruction set that is not available.
    Engine(int threads, const std::string& instruction_set, bool wary = true);

    // All warps of one level: refines u (height, width) [in/out, px of the level]. The dual variable starts at 0.
    // The level's right image comes without padding, here and below.
    void solve(const Level& level, const SolverParams& params, float* u, const GoOn& go_on = nullptr);

    // For each reading of the left image (height, width): how far the signed descriptors of both images are from each
    // other, over the pixels that are valid and that the right image shows.
    std::vector<Mismatch> mismatch(Size size, const float* left, const std::vector<Reading>& readings);

    // Writes which pixels the right image does not show [out, (height, width)]; see ldr_sweeps.hpp.
    void unobserved(Size size, const float* u, bool* out);
    void shown(Size size, const float* u, const bool* valid, bool* shown, bool* hidden);

    // See ldr.hpp.
    void fill_occlusions(const Holes& map, const OcclusionRule& rule, bool* filled);
    void reach(const Terrain& terrain, bool* reached);
    void confidence(const ConfidenceInput& input, const ConfidenceParams& params, float* out);
    void fill(const Holes& map, int steps, int passes);

    // See evidence.hpp.
    void evidence(const Pair& pair, const std::vector<const float*>& maps, const std::vector<float*>& found);
    void trust(const ConfidenceInput& input, const TrustParams& params, const SpeckleRule& rule, float* out);
    void speckles(const Steps& map, int largest, bool* out);
    void edge_weights(const Channels& channels, const EdgeParams& params, float* out);
    void glints(const Channels& channels, const GlintRule& rule, bool* found, bool* nearly);
    void better(const Pair& pair, const float* u, const float* other, const ReuseRule& rule, float* out);
    void halve(Size from, const std::vector<const float*>& planes, const std::vector<float*>& out);
    void halve_weighed(Size from, const Weighed& map);

    // See fusion.hpp.
    void poll(const Rivals& rivals, const PollMarks& marks, const PollRule& rule, double* out);
    void choose(const Rivals& rivals, const Grounds& grounds, const ChoiceRule& rule, float* out);

    // See cells.hpp.
    void ground(Size size, const double* polls, const GroundRule& rule, float* const out[3]);
    void bend(Size size, const float* u, const double* polls, const BendRule& rule, float* out);

    // See resize.hpp.
    void shrink(const Samples& from, Size to, const Shrunk& out);
    void merge(const Offer& offer, float* out);
    void shrink_sparse(const Sparse& from, Size to, float half, float* u, bool* valid);
    void sample_sparse(const Sparse& from, Size to, float* u, bool* valid);
    void tell(const Origins& origins, const float* u, Kinds& out);

private:
    struct alignas(64) Progress {
        std::atomic<int> rows{0};
    };

    // A call has the engine for itself, and works with one thread where others take the cores.
    class Turn {
    public:
        explicit Turn(Engine& engine) : lock_(engine.mutex_) { engine.team_.muster(engine.crowd_.expected()); }

    private:
        std::lock_guard<std::mutex> lock_;
    };

    void reserve(int width, size_t rows);
    Level padded(const Level& level);
    long see(int width, const Reading& reading, Rows rows, bool* seen, long* counts);
    void prepare(const Level& level, float* u);
    void linearise(const Level& level, const SolverParams& params, const Window& window, const Part& part);
    void sweep(const Level& level, const SolverParams& params, int member);
    void wave(const Level& level, const SolverParams& params, const Laps& laps, int member);

    const Sweeps& sweeps_;
    std::mutex mutex_;
    Team team_;
    Crowd crowd_;
    std::vector<float> planes_;   // the solver's state, 5 planes
    std::vector<float> right_;    // the right image with its rows' ends repeated
    std::vector<float> scratch_;  // of each member
    std::vector<Progress> progress_;
    std::vector<uint8_t> seen_;   // bools of some rows, of each member
    std::vector<double> sums_;    // of each row of each reading
    std::vector<long> counts_;
    LdrBuffers ldr_buffers_;
    Crew ldr_;
    EvidenceBuffers evidence_buffers_;
    EvidenceCrew evidence_;
    CellBuffers cell_buffers_;
    FusionCrew fusion_;
    ResizeBuffers resize_buffers_;
    ResizeCrew resize_;
    State state_{};
};

}  // namespace stereomend
