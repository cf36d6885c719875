// The choice between two maps (R8 to R10) as row loops that the compiler vectorises.
//
// Compiled once per instruction set, like gdr_cpu.cpp: everything but the table is local to the file.
#include <string.h>

#include "cell_loops.hpp"
#include "descriptors.hpp"
#include "exponential.cuh"
#include "flags.hpp"
#include "fusion_sweeps.hpp"
#include "windows.hpp"

namespace stereomend {
namespace {

constexpr int kSeen = 4;  // pixels that what is compared of one reaches to each side
constexpr int kWide = 7;  // pixels on each side of the window that roughness is looked for in
constexpr float kHardly = 1e-4f;  // of a pixel: rounding shall not decide whether a count is over a share

long offset_of(Size size, int y) { return static_cast<long>(y) * size.width; }

PIXEL_FN int flag(bool holds) { return holds ? 1 : 0; }

// Adds the polls of row y to those of the rows before.
void poll_row(const Rivals& in, const PollMarks& marks, const PollRule& rule, int y, float* const sums[kPolls]) {
    const int width = in.size.width;
    const long o = offset_of(in.size, y);
    const float *upload = in.upload + o, *u = in.u + o, *n = in.for_u + o, *other = in.for_upload + o;
    const uint8_t *claimed = bytes_of(in.upload_shown) + o, *shown = bytes_of(in.u_shown) + o;
    const uint8_t *matte = bytes_of(marks.matte) + o, *spoilt = bytes_of(marks.spoilt) + o;
    float *voted = sums[0], *agreed = sums[1], *fair = sums[2], *lead = sums[3], *level = sums[4];
    float *seen = sums[5], *of_u = sums[6], *of_square = sums[7];
    const float slope = slope_of(rule.least, rule.full);
    const float told_apart = slope_of(0.0f, rule.lack);
    const float scale = 1.0f / rule.tolerance;
    const PollRule limits = rule;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const float apart = upload[x] - u[x];
        const float share = apart * scale;
        const int inside = flag(static_cast<float>(x) - u[x] > limits.frame);
        const float vote = ramp(n[x], limits.least, slope) * static_cast<float>(inside & claimed[x] & shown[x] & matte[x]);
        const float counts = vote * static_cast<float>(flag(fabsf(apart) < limits.near) & (1 - spoilt[x]));
        const float here = static_cast<float>(shown[x]);
        const float agrees = vote * fast_exp2(-kLog2E * share * share);
        const float ahead = other[x] - n[x];
        voted[x] += agrees + (vote - agrees) * ramp(-ahead, 0.0f, told_apart);
        agreed[x] += agrees;
        fair[x] += counts;
        lead[x] += counts * smaller(larger(ahead, -limits.most), limits.most);
        level[x] += counts * n[x];
        seen[x] += here;
        of_u[x] += here * u[x];
        of_square[x] += here * u[x] * u[x];
    }
}

void poll(const Rivals& in, const PollMarks& marks, const PollRule& rule, int row, float* scratch, long plane,
          double* out) {
    const int width = in.size.width;
    const int first = kCell * row;
    const int last = first + kCell < in.size.height ? first + kCell : in.size.height;
    float* sums[kPolls];
    for (int k = 0; k < kPolls; ++k) sums[k] = scratch + static_cast<long>(k) * width;
    for (long i = 0; i < static_cast<long>(kPolls) * width; ++i) scratch[i] = 0.0f;
    for (int y = first; y < last; ++y) poll_row(in, marks, rule, y, sums);
    for (int k = 0; k < kPolls; ++k)
        for (int begin = 0; begin < width; begin += kCell) {
            const int end = begin + kCell < width ? begin + kCell : width;
            double sum = 0.0;
            for (int x = begin; x < end; ++x) sum += static_cast<double>(sums[k][x]);
            out[k * plane + begin / kCell] = sum / ((end - begin) * (last - first));
        }
}

constexpr float kAlike = 20.0f;  // of both sides of a spike: the larger rise is at most so many times the smaller

// Above or below both neighbours by more than `height`, and on both sides alike: the foot of a jump is no spike.
PIXEL_FN int stands_out(float value, float before, float after, float height) {
    const float up = value - before;
    const float down = value - after;
    const float least = smaller(fabsf(up), fabsf(down));
    const float most = larger(fabsf(up), fabsf(down));
    return flag(up * down > 0.0f) & flag(least > height) & flag(most <= kAlike * least);
}

PIXEL_FN int goes_on(float value, float before, float after, float step) {
    return flag(fabsf((after - value) - (value - before)) <= step);
}

// Spikes and straight slopes of row y along the row, and along the columns where there are rows on both sides.
void mark_row(const Rivals& in, const ChoiceRule& rule, int y, uint8_t* spikes, uint8_t* even) {
    const int width = in.size.width;
    const float* u = in.upload + offset_of(in.size, y);
    const bool between = y > 0 && y + 1 < in.size.height;
    const float* above = between ? u - width : u;
    const float* below = between ? u + width : u;
    const float spike = rule.spike;
    const float step = between ? rule.step : kNone;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        spikes[x] = static_cast<uint8_t>(stands_out(u[x], above[x], below[x], spike));
        even[x] = static_cast<uint8_t>(goes_on(u[x], above[x], below[x], step) & flag(static_cast<float>(x) >= u[x]));
    }
    const float slope = rule.step;
#pragma GCC ivdep
    for (int x = 1; x < width - 1; ++x) {
        spikes[x] |= static_cast<uint8_t>(stands_out(u[x], u[x - 1], u[x + 1], spike));
        even[x] &= static_cast<uint8_t>(goes_on(u[x], u[x - 1], u[x + 1], slope));
    }
}

