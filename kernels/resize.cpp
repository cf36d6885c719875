#include "resize.hpp"

#include <algorithm>
#include <cmath>

namespace stereomend {
namespace {

// Rows that a member takes at a time: few enough to share out well, enough to make little twice.
constexpr int kPiece = 16;

// A smaller share of a pixel is none: it comes of rounding.
constexpr double kNone = 1e-3;

struct Covered {
    int first;
    std::vector<float> weights;
};

// What pixel i of `count` covers of `side`.
Covered covered(int i, int side, int count) {
    const double scale = static_cast<double>(side) / count;
    const double begin = i * scale;
    const double end = begin + scale;
    const double whole = std::min(scale, side - begin);
    const int last = std::min(static_cast<int>(std::floor(end)), side - 1);
    const int next = std::min(static_cast<int>(std::ceil(begin)), last);
    Covered found{next, {}};
    if (next - begin > kNone) {
        --found.first;
        found.weights.push_back(static_cast<float>((next - begin) / whole));
    }
    found.weights.resize(found.weights.size() + (last - next), static_cast<float>(1.0 / whole));
    if (end - last > kNone)
        found.weights.push_back(static_cast<float>(std::min({end - last, 1.0, whole}) / whole));
    return found;
}

// The same number of pixels for each: those that take fewer take others with weight 0.
Cover cover_of(int side, int count, std::vector<int>& first, std::vector<float>& weight) {
    std::vector<Covered> all;
    size_t taps = 1;
    for (int i = 0; i < count; ++i) {
        all.push_back(covered(i, side, count));
        taps = std::max(taps, all.back().weights.size());
    }
    first.assign(count, 0);
    weight.assign(count * taps, 0.0f);
    for (int i = 0; i < count; ++i) {
        first[i] = std::min(all[i].first, side - static_cast<int>(taps));
        std::copy(all[i].weights.begin(), all[i].weights.end(), weight.begin() + i * taps + (all[i].first - first[i]));
    }
    return {static_cast<int>(taps), count, first.data(), weight.data()};
}

// Where `side` pixels are among `from`, which are no more.
Places places_of(int from, int side, std::vector<int>& places, std::vector<float>& fractions) {
    places.resize(3L * side);
    fractions.resize(side);
    int* before = places.data();
    int* after = before + side;
    int* nearest = after + side;
    const double scale = static_cast<double>(from) / side;
    for (int i = 0; i < side; ++i) {
        const double place = std::clamp((i + 0.5) * scale - 0.5, 0.0, from - 1.0);
        before[i] = static_cast<int>(place);
        after[i] = std::min(before[i] + 1, from - 1);
        fractions[i] = static_cast<float>(place - before[i]);
        nearest[i] = static_cast<int>((i + 0.5) * from / side);
    }
    return {before, after, fractions.data(), nearest};
}

// Runs body(rows, scratch) for all rows, with `floats` of scratch.
template <class Body>
void in_pieces(int height, size_t floats, const ResizeCrew& crew, const Body& body) {
    std::vector<float>& scratch = crew.buffers.scratch;
    scratch.resize(std::max(scratch.size(), floats * crew.team.size()));
    crew.team.share((height + kPiece - 1) / kPiece, [&](int member, int piece) {
        body(Rows{piece * kPiece, std::min((piece + 1) * kPiece, height)}, scratch.data() + floats * member);
    });
}

}  // namespace

void shrink(const Samples& from, Size to, const Shrunk& out, const ResizeCrew& crew) {
    const Cover columns = cover_of(from.size.width, to.width, crew.buffers.places[0], crew.buffers.weights[0]);
    const Cover rows = cover_of(from.size.height, to.height, crew.buffers.places[1], crew.buffers.weights[1]);
    in_pieces(to.height, shrink_floats(from, columns, rows), crew, [&](Rows band, float* scratch) {
        crew.sweeps.shrink(from, columns, rows, band, scratch, out);
    });
}

void merge(const Offer& offer, float* out, const ResizeCrew& crew) {
    const Places columns =
        places_of(offer.from.width, offer.to.width, crew.buffers.places[0], crew.buffers.weights[0]);
    const Places rows =
        places_of(offer.from.height, offer.to.height, crew.buffers.places[1], crew.buffers.weights[1]);
    in_pieces(offer.to.height, merge_floats(offer), crew, [&](Rows band, float* scratch) {
        crew.sweeps.merge(offer, columns, rows, band, scratch, out);
    });
}

}  // namespace stereomend
