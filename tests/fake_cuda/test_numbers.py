"""Arithmetic is rounded as on the hardware; special functions agree with float64."""

import ctypes
from math import erf

import numpy as np
import pytest
from fakecuda import run
from programs import launch, snippet

rng = np.random.default_rng(5)
N = 640
libm = ctypes.CDLL("libm.so.6")
libm.fmaf.argtypes = [ctypes.c_float] * 3
libm.fmaf.restype = ctypes.c_float


def wide_floats():
    """Of all magnitudes, with zeros and infinities."""
    x = rng.normal(size=N) * 10.0 ** rng.integers(-20, 20, N)
    x[:6] = [0.0, -0.0, np.inf, -np.inf, 1e-42, np.nan]
    return x.astype(np.float32)


def computed(kernel, *inputs, count, dtype=np.float32):
    args = [*inputs, np.zeros((count, N), dtype), np.int32(N)]
    return run(launch, file="numbers", kernel=kernel, args=args, grid=(5,), block=(128,)).arrays[-1]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_basic_operations_are_rounded_correctly():
    a, b, c = wide_floats(), np.roll(wide_floats(), 7), wide_floats()
    got = computed("basic", a, b, c, count=14)
    fused = [libm.fmaf(*map(float, abc)) for abc in zip(a, b, c, strict=True)]
    expected = [
        a + b,
        a * b,
        a / b,
        np.sqrt(np.abs(a)),
        fused,
        np.fmin(a, b),
        np.fmax(a, b),
        np.floor(a),
        np.ceil(a),
    ]
    expected += [np.rint(a), np.trunc(a), np.where(a > 0, np.minimum(a, 1), 0), np.copysign(a, b), -a]
    for k, row in enumerate(expected):
        np.testing.assert_array_equal(got[k], np.asarray(row, np.float32), err_msg=f"operation {k}")


def test_directed_roundings():
    a, b = (rng.uniform(0.5, 8, N).astype(np.float32) for _ in range(2))
    b[::2] *= -1
    got = computed("directed", a, b, count=6)
    total = a.astype(np.float64) + b  # exact: the exponents are close
    product = a.astype(np.float64) * b
    for exact, low, high, toward in ((total, got[0], got[1], got[4]), (product, got[2], got[3], got[5])):
        np.testing.assert_array_equal(low, below(exact))
        np.testing.assert_array_equal(high, -below(-exact))
        np.testing.assert_array_equal(toward, np.where(exact > 0, below(exact), -below(-exact)))


def below(exact):
    """The largest float32 that is not larger."""
    nearest = exact.astype(np.float32)
    return np.where(nearest > exact, np.nextafter(nearest, np.float32(-np.inf)), nearest)


def test_special_functions():
    a = rng.uniform(0.01, 20, N).astype(np.float32)
    x = a.astype(np.float64)
    got = computed("special", a, count=12)
    expected = [
        np.sin(x),
        np.cos(x),
        np.exp(x),
        np.log(x),
        1 / np.sqrt(x),
        x**1.7,
        np.tanh(x),
        np.arctan2(x, 2),
    ]
    expected += [2**x, [erf(v) for v in x], 1 / x, np.sin(x)]
    for k, row in enumerate(expected):
        np.testing.assert_allclose(got[k], row, rtol=3e-6, atol=2e-7, err_msg=f"function {k}")


