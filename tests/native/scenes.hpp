// Inputs of the kernels for programs that check them without Python.
#pragma once

#include <cstdint>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "../../kernels/engine.hpp"

struct Scene {
    stereomend::Size size;
    std::vector<float> left, right, u;
    std::vector<uint8_t> known;

    stereomend::Level level() const { return {size.width, size.height, left.data(), right.data(), nullptr}; }
    const bool* flags() const { return reinterpret_cast<const bool*>(known.data()); }
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
    Scene scene{{width, height}, std::vector<float>(pixels), std::vector<float>(pixels), std::vector<float>(pixels),
                std::vector<uint8_t>(pixels)};
    Noise noise{seed};
    for (size_t i = 0; i < pixels; ++i) {
        scene.left[i] = 255.0f * noise();
        scene.right[i] = 255.0f * noise();
        scene.u[i] = 40.0f * noise() - 2.0f;
        scene.known[i] = noise() < 0.3f;
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
    std::vector<uint8_t> unobserved(pixels);
    engine.unobserved(scene.size, solved, reinterpret_cast<bool*>(unobserved.data()));
    const auto found = engine.mismatch(scene.size, scene.left.data(), {{scene.right.data(), solved, scene.flags()},
                                                                       {scene.left.data(), filled, scene.flags()}});
    out.back() = static_cast<float>(found.front().sum + found.back().sum);
    engine.confidence({scene.size, scene.left.data(), scene.right.data(), solved, scene.flags(), scene.flags()},
                      {21, 20.0f, 2, 2.0f}, out.data() + 2 * pixels);
    return out;
}
