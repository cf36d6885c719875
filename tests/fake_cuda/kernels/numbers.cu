// Arithmetic that can be compared bit by bit, or with a float64 computation.
#include <math.h>

#define INDEX (blockIdx.x * blockDim.x + threadIdx.x)
#define OUT(K) out[(K) * n + i]

extern "C" __global__ void basic(const float* a, const float* b, const float* c, float* out, int n) {
    const int i = INDEX;
    if (i >= n) return;
    const float x = a[i], y = b[i];
    OUT(0) = __fadd_rn(x, y);
    OUT(1) = __fmul_rn(x, y);
    OUT(2) = x / y;
    OUT(3) = sqrtf(fabsf(x));
    OUT(4) = fmaf(x, y, c[i]);
    OUT(5) = fminf(x, y);
    OUT(6) = fmaxf(x, y);
    OUT(7) = floorf(x);
    OUT(8) = ceilf(x);
    OUT(9) = rintf(x);
    OUT(10) = truncf(x);
    OUT(11) = __saturatef(x);
    OUT(12) = copysignf(x, y);
    OUT(13) = -x;
}

extern "C" __global__ void directed(const float* a, const float* b, float* out, int n) {
    const int i = INDEX;
    if (i >= n) return;
    const float x = a[i], y = b[i];
    OUT(0) = __fadd_rd(x, y);
    OUT(1) = __fadd_ru(x, y);
    OUT(2) = __fmul_rd(x, y);
    OUT(3) = __fmul_ru(x, y);
    OUT(4) = __fadd_rz(x, y);
    OUT(5) = __fmul_rz(x, y);
}

extern "C" __global__ void special(const float* a, float* out, int n) {
    const int i = INDEX;
    if (i >= n) return;
    const float x = a[i];
    OUT(0) = sinf(x);
    OUT(1) = cosf(x);
    OUT(2) = expf(x);
    OUT(3) = logf(x);
    OUT(4) = rsqrtf(x);
    OUT(5) = powf(x, 1.7f);
    OUT(6) = tanhf(x);
    OUT(7) = atan2f(x, 2.0f);
    OUT(8) = exp2f(x);
    OUT(9) = erff(x);
    OUT(10) = __fdividef(1.0f, x);
    OUT(11) = __sinf(x);
}

extern "C" __global__ void to_integers(const float* a, int* out, int n) {
    const int i = INDEX;
    if (i >= n) return;
    const float x = a[i];
    OUT(0) = __float2int_rn(x);
    OUT(1) = __float2int_rz(x);
    OUT(2) = __float2int_rd(x);
    OUT(3) = __float2int_ru(x);
    OUT(4) = static_cast<int>(__float2uint_rz(x));
    OUT(5) = static_cast<int>(static_cast<long long>(x) >> 3);
    OUT(6) = static_cast<short>(__float2int_rz(x));
    OUT(7) = static_cast<unsigned char>(__float2int_rz(x));
    OUT(8) = static_cast<signed char>(__float2int_rz(x));
}

extern "C" __global__ void from_integers(const int* a, float* out, int n) {
    const int i = INDEX;
    if (i >= n) return;
    OUT(0) = static_cast<float>(a[i]);
    OUT(1) = static_cast<float>(static_cast<unsigned>(a[i]));
    OUT(2) = static_cast<float>(static_cast<long long>(a[i]) * 1000003);
    OUT(3) = static_cast<float>(static_cast<double>(a[i]) / 3.0);
    OUT(4) = __int2float_rd(a[i]);
    OUT(5) = static_cast<float>(static_cast<unsigned char>(a[i]));
    OUT(6) = static_cast<float>(static_cast<short>(a[i]));
}

extern "C" __global__ void integers(const int* a, const int* b, int* out, int n) {
    const int i = INDEX;
    if (i >= n) return;
    const int x = a[i], y = b[i];
    const unsigned u = x, v = y;
    OUT(0) = x / y;
    OUT(1) = x % y;
    OUT(2) = u / v;
    OUT(3) = u % v;
    OUT(4) = __mulhi(x, y);
    OUT(5) = __umulhi(u, v);
    OUT(6) = static_cast<int>((static_cast<long long>(x) * y) >> 7);
    OUT(7) = min(x, y) ^ max(x, y);
    OUT(8) = abs(x) + __popc(u) + 100 * __clz(x) + 10000 * __ffs(x);
    OUT(9) = __brev(u);
    OUT(10) = x << (y & 31);
    OUT(11) = x >> (y & 31);
    OUT(12) = u >> (y & 31);
    OUT(13) = __byte_perm(u, v, 0x5140);
    OUT(14) = __funnelshift_l(u, v, 11);
    OUT(15) = static_cast<int>((static_cast<long long>(x) << 20) / (y | 1));
    OUT(16) = (u >> 5) & 0x3ff;
    OUT(17) = (x & 0xff00ff) | (~y & 0x00ff00);
    OUT(18) = __sad(x >> 4, y >> 4, 7u);
}
