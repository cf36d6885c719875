// A relaxation in shared memory, right once and wrong in many ways.
//
// A block has a tile of 8 x 8 pixels and a halo of two: one thread for each cell of both, and up to two steps.

enum Bug {
    kNone, kNoBarrierAfterLoad, kNoBarrierBetweenSteps, kGuardOffByOne, kHaloOneShort, kSharedOneShort,
    kEarlyReturn, kBarrierInBranch, kInPlaceShared
};

constexpr int kSide = 8;
constexpr int kHalo = 2;
constexpr int kTile = kSide + 2 * kHalo;
constexpr int kCells = kTile * kTile;

template <int kBug>
__device__ __forceinline__ void relax(const float* in, float* out, int width, int height, int steps) {
    __shared__ float cells[2 * kCells - (kBug == kSharedOneShort)];
    const int tx = threadIdx.x;
    const int ty = threadIdx.y;
    const int x = blockIdx.x * kSide + tx - kHalo;
    const int y = blockIdx.y * kSide + ty - kHalo;
    const int beyond = kBug == kGuardOffByOne;
    const bool inside = x >= 0 && x < width + beyond && y >= 0 && y < height + beyond;
    if (kBug == kEarlyReturn && !inside) return;
    const int here = ty * kTile + tx;
    const bool loads = inside && (kBug != kHaloOneShort || tx > 0);
    if (loads) cells[here] = in[y * width + x];
    if (kBug == kSharedOneShort) cells[kCells + here] = 0.0f;
    if (kBug == kBarrierInBranch) {
        if (inside) __syncthreads();
    } else if (kBug != kNoBarrierAfterLoad) {
        __syncthreads();
    }
    int now = 0;
    for (int step = 0; step < steps; ++step) {
        const int next = kBug == kInPlaceShared ? now : kCells - now;
        const int margin = step + 1;
        const bool works = inside && tx >= margin && tx < kTile - margin && ty >= margin && ty < kTile - margin;
        if (works) {
            const float* c = cells + now + here;
            const float left = x > 0 ? c[-1] : c[0];
            const float right = x < width - 1 ? c[1] : c[0];
            const float above = y > 0 ? c[-kTile] : c[0];
            const float below = y < height - 1 ? c[kTile] : c[0];
            cells[next + here] = 0.5f * c[0] + 0.125f * ((left + right) + (above + below));
        }
        if (kBug != kNoBarrierBetweenSteps) __syncthreads();
        now = next;
    }
    const bool mine = tx >= kHalo && tx < kTile - kHalo && ty >= kHalo && ty < kTile - kHalo;
    if (mine && inside) out[y * width + x] = cells[now + here];
}

#define RELAX(NAME, BUG)                                                                                     \
    extern "C" __global__ void NAME(const float* in, float* out, int width, int height, int steps) {         \
        relax<BUG>(in, out, width, height, steps);                                                           \
    }

RELAX(relax_right, kNone)
RELAX(relax_no_barrier_after_load, kNoBarrierAfterLoad)
RELAX(relax_no_barrier_between_steps, kNoBarrierBetweenSteps)
RELAX(relax_guard_off_by_one, kGuardOffByOne)
RELAX(relax_halo_one_short, kHaloOneShort)
RELAX(relax_shared_one_short, kSharedOneShort)
RELAX(relax_early_return, kEarlyReturn)
RELAX(relax_barrier_in_branch, kBarrierInBranch)
RELAX(relax_in_place_shared, kInPlaceShared)
