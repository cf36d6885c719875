// Small kernels, each for something that real ones need.
#include <math.h>

struct Pair {
    float scale;
    int shift;
    double offset;
};

__constant__ float table[4] = {1.0f, 2.0f, 4.0f, 8.0f};
__device__ int total = 5;

__device__ __noinline__ Pair doubled(Pair pair, int times) {
    for (int k = 0; k < times; ++k) pair = {2.0f * pair.scale, pair.shift + 1, pair.offset * 2.0};
    return pair;
}

#define INDEX (blockIdx.x * blockDim.x + threadIdx.x)

extern "C" __global__ void saxpy(float a, const float* x, float* y, int n) {
    const int i = INDEX;
    if (i < n) y[i] = a * x[i] + y[i];
}

extern "C" __global__ void axpy64(double a, const double* x, double* y, int n) {
    const int i = INDEX;
    if (i < n) y[i] = a * x[i] + sqrt(fabs(y[i])) / 3.0;
}

extern "C" __global__ void scale_fours(const float4* x, float4* y, float a) {
    const float4 v = x[INDEX];
    y[INDEX] = make_float4(a * v.x, v.y - a, v.z / a, v.w + a);
}

extern "C" __global__ void struct_and_call(Pair pair, float* out) {
    const int i = INDEX;
    const Pair result = doubled(pair, i);
    out[i] = result.scale + result.shift + static_cast<float>(result.offset) + table[i & 3];
    if (i == 0) atomicAdd(&total, 2);
}

// Sums with shuffles, shared memory and one atomic per block; blocks of up to 256 threads, whole warps.
extern "C" __global__ void sum(const float* x, float* out, int n) {
    __shared__ float parts[8];
    float mine = INDEX < n ? x[INDEX] : 0.0f;
    for (int offset = 16; offset; offset /= 2) mine += __shfl_down_sync(0xffffffff, mine, offset);
    if (threadIdx.x % 32 == 0) parts[threadIdx.x / 32] = mine;
    __syncthreads();
    if (threadIdx.x != 0) return;
    for (int k = 1; k < blockDim.x / 32; ++k) mine += parts[k];
    atomicAdd(out, mine);
}

// The last block to finish adds up what the others left: ordered by a fence and an atomic.
extern "C" __global__ void sum_by_last_block(const float* x, float* parts, int* finished, float* out) {
    if (threadIdx.x == 0) {
        parts[blockIdx.x] = x[blockIdx.x];
        __threadfence();
        if (atomicAdd(finished, 1) == gridDim.x - 1) {
            float mine = 0.0f;
            for (int k = 0; k < gridDim.x; ++k) mine += parts[k];
            *out = mine;
        }
    }
}

extern "C" __global__ void histogram(const unsigned char* x, int* bins, int n) {
    __shared__ int mine[256];
    mine[threadIdx.x] = 0;
    __syncthreads();
    if (INDEX < n) atomicAdd(&mine[x[INDEX]], 1);
    __syncthreads();
    atomicAdd(&bins[threadIdx.x], mine[threadIdx.x]);
}

// out: max, min, or, xor, and, exchanged, swapped, wrapped
extern "C" __global__ void atomics(const int* x, int* out) {
    const int v = x[INDEX];
    atomicMax(out, v);
    atomicMin(out + 1, v);
    atomicOr(out + 2, v);
    atomicXor(out + 3, v);
    atomicAnd(out + 4, v);
    if (INDEX == 0) atomicExch(out + 5, 17);
    atomicCAS(out + 6, 3, 4);
    atomicInc(reinterpret_cast<unsigned*>(out) + 7, 9);
}

// Neighbours in a warp exchange through shared memory.
extern "C" __global__ void swap_in_warp(float* x) {
    __shared__ float mine[64];
    mine[threadIdx.x] = x[threadIdx.x];
    __syncwarp();
    x[threadIdx.x] = mine[threadIdx.x ^ 1];
}

extern "C" __global__ void votes(const int* x, unsigned* out) {
    const int i = threadIdx.x;
    out[i] = __ballot_sync(0xffffffff, x[i] > 3);
    out[32 + i] = __any_sync(0xffffffff, x[i] > 100) + 2 * __all_sync(0xffffffff, x[i] >= 0);
    out[64 + i] = __match_any_sync(0xffffffff, x[i]);
    out[96 + i] = __reduce_add_sync(0xffffffff, x[i]);
    unsigned active = 0;
    if (i & 1) active = __activemask();
    out[128 + i] = active;
    out[160 + i] = __shfl_up_sync(0xffffffff, x[i], 3) + 1000 * __shfl_xor_sync(0xffffffff, x[i], 5, 8);
    out[192 + i] = __shfl_sync(0xffffffff, x[i], i + 1, 16);
}

extern "C" __global__ void counted_barriers(const int* x, int* out) {
    const int i = threadIdx.x;
    const int count = __syncthreads_count(x[i] > 3);
    const int all = __syncthreads_and(x[i] >= 0);
    const int any = __syncthreads_or(x[i] > 100);
    out[i] = count + 1000 * all + 10000 * any;
}

// Steps of Collatz's sequence, and a jump table.
extern "C" __global__ void divergent(const int* x, int* steps, int* kinds) {
    const int i = INDEX;
    int v = x[i];
    int n = 0;
    while (v != 1) {
        v = v % 2 ? 3 * v + 1 : v / 2;
        ++n;
    }
    steps[i] = n;
    int kind = 0;
    switch (x[i] % 8) {
        case 0: kind = n * 3; break;
        case 1: kind = n - 7; break;
        case 2: kind = n ^ 21; break;
        case 3: kind = n << 2; break;
        case 4: kind = n / 3; break;
        case 5: kind = -n; break;
        case 6: kind = n & 5; break;
        default: kind = n % 5;
    }
    kinds[i] = kind;
}

// A local array indexed by a value.
extern "C" __global__ void local_array(const int* x, float* out) {
    float powers[8];
    for (int k = 0; k < 8; ++k) powers[k] = x[k] * 0.5f;
    out[INDEX] = powers[x[INDEX] & 7];
}

// Mirrors a block in dynamic shared memory.
extern "C" __global__ void mirror(float* x) {
    extern __shared__ float mine[];
    mine[threadIdx.x] = x[threadIdx.x];
    __syncthreads();
    x[threadIdx.x] = mine[blockDim.x - 1 - threadIdx.x];
}

// Bytes of one word by different threads, in place.
extern "C" __global__ void invert_bytes(unsigned char* x, int n) {
    if (INDEX < n) x[INDEX] = 255 - x[INDEX];
}