def test_floats_become_integers():
    a = np.concatenate(
        [rng.uniform(-300, 300, N - 8), [0.5, 1.5, -0.5, -2.5, 3e9, -3e9, np.inf, np.nan]]
    ).astype(np.float32)
    got = computed("to_integers", a, count=9, dtype=np.int32)
    rounded = [np.rint(a), np.trunc(a), np.floor(a), np.ceil(a)]
    for k, row in enumerate(rounded):
        clamped = np.clip(np.nan_to_num(row.astype(np.float64), nan=0), -(2.0**31), 2.0**31 - 1)
        np.testing.assert_array_equal(got[k], clamped.astype(np.int32), err_msg=f"rounding {k}")
    unsigned = np.clip(np.nan_to_num(np.trunc(a.astype(np.float64)), nan=0), 0, 2.0**32 - 1)
    np.testing.assert_array_equal(got[4].view(np.uint32), unsigned.astype(np.uint32))
    small = a[: N - 4].astype(np.int64)
    np.testing.assert_array_equal(got[5, : N - 4], small >> 3)
    for k, dtype in ((6, np.int16), (7, np.uint8), (8, np.int8)):
        np.testing.assert_array_equal(got[k, : N - 4], small.astype(dtype))


def test_integers_become_floats():
    a = rng.integers(-(2**31), 2**31, N).astype(np.int32)
    got = computed("from_integers", a, count=7)
    wide = a.astype(np.int64)
    down = below(a.astype(np.float64))
    expected = [a, a.view(np.uint32), wide * 1000003, a / 3.0, down, a.astype(np.uint8), a.astype(np.int16)]
    for k, row in enumerate(expected):
        np.testing.assert_array_equal(got[k], row.astype(np.float32), err_msg=f"conversion {k}")


def test_integer_arithmetic():
    a, b = (rng.integers(-(2**31) + 1, 2**31, N).astype(np.int32) for _ in range(2))
    b[::3] = rng.integers(1, 50, len(b[::3]))
    got = computed("integers", a, b, count=19, dtype=np.int32)
    for k, expected in enumerate(zip(*map(integer_results, a, b), strict=True)):
        np.testing.assert_array_equal(
            got[k], np.array(expected).astype(np.int64).astype(np.int32), err_msg=f"operation {k}"
        )


def integer_results(a, b):
    """The kernel's results in Python's unbounded integers."""
    x, y = int(a), int(b)
    u, v = x % 2**32, y % 2**32
    quotient = abs(x) // abs(y) * (1 if (x < 0) == (y < 0) else -1)
    wide = (x << 20) % 2**64
    wide = wide - 2**64 if wide >= 2**63 else wide
    odd = y | 1
    wide_quotient = abs(wide) // abs(odd) * (1 if (wide < 0) == (odd < 0) else -1)
    counts = abs(x) + u.bit_count() + 100 * (32 - u.bit_length()) + 10000 * ((u & -u).bit_length())
    octets = list(u.to_bytes(4, "little") + v.to_bytes(4, "little"))
    permuted = int.from_bytes([octets[k] for k in (0, 4, 1, 5)], "little")
    n = y & 31
    return [
        quotient, x - quotient * y, u // v, u % v, (x * y) >> 32, (u * v) >> 32, ((x * y) >> 7) % 2**32,
        min(x, y) ^ max(x, y), counts, int(f"{u:032b}"[::-1], 2), (u << n) % 2**32, x >> n, u >> n, permuted,
        ((v << 32 | u) << 11 >> 32) % 2**32, wide_quotient % 2**32, (u >> 5) & 0x3FF,
        (x & 0xFF00FF) | (~y & 0x00FF00), abs((x >> 4) - (y >> 4)) + 7,
    ]  # fmt: skip


def signed(value, bits=32):
    value %= 2**bits
    return value - 2**bits if value >> (bits - 1) else value


def bit_field(x, first, count):
    return (x >> first) & ((1 << count) - 1)


