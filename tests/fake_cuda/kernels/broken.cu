// One fault each.

#define INDEX (blockIdx.x * blockDim.x + threadIdx.x)

extern "C" __global__ void beyond_the_end(float* x, int n) {
    if (INDEX <= n) x[INDEX] = 1.0f;
}

extern "C" __global__ void before_the_start(const float* x, float* y, int n) {
    if (INDEX < n) y[INDEX] = x[static_cast<int>(INDEX) - 1];
}

extern "C" __global__ void copy(const float* x, float* y, int n) {
    if (INDEX < n) y[INDEX] = x[INDEX];
}

extern "C" __global__ void reads_shared_too_early(float* y) {
    __shared__ float cells[64];
    if (threadIdx.x < 32) cells[threadIdx.x] = 1.0f;
    __syncthreads();
    y[threadIdx.x] = cells[threadIdx.x + 1];
}

// Right for one block; with two, each reads what the other writes.
extern "C" __global__ void smooth_in_place(float* x, int n) {
    const int i = INDEX;
    const float mean = i > 0 && i < n - 1 ? 0.5f * (x[i - 1] + x[i + 1]) : 0.0f;
    __syncthreads();
    if (i > 0 && i < n - 1) x[i] = mean;
}

extern "C" __global__ void counts_without_atomics(int* count) { *count = *count + 1; }

extern "C" __global__ void no_warp_barrier(float* x) {
    __shared__ float mine[32];
    mine[threadIdx.x] = x[threadIdx.x];
    x[threadIdx.x] = mine[threadIdx.x ^ 1];
}

extern "C" __global__ void misaligned(const float* x, float4* y) {
    y[threadIdx.x] = *reinterpret_cast<const float4*>(x + 4 * threadIdx.x + 1);
}

// Correct only in blocks of whole warps.
extern "C" __global__ void shuffles(float* x) { x[threadIdx.x] += __shfl_down_sync(0xffffffff, x[threadIdx.x], 16); }

extern "C" __global__ void different_barriers(float* x) {
    if (threadIdx.x < 32) {
        __syncthreads();
        x[threadIdx.x] = 1.0f;
    } else {
        __syncthreads();
        x[threadIdx.x] = 2.0f;
        __syncthreads();
    }
}

extern "C" __global__ void local_beyond_the_end(const int* index, float* y) {
    float cells[8];
    for (int k = 0; k < 8; ++k) cells[k] = y[k];
    y[threadIdx.x] = cells[index[threadIdx.x]];
}

extern "C" __global__ void never_ends(volatile int* flag) {
    while (*flag == 0) {
    }
}

extern "C" __global__ void traps(int n) {
    if (n > 3) __trap();
}

extern "C" __global__ void order_dependent(int* last) { atomicExch(last, static_cast<int>(INDEX)); }
