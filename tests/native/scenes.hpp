// Inputs of the kernels for programs that check them without Python.
#pragma once

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "../../kernels/engine.hpp"

struct Scene {
    stereomend::Size size;
    std::vector<float> left, right, u;
    std::vector<uint8_t> known, soft;
    std::vector<float> weight, edge, prior, trust;

    stereomend::Level level() const {
        return {size.width, size.height, left.data(), right.data(), nullptr, nullptr, nullptr, nullptr};
    }
    // With all that a solve can be told besides the pair.
    stereomend::Level guided_level() const {
        return {size.width,  size.height, left.data(),  right.data(),
                weight.data(), edge.data(), prior.data(), trust.data()};
    }
    const bool* flags() const { return reinterpret_cast<const bool*>(known.data()); }
    const bool* soft_flags() const { return reinterpret_cast<const bool*>(soft.data()); }
};

// A small generator of its own: the same numbers everywhere.
struct Noise {
    uint32_t state;

    float operator()() {
        state = state * 1664525u + 1013904223u;
        return static_cast<float>(state >> 8) / static_cast<float>(1u << 24);
    }
};

inline Scene noisy_scene(int width, int height, uint32_t seed) {
    const size_t pixels = static_cast<size_t>(width) * height;
    const std::vector<float> plane(pixels);
    const std::vector<uint8_t> flags(pixels);
    Scene scene{{width, height}, plane, plane, plane, flags, flags, plane, plane, plane, plane};
    Noise noise{seed};
    for (size_t i = 0; i < pixels; ++i) {
        scene.left[i] = 255.0f * noise();
        scene.right[i] = 255.0f * noise();
        scene.u[i] = 40.0f * noise() - 2.0f;
        scene.known[i] = noise() < 0.3f;
    }
    for (size_t i = 0; i < pixels; ++i) {
        scene.soft[i] = noise() < 0.2f;
        scene.weight[i] = noise();
        scene.edge[i] = 0.03f + 0.97f * noise();
        scene.prior[i] = 40.0f * noise();
        scene.trust[i] = noise() < 0.5f ? 0.2f * noise() : 0.0f;
    }
    return scene;
}

// A file of int32 width and height, then float32 left, right and u; what is not positive is unknown.
inline Scene read_scene(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    int32_t sides[2] = {0, 0};
    file.read(reinterpret_cast<char*>(sides), sizeof sides);
    Scene scene = noisy_scene(sides[0], sides[1], 0);
    for (std::vector<float>* plane : {&scene.left, &scene.right, &scene.u})
        file.read(reinterpret_cast<char*>(plane->data()), static_cast<std::streamsize>(plane->size() * sizeof(float)));
    if (!file) throw std::runtime_error(path + " is too short");
    for (size_t i = 0; i < scene.u.size(); ++i) scene.known[i] = scene.u[i] > 0.0f;
    return scene;
}

// Adds the flags to the end of the outputs.
inline void append(std::vector<float>& out, const std::vector<uint8_t>& flags) {
    out.insert(out.end(), flags.begin(), flags.end());
}

// All outputs that the choice between two maps needs, one after the other; `solved` is one of them.
inline std::vector<float> run_guided(stereomend::Engine& engine, const Scene& scene,
                                     const stereomend::SolverParams& params, const std::vector<float>& solved) {
    const size_t pixels = scene.u.size();
    std::vector<float> out(2 * pixels);
    float* guided = out.data();
    float* filled = guided + pixels;
    std::copy(solved.begin(), solved.end(), guided);
    engine.solve(scene.guided_level(), params, guided);
    std::copy(guided, guided + pixels, filled);
    std::vector<uint8_t> occluded(pixels), reached(scene.soft);
    engine.fill_occlusions({scene.size, filled, scene.flags()}, {1.0f, 1.3f, 6.0f},
                           reinterpret_cast<bool*>(occluded.data()));
    engine.reach({scene.size, filled, scene.flags(), scene.soft_flags(), 1.0f},
                 reinterpret_cast<bool*>(reached.data()));
    append(out, occluded);
    append(out, reached);
    return out;
}

// All outputs of what the pair says for maps, one after the other.
inline std::vector<float> run_evidence(stereomend::Engine& engine, const Scene& scene) {
    const size_t pixels = scene.u.size();
    const auto [width, height] = scene.size;
    const size_t half = static_cast<size_t>(stereomend::half_of(width)) * stereomend::half_of(height);
    std::vector<float> out(6 * pixels + 4 * half);
    float* at = out.data();
    engine.evidence({scene.size, scene.left.data(), scene.right.data()},
                    {scene.u.data(), scene.prior.data(), scene.u.data()}, {at, at + pixels, at + 2 * pixels});
    engine.trust({scene.size, scene.left.data(), scene.right.data(), scene.u.data(), scene.flags(), scene.soft_flags()},
                 {0.2f, 0.7f, 0.5f}, {4, 1.0f}, at + 3 * pixels);
    engine.edge_weights({scene.size, 3, {scene.left.data(), scene.right.data(), scene.u.data()}}, {10.0f, 0.8f, 0.03f},
                        at + 4 * pixels);
    engine.better({scene.size, scene.left.data(), scene.right.data()}, scene.u.data(), scene.prior.data(),
                  {0.05f, 0.0f, 0.5f}, at + 5 * pixels);
    float* halves = at + 6 * pixels;
    engine.halve(scene.size, {scene.left.data(), scene.u.data()}, {halves, halves + half});
    engine.halve_weighed(scene.size, {scene.u.data(), scene.trust.data(), halves + 2 * half, halves + 3 * half});
    for (const int largest : {0, 3, 1000}) {
        std::vector<uint8_t> small(pixels);
        engine.speckles({scene.size, scene.u.data(), scene.flags(), 8.0f}, largest,
                        reinterpret_cast<bool*>(small.data()));
        append(out, small);
    }
    return out;
}