// The least and the most of the upload in the rows around row y, infinite and minus it where it is unknown.
void span_columns(const Rivals& in, int y, float* low, float* high) {
    const int width = in.size.width;
    const int first = y > kSeen ? y - kSeen : 0;
    const int last = y + kSeen < in.size.height ? y + kSeen : in.size.height - 1;
    for (int x = -kSeen; x < width + kSeen; ++x) low[x] = kNone, high[x] = -kNone;
    for (int row = first; row <= last; ++row) {
        const float* u = in.upload + offset_of(in.size, row);
        const uint8_t* valid = bytes_of(in.valid) + offset_of(in.size, row);
#pragma GCC ivdep
        for (int x = 0; x < width; ++x) {
            low[x] = smaller(low[x], valid[x] ? u[x] : kNone);
            high[x] = larger(high[x], valid[x] ? u[x] : -kNone);
        }
    }
}

// Where u is over `least` px, and farther than the upload, from both ends of what the upload spans around.
void find_smeared(const Rivals& in, int y, float least, float* scratch, uint8_t* out) {
    const int width = in.size.width;
    const long o = offset_of(in.size, y);
    const float *upload = in.upload + o, *u = in.u + o;
    float *low = scratch + kSeen, *high = low + width + 2 * kSeen;
    span_columns(in, y, low, high);
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        float least_around = low[x - kSeen];
        float most_around = high[x - kSeen];
        for (int i = 1 - kSeen; i <= kSeen; ++i) {
            least_around = smaller(least_around, low[x + i]);
            most_around = larger(most_around, high[x + i]);
        }
        const float inward = smaller(u[x] - least_around, most_around - u[x]);
        const float own = smaller(upload[x] - least_around, most_around - upload[x]);
        out[x] = static_cast<uint8_t>(flag(inward > least) & flag(inward > own));
    }
}

void look(const Rivals& in, const ChoiceRule& rule, int y, float* scratch, const Choice& choice) {
    const int width = in.size.width;
    const long o = offset_of(in.size, y);
    const uint8_t* valid = bytes_of(in.valid) + o;
    find_smeared(in, y, rule.near, scratch, bytes_of(choice.smeared) + o);
    uint8_t* rough = reinterpret_cast<uint8_t*>(scratch) + kWide;
    mark_row(in, rule, y, rough, bytes_of(choice.even) + o);
    for (int i = 1; i <= kWide; ++i) rough[-i] = rough[width - 1 + i] = 0;
    for (int x = 0; x < width; ++x) rough[x] |= static_cast<uint8_t>(1 - valid[x]);
    uint8_t* sums = choice.uneven + o;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        uint8_t sum = 0;
        for (int i = -kWide; i <= kWide; ++i) sum = static_cast<uint8_t>(sum + rough[x + i]);
        sums[x] = sum;
    }
}

