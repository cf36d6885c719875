#include "cells.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

namespace stereomend {
namespace {

constexpr double kLeastWeight = 1e-6;  // below, there is nothing to average
constexpr double kRidge = 0.02;        // of the squared window: along a line, the slope across it stays near 0
constexpr int kPieceRows = 16;

template <class T>
void reserve(std::vector<T>& buffer, size_t count) {
    buffer.resize(std::max(buffer.size(), count));
}

// In the order of `kPolls`.
enum Poll { kVoted, kAgreed, kFair, kLead, kLevel, kShown, kOfU, kOfSquare };

struct Bell {
    std::vector<double> weights;
    Taps taps() const { return {static_cast<int>(weights.size()) - 1, weights.data()}; }
};

// A Gaussian of so many px, cut off at four deviations.
Bell bell_of(double width_px) {
    const double sigma = std::max(width_px / kCell, 0.3);
    const int radius = (static_cast<int>(std::nearbyint(8.0 * sigma + 1.0)) | 1) / 2;
    Bell window{std::vector<double>(radius + 1)};
    double sum = 0.0;
    for (int k = 0; k <= radius; ++k) {
        window.weights[k] = std::exp(-0.5 * k * k / (sigma * sigma));
        sum += (k == 0 ? 1.0 : 2.0) * window.weights[k];
    }
    for (double& weight : window.weights) weight /= sum;
    return window;
}

double ratio(double part, double whole) { return whole > kLeastWeight ? part / whole : 0.0; }

double ramp(double value, double low, double high) {
    return std::clamp((value - low) / std::max(high - low, 1e-9), 0.0, 1.0);
}

// Planes of cells, and who works on them.
class Grid {
public:
    Grid(Size size, int planes, const FusionCrew& crew)
        : size_(size), cells_{cells_of(size.width), cells_of(size.height)},
          count_(static_cast<long>(cells_.width) * cells_.height), crew_(crew) {
        reserve(crew.buffers.cells, planes * count_);
    }

    long count() const { return count_; }
    Size cells() const { return cells_; }
    double* plane(int k) const { return crew_.buffers.cells.data() + k * count_; }

    // Runs body(k, scratch) for `planes` of them.
    template <class Body>
    void each(int planes, const Taps& widest, const Body& body) const {
        const size_t doubles = blur_doubles(cells_, widest);
        reserve(crew_.buffers.scratch, doubles * team().size());
        team().share(planes, [&](int member, int k) { body(k, crew_.buffers.scratch.data() + doubles * member); });
    }

    // Runs body(y, scratch) for all rows of pixels.
    template <class Body>
    void rows(const Body& body) const {
        const size_t floats = widened_floats(size_.width, 3);
        std::vector<float>& scratch = crew_.evidence.buffers.scratch;
        reserve(scratch, floats * team().size());
        team().share((size_.height + kPieceRows - 1) / kPieceRows, [&](int member, int piece) {
            const int end = std::min((piece + 1) * kPieceRows, size_.height);
            for (int y = piece * kPieceRows; y < end; ++y) body(y, scratch.data() + floats * member);
        });
    }

private:
    Team& team() const { return crew_.evidence.team; }

