// In which order blocks, warps and lanes have their turn.
#pragma once

#include <cstdint>
#include <numeric>
#include <random>
#include <string>
#include <vector>

namespace fake {

struct Order {
    enum Form { forward, reverse, shuffled } form = forward;
    uint64_t seed = 0;

    static bool parse(const std::string& text, Order* order) {
        if (text == "forward") *order = {forward, 0};
        else if (text == "reverse") *order = {reverse, 0};
        else if (text == "shuffled") *order = {shuffled, 0};
        else if (text.rfind("shuffled:", 0) == 0) *order = {shuffled, std::stoull(text.substr(9))};
        else return false;
        return true;
    }

    // 0 to count - 1; `salt` makes shuffles differ from one another.
    template <class T>
    void arrange(T* places, uint64_t count, uint64_t salt) const {
        std::iota(places, places + count, T{0});
        if (form == reverse)
            for (uint64_t i = 0; i < count; ++i) places[i] = static_cast<T>(count - 1 - i);
        if (form != shuffled) return;
        std::minstd_rand random(static_cast<uint32_t>(seed * 2654435761u + salt * 40503u + 1));
        for (uint64_t i = count; i > 1; --i) std::swap(places[i - 1], places[random() % i]);
    }
};

}  // namespace fake