// The sums over columns of the windows around row y: of the lead of the upload's evidence, and of that for u.
void sum_columns(const Rivals& in, int y, float* leads, float* levels) {
    const int width = in.size.width;
    const float* n[kSide];
    const float* other[kSide];
    for (int i = 0; i < kSide; ++i) {
        const long o = offset_of(in.size, mirrored(y + i - kAround, in.size.height));
        n[i] = in.for_u + o;
        other[i] = in.for_upload + o;
    }
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        levels[x] = n[0][x] + n[1][x] + n[2][x] + n[3][x] + n[4][x];
        leads[x] = (other[0][x] - n[0][x]) + (other[1][x] - n[1][x]) + (other[2][x] - n[2][x]) +
                   (other[3][x] - n[3][x]) + (other[4][x] - n[4][x]);
    }
    extend(leads, width, true);
    extend(levels, width, true);
}

PIXEL_FN float five(const float* v) { return 0.04f * (v[-2] + v[-1] + v[0] + v[1] + v[2]); }

// Whether few enough of the pixels around row y are uneven. In bytes, for 15 x 15 pixels are no more than they hold.
void find_smooth(Size size, int y, float share, const uint8_t* uneven, uint8_t* out) {
    const int width = size.width;
    const int first = y > kWide ? y - kWide : 0;
    const int last = y + kWide < size.height ? y + kWide : size.height - 1;
    memset(out, 0, width);
    for (int row = first; row <= last; ++row) {
        const uint8_t* sums = uneven + offset_of(size, row);
#pragma GCC ivdep
        for (int x = 0; x < width; ++x) out[x] = static_cast<uint8_t>(out[x] + sums[x]);
    }
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const int begin = x > kWide ? x - kWide : 0;
        const int end = x + kWide < width ? x + kWide + 1 : width;
        const float area = static_cast<float>((end - begin) * (last + 1 - first));
        out[x] = static_cast<uint8_t>(flag(static_cast<float>(out[x]) <= share * area + kHardly));
    }
}

void settle(const Rivals& in, const Grounds& grounds, const ChoiceRule& rule, int y, float* scratch,
            const Choice& choice) {
    const int width = in.size.width;
    const long o = offset_of(in.size, y);
    const long stride = width + 2 * kAround;
    float *leads = scratch + kAround, *levels = leads + stride;
    uint8_t* smooth = reinterpret_cast<uint8_t*>(levels + stride);
    sum_columns(in, y, leads, levels);
    find_smooth(in.size, y, rule.rough_share, choice.uneven, smooth);
    const float *upload = in.upload + o, *u = in.u + o;
    const float *level = grounds.level + o, *equal = grounds.equal + o, *usual = grounds.usual + o;
    const float* edge = grounds.edge + o;
    const uint8_t *valid = bytes_of(in.valid) + o, *shown = bytes_of(in.upload_shown) + o;
    const uint8_t *u_shown = bytes_of(in.u_shown) + o, *glints = bytes_of(grounds.glints) + o;
    const uint8_t *beside = bytes_of(grounds.beside) + o, *even = bytes_of(choice.even) + o;
    const uint8_t* smeared = bytes_of(choice.smeared) + o;
    uint8_t *soft = bytes_of(choice.soft) + o, *passing = bytes_of(choice.passing) + o;
    uint8_t *seeds = bytes_of(choice.reached) + o, *kept = bytes_of(choice.kept) + o;
    float* share = choice.share + o;
    const ChoiceRule limits = rule;
    const float slope = slope_of(rule.full_trust, rule.high_trust);
    const float fall = rule.win_margin + rule.trusted_margin;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const int close = flag(fabsf(upload[x] - u[x]) < limits.near) & valid[x];
        const int high = flag(level[x] >= limits.high_trust);
        const int enough = flag(level[x] > limits.enough);
        const float margin = limits.win_margin - fall * ramp(level[x], limits.full_trust, slope);
        const int better = flag(five(leads + x) > margin);
        const int wins = better & shown[x];
        const int strong = flag(five(levels + x) >= limits.weak_share * usual[x]) & u_shown[x] & (1 - glints[x]);
        const int asked = 1 - ((beside[x] | smeared[x]) & high);
        const int comparable = shown[x] & asked;
        const int contradicted = strong & (1 - close) & (1 - (better & (shown[x] | high))) & asked;
        const int decided = close ? u_shown[x] : strong & comparable;
        const float found = close ? equal[x] : static_cast<float>(enough & wins);
        share[x] = decided ? found : -1.0f;
        seeds[x] = static_cast<uint8_t>(enough & close & u_shown[x] & shown[x]);
        kept[x] = static_cast<uint8_t>(valid[x] & (1 - contradicted));
        passing[x] = static_cast<uint8_t>(kept[x] & enough & smooth[x]);
        soft[x] = static_cast<uint8_t>(even[x] | flag(edge[x] < limits.soft_edge));
    }
}