    Size size_;
    Size cells_;
    long count_;
    const FusionCrew& crew_;
};

double mean_of(const double* plane, long count) {
    double sum = 0.0;
    for (long i = 0; i < count; ++i) sum += plane[i];
    return sum / static_cast<double>(count);
}

// What a plane is fitted to, moment by moment: cell i of plane k.
double moment(const double* polls, const Grid& grid, int k, long i, double window) {
    const long count = grid.count();
    const double shown = polls[kShown * count + i];
    const double of_u = polls[kOfU * count + i];
    const int width = grid.cells().width;
    const double y = ((static_cast<double>(i / width) + 0.5) * kCell - 0.5) / window;
    const double x = ((static_cast<double>(i % width) + 0.5) * kCell - 0.5) / window;
    const double moments[] = {shown,         shown * x,     shown * y, of_u,     shown * x * x,
                              shown * y * y, shown * x * y, of_u * x,  of_u * y, polls[kOfSquare * count + i]};
    return moments[k];
}

constexpr int kMoments = 10;

// How many columns may have their match left of the right image: those that u reaches over.
int columns_beyond(Size size, const float* u) {
    // As integers, whose order is that of the floats from 0 on, and whose largest is vectorised.
    const long pixels = static_cast<long>(size.width) * size.height;
    int32_t most = 0;
    for (long i = 0; i < pixels; ++i) {
        int32_t bits;
        std::memcpy(&bits, u + i, sizeof(bits));
        most = std::max(most, bits);
    }
    float reach;
    std::memcpy(&reach, &most, sizeof(reach));
    return static_cast<int>(std::min(std::ceil(reach), static_cast<float>(size.width)));
}

// Turns the averaged moments of the first columns of cells into value, residual and support of the plane, in the first
// three of them.
void fit(const Grid& grid, int columns, double window) {
    double* m[kMoments];
    for (int k = 0; k < kMoments; ++k) m[k] = grid.plane(k);
    const int width = grid.cells().width;
    for (long i = 0; i < grid.count(); ++i) {
        if (i % width >= columns) continue;
        const double total = m[0][i];
        double mean[kMoments];
        for (int k = 1; k < kMoments; ++k) mean[k] = ratio(m[k][i], total);
        const double at_x = mean[1], at_y = mean[2], at_u = mean[3];
        const double xx = mean[4] - at_x * at_x + kRidge, yy = mean[5] - at_y * at_y + kRidge;
        const double xy = mean[6] - at_x * at_y, xu = mean[7] - at_x * at_u, yu = mean[8] - at_y * at_u;
        const double determinant = std::max(xx * yy - xy * xy, kRidge * kRidge);
        const double along_x = (xu * yy - yu * xy) / determinant, along_y = (yu * xx - xu * xy) / determinant;
        const double y = ((static_cast<double>(i / width) + 0.5) * kCell - 0.5) / window;
        const double x = ((static_cast<double>(i % width) + 0.5) * kCell - 0.5) / window;
        m[0][i] = at_u + along_x * (x - at_x) + along_y * (y - at_y);
        m[1][i] = std::max(mean[9] - at_u * at_u - along_x * xu - along_y * yu, 0.0);
        m[2][i] = total;
    }
}

}  // namespace

void ground(Size size, const double* polls, const GroundRule& rule, float* const out[3], const FusionCrew& crew) {
    // Both votes near and far, then what is compared.
    constexpr int kOf[] = {kVoted, kAgreed, kVoted, kAgreed, kFair, kLead, kLevel};
    const Bell near = bell_of(rule.trust), far = bell_of(rule.far * rule.trust), fair = bell_of(rule.evidence);
    const Bell* windows[] = {&near, &near, &far, &far, &fair, &fair, &fair};
    const Grid grid(size, 7, crew);
    const Taps widest = far.weights.size() > fair.weights.size() ? far.taps() : fair.taps();
    grid.each(7, widest, [&](int k, double* scratch) {
        crew.sweeps.blur(polls + kOf[k] * grid.count(), grid.cells(), grid.cells().width, windows[k]->taps(), scratch, grid.plane(k));
    });
    double faint[3];
    for (int k = 0; k < 3; ++k) faint[k] = rule.far_share * mean_of(polls + kOf[4 + k] * grid.count(), grid.count());
    double *trust = grid.plane(0), *equal = grid.plane(1), *usual = grid.plane(2);
    for (long i = 0; i < grid.count(); ++i) {
        const double voted = trust[i] + rule.far_share * usual[i];
        const double agreed = equal[i] + rule.far_share * grid.plane(3)[i];
        const double number = grid.plane(4)[i] + faint[0], lead = grid.plane(5)[i] + faint[1];
        const double level = grid.plane(6)[i] + faint[2];
        trust[i] = ratio(agreed, voted);
        equal[i] = ramp(ratio(lead, level), -rule.worse_by, -rule.equal_within) *
                   ramp(trust[i], rule.min_trust, rule.full_trust);
        usual[i] = ratio(level, number);
    }
    grid.rows([&](int y, float* scratch) {
        for (int k = 0; k < 3; ++k)
            crew.sweeps.widen(grid.plane(k), grid.cells(), y, size.width, scratch, out[k] + static_cast<long>(y) * size.width);
    });
}

void bend(Size size, const float* u, const double* polls, const BendRule& rule, float* out, const FusionCrew& crew) {
    const Bell window = bell_of(rule.window);
    const Grid grid(size, 2 * kMoments, crew);
    const int columns = columns_beyond(size, u);
    const int of_cells = std::min(cells_of(columns) + 1, grid.cells().width);
    grid.each(kMoments, window.taps(), [&](int k, double* scratch) {
        double* moments = grid.plane(kMoments + k);
        for (long i = 0; i < grid.count(); ++i) moments[i] = moment(polls, grid, k, i, rule.window);
        crew.sweeps.blur(moments, grid.cells(), of_cells, window.taps(), scratch, grid.plane(k));
    });
    fit(grid, of_cells, rule.window);
    const PlaneFit planes{grid.plane(0), grid.plane(1), grid.plane(2)};
    grid.rows([&](int y, float* scratch) { crew.sweeps.bend(u, size, columns, planes, rule, y, scratch, out); });
}

}  // namespace stereomend