# Lines of PTX, and what they compute of a, b, c, d (32 bits each) in Python.
SNIPPETS = {
    "bfe.u32 %r5, %r1, 5, 9;": lambda a, b, c, d: bit_field(a, 5, 9),
    "bfe.s32 %r5, %r1, 28, 9;": lambda a, b, c, d: signed(a) >> 28,
    "bfe.u64 %d3, %d1, 20, 30;": lambda a, b, c, d: bit_field(b << 32 | a, 20, 30),
    "bfi.b32 %r5, %r1, %r2, 8, 12;": lambda a, b, c, d: (b & ~(0xFFF << 8)) | bit_field(a, 0, 12) << 8,
    "bfind.u32 %r5, %r1;": lambda a, b, c, d: a.bit_length() - 1,
    "bfind.shiftamt.u32 %r5, %r1;": lambda a, b, c, d: 32 - a.bit_length(),
    "popc.b64 %r5, %d1;": lambda a, b, c, d: (b << 32 | a).bit_count(),
    "clz.b64 %r5, %d1;": lambda a, b, c, d: 64 - (b << 32 | a).bit_length(),
    "lop3.b32 %r5, %r1, %r2, %r3, 0xE8;": lambda a, b, c, d: (a & b) | (a & c) | (b & c),
    "shf.r.clamp.b32 %r5, %r1, %r2, 40;": lambda a, b, c, d: b,
    "shf.l.wrap.b32 %r5, %r1, %r2, 40;": lambda a, b, c, d: (b << 32 | a) << 8 >> 32,
    "shl.b32 %r5, %r1, 32;": lambda a, b, c, d: 0,
    "shr.s32 %r5, %r1, 77;": lambda a, b, c, d: signed(a) >> 31,
    "slct.b32.s32 %r5, %r1, %r2, %r3;": lambda a, b, c, d: a if signed(c) >= 0 else b,
    "mad.hi.u32 %r5, %r1, %r2, %r3;": lambda a, b, c, d: (a * b >> 32) + c,
    "mad.wide.s32 %d3, %r1, %r2, %d2;": lambda a, b, c, d: signed(a) * signed(b) + (d << 32 | c),
    "mul.hi.u64 %d3, %d1, %d2;": lambda a, b, c, d: (b << 32 | a) * (d << 32 | c) >> 64,
    "div.u64 %d3, %d1, %d2;": lambda a, b, c, d: (b << 32 | a) // (d << 32 | c),
    "cnot.b32 %r5, %r1;": lambda a, b, c, d: 0,
    "prmt.b32 %r5, %r1, %r2, 0x9999;": lambda a, b, c, d: 0xFFFFFFFF if a & 0x8000 else 0,
    "setp.lt.s32 %p3, %r3, 0; setp.lo.or.u32 %p1, %r1, %r2, !%p3; selp.b32 %r5, 5, 6, %p1;": (
        lambda a, b, c, d: 5 if a < b or signed(c) >= 0 else 6
    ),
    "setp.lt.s32 %p3, %r3, 0; setp.lt.xor.u32 %p1|%p2, %r1, %r2, %p3; selp.b32 %r5, 5, 6, %p2;": (
        lambda a, b, c, d: 5 if (a >= b) != (signed(c) < 0) else 6
    ),
    "cvt.sat.s8.s32 %r5, %r1;": lambda a, b, c, d: max(-128, min(127, signed(a))),
    "cvt.s32.s8 %r5, %r1;": lambda a, b, c, d: signed(a, 8),
    "cvt.s64.s32 %d3, %r1;": lambda a, b, c, d: signed(a),
    "cvt.u16.u32 %h1, %r1; mul.wide.u16 %r5, %h1, %h1;": lambda a, b, c, d: (a & 0xFFFF) ** 2,
}


@pytest.mark.parametrize("body", SNIPPETS)
def test_an_instruction_against_unbounded_integers(body):
    inputs = rng.integers(1, 2**32, (32, 4)).astype(np.uint32)
    got = run(snippet, body=body, inputs=inputs)
    wide = "%d3" in body
    value = got[:, 1].astype(np.uint64) | got[:, 2].astype(np.uint64) << np.uint64(32) if wide else got[:, 0]
    expected = [SNIPPETS[body](*map(int, row)) % 2 ** (64 if wide else 32) for row in inputs]
    assert value.tolist() == expected