void narrow(const Rivals& in, int y, const Choice& choice) {
    const long o = offset_of(in.size, y);
    const uint8_t *shown = bytes_of(in.upload_shown) + o, *u_shown = bytes_of(in.u_shown) + o;
    uint8_t* passing = bytes_of(choice.passing) + o;
    const int width = in.size.width;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) passing[x] &= static_cast<uint8_t>(1 - (shown[x] | u_shown[x]));
}

void sift(const Rivals& in, int y, const bool* small, const Choice& choice) {
    const long o = offset_of(in.size, y);
    const uint8_t* gone = bytes_of(small);
    uint8_t *kept = bytes_of(choice.kept) + o, *reached = bytes_of(choice.reached) + o;
    const int width = in.size.width;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        kept[x] &= static_cast<uint8_t>(1 - gone[x]);
        reached[x] &= kept[x];
    }
}

// How many pixels, of at most so many from i on, lead to a reached one only up or only down from the one before i.
int bridge_from(const Terrain& land, long i, int step, int most, const bool* reached) {
    bool rises = false;
    bool falls = false;
    for (int n = 0; n < most; ++n, i += step) {
        rises |= land.u[i] > land.u[i - step];
        falls |= land.u[i] < land.u[i - step];
        if (rises & falls) return 0;
        if (reached[i]) return n;
        if (!land.passing[i]) return 0;
    }
    return 0;
}

void bridge(const Terrain& land, const Stretch& stretch, int step, const bool* reached, uint8_t* scratch, bool* out) {
    const int count = stretch.columns.end - stretch.columns.begin;
    const long o = offset_of(land.size, stretch.y) + stretch.columns.begin;
    const uint8_t *here = bytes_of(reached) + o, *before = here - step, *passing = bytes_of(land.passing) + o;
#pragma GCC ivdep
    for (int x = 0; x < count; ++x) scratch[x] = static_cast<uint8_t>(before[x] & passing[x] & (1 - here[x]));
    const uint8_t* at = scratch;
    while ((at = static_cast<const uint8_t*>(memchr(at, 1, scratch + count - at)))) {
        const int x = static_cast<int>(at++ - scratch);
        const int most = step == 1 ? count - x : land.size.height - stretch.y;
        const int length = bridge_from(land, o + x, step, most, reached);
        for (int n = 0; n < length; ++n) out[o + x + static_cast<long>(n) * step] = true;
    }
}

void conclude(const Rivals& in, int y, const Choice& choice) {
    const long o = offset_of(in.size, y);
    const uint8_t *kept = bytes_of(choice.kept) + o, *reached = bytes_of(choice.reached) + o;
    const uint8_t *along = bytes_of(choice.along) + o, *across = bytes_of(choice.across) + o;
    float* share = choice.share + o;
    const int width = in.size.width;
#pragma GCC ivdep
    for (int x = 0; x < width; ++x) {
        const int bridged = along[x] | across[x];
        const float walked = static_cast<float>(reached[x] | bridged);
        const float found = share[x] < 0.0f ? walked : share[x];
        share[x] = found * static_cast<float>(kept[x] | bridged);
    }
}

}  // namespace

extern const FusionSweeps FUSION_SWEEPS = {poll, look,  settle, narrow, sift,
                                           bridge, conclude, blur, widen, bend};

}  // namespace stereomend
