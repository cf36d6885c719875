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

float ratio_of(int to, int from) { return static_cast<float>(static_cast<double>(to) / from); }

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

void shrink_sparse(const Sparse& from, Size to, float half, float* u, bool* valid, const ResizeCrew& crew) {
    const Cover columns = cover_of(from.size.width, to.width, crew.buffers.places[0], crew.buffers.weights[0]);
    const Cover rows = cover_of(from.size.height, to.height, crew.buffers.places[1], crew.buffers.weights[1]);
    const Samples flags{from.size, from.valid, 1, 1, false};
    const Samples values{from.size, from.u, 4, 1, false};
    const float ratio = ratio_of(to.width, from.size.width);
    std::vector<float>& shares = crew.buffers.shares;
    shares.resize(std::max(shares.size(), static_cast<size_t>(to.width) * to.height));
    in_pieces(to.height, shrink_floats(values, columns, rows), crew, [&](Rows band, float* scratch) {
        crew.sweeps.shrink(flags, columns, rows, band, scratch, {{shares.data()}});
        crew.sweeps.shrink(values, columns, rows, band, scratch, {{u}});
        const size_t o = static_cast<size_t>(band.begin) * to.width;
        crew.sweeps.divide_row(shares.data() + o, (band.end - band.begin) * to.width, ratio, half, u + o, valid + o);
    });
}

void sample_sparse(const Sparse& from, Size to, float* u, bool* valid, const ResizeCrew& crew) {
    const Places columns = places_of(from.size.width, to.width, crew.buffers.places[0], crew.buffers.weights[0]);
    const Places rows = places_of(from.size.height, to.height, crew.buffers.places[1], crew.buffers.weights[1]);
    const float ratio = ratio_of(to.width, from.size.width);
    in_pieces(to.height, 0, crew, [&](Rows band, float*) {
        for (int y = band.begin; y < band.end; ++y) {
            const size_t i = static_cast<size_t>(rows.nearest[y]) * from.size.width;
            const size_t o = static_cast<size_t>(y) * to.width;
            crew.sweeps.sample_row(from.u + i, from.valid + i, columns.nearest, to.width, ratio, u + o, valid + o);
        }
    });
}

void tell(const Origins& origins, const float* u, const LdrSweeps& ldr, Kinds& out, const ResizeCrew& crew) {
    const Size to = origins.to;
    const Places columns = places_of(origins.from.width, to.width, crew.buffers.places[0], crew.buffers.weights[0]);
    const Places rows = places_of(origins.from.height, to.height, crew.buffers.places[1], crew.buffers.weights[1]);
    std::vector<long>& counts = crew.buffers.counts;
    counts.assign(4 * static_cast<size_t>(to.height), 0);
    in_pieces(to.height, to.width, crew, [&](Rows band, float* scratch) {
        for (int y = band.begin; y < band.end; ++y) {
            const size_t o = static_cast<size_t>(y) * to.width;
            ldr.unobserved_row(u + o, to.width, reinterpret_cast<bool*>(out.kind + o));
            crew.sweeps.tell_row(origins, u + o, columns.nearest, rows.nearest[y], y, reinterpret_cast<uint8_t*>(scratch),
                                 out.kind + o, &counts[4 * y]);
        }
    });
    std::fill(out.counts, out.counts + 4, 0);
    for (size_t i = 0; i < counts.size(); ++i) out.counts[i % 4] += counts[i];
}

}  // namespace stereomend