// All outputs of changes of size, one after the other: to three quarters, and from there and from half back.
inline std::vector<float> run_resize(stereomend::Engine& engine, const Scene& scene) {
    const size_t pixels = scene.u.size();
    const auto [width, height] = scene.size;
    const stereomend::Size less{std::max(1, 3 * width / 4), std::max(1, 3 * height / 4)};
    const size_t few = static_cast<size_t>(less.width) * less.height;
    std::vector<float> out(8 * few + 2 * pixels);
    float* at = out.data();
    const auto shrink = [&](const void* samples, int bytes, int channels, bool grey) {
        stereomend::Shrunk planes{};
        const stereomend::Samples from{scene.size, samples, bytes, channels, grey};
        for (int k = 0; k < values_of(from); ++k, at += few) planes.plane[k] = at;
        engine.shrink(from, less, planes);
    };
    const std::vector<uint8_t> image(scene.known.size() * 3, 200);
    const std::vector<uint16_t> deep(scene.known.size() * 3, 51400);
    shrink(scene.u.data(), 4, 1, false);
    shrink(scene.known.data(), 1, 1, false);
    shrink(image.data(), 1, 3, true);
    shrink(deep.data(), 2, 3, false);
    float* samples = at;
    shrink(scene.prior.data(), 4, 1, false);
    for (const stereomend::Size from : {less, stereomend::Size{(width + 1) / 2, (height + 1) / 2}}) {
        const float ratio = static_cast<float>(width) / from.width;
        engine.merge({from, scene.prior.data(), scene.weight.data(), from.width == less.width ? samples : scene.u.data(),
                      scene.size, scene.u.data(), scene.flags(), ratio, 0.7f, 0.5f}, at);
        at += pixels;
    }
    return out;
}

// The polls, then the shares of the first of two maps: `u` against `prior`.
inline std::vector<float> run_fusion(stereomend::Engine& engine, const Scene& scene) {
    const size_t pixels = scene.u.size();
    const auto [width, height] = scene.size;
    const size_t cells = static_cast<size_t>(stereomend::cells_of(width)) * stereomend::cells_of(height);
    std::vector<double> polls(stereomend::kPolls * cells);
    const stereomend::Rivals rivals{scene.size,          scene.u.data(), scene.prior.data(), scene.edge.data(),
                                    scene.weight.data(), scene.flags(),  scene.flags(),      scene.soft_flags()};
    engine.poll(rivals, {scene.flags(), scene.soft_flags()}, {9.0f, 9.0f, 0.1f, 0.7f, 3.0f}, polls.data());
    std::vector<float> out(polls.begin(), polls.end());
    out.resize(out.size() + 2 * pixels);
    float* share = out.data() + polls.size();
    const stereomend::Grounds grounds{scene.weight.data(), scene.edge.data(), scene.trust.data(),
                                      scene.weight.data(), scene.soft_flags(), scene.flags()};
    // One of few patches and steps that join little, one of many that join nearly all.
    engine.choose(rivals, grounds, {9.0f, 0.2f, 0.5f, 0.8f, 0.1f, 0.2f, 0.8f, 9.0f, 0.9f, 8.0f, 0.3f, 2}, share);
    engine.choose(rivals, grounds, {30.0f, 0.1f, 0.2f, 0.3f, 0.1f, 0.2f, 0.8f, 30.0f, 1.0f, 30.0f, 0.9f, 0},
                  share + pixels);
    return out;
}

// All outputs of the kernels, one after the other.
inline std::vector<float> run_all(stereomend::Engine& engine, const Scene& scene,
                                  const stereomend::SolverParams& params) {
    const size_t pixels = scene.u.size();
    std::vector<float> out(3 * pixels + 1);
    float* solved = out.data();
    float* filled = solved + pixels;
    std::copy(scene.u.begin(), scene.u.end(), filled);
    engine.fill({scene.size, filled, scene.flags()}, 20, 5);
    std::copy(filled, filled + pixels, solved);
    engine.solve(scene.level(), params, solved);
    std::vector<uint8_t> unobserved(pixels), hidden(pixels);
    engine.unobserved(scene.size, solved, reinterpret_cast<bool*>(unobserved.data()));
    engine.shown(scene.size, solved, scene.flags(), reinterpret_cast<bool*>(unobserved.data()),
                 reinterpret_cast<bool*>(hidden.data()));
    const auto found = engine.mismatch(scene.size, scene.left.data(), {{scene.right.data(), solved, scene.flags()},
                                                                       {scene.left.data(), filled, scene.flags()}});
    out.back() = static_cast<float>(found.front().sum + found.back().sum);
    engine.confidence({scene.size, scene.left.data(), scene.right.data(), solved, scene.flags(), scene.flags()},
                      {21, 20.0f, 2, 2.0f}, out.data() + 2 * pixels);
    for (const std::vector<float>& part :
         {run_guided(engine, scene, params, {solved, solved + pixels}), run_evidence(engine, scene),
           run_resize(engine, scene), run_fusion(engine, scene)})
        out.insert(out.end(), part.begin(), part.end());
    return out;
}
