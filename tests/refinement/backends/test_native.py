"""The C++ kernels against the float64 reference, from the same state, on awkward sizes."""

import shutil
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from stereomend import _native
from stereomend.refinement import parse_params, select_backend
from stereomend.refinement.backends.data import (
    Reading,
    Usable,
)
from stereomend.refinement.backends.reference import distance
from stereomend.refinement.stage_params import LdrParams

SIZES = [(1, 1), (1, 2), (2, 1), (3, 3), (1, 33), (33, 1), (3, 2000), (2000, 3), (47, 61), (479, 631)]
PRESETS = ["paper", "released"]


@pytest.fixture(scope="module")
def native():
    return select_backend("native", threads=2)


@pytest.fixture(scope="module")
def reference():
    return select_backend("reference")


def make_state(size, seed=3):
    """A textured pair with a smooth disparity between, and an estimate that is off by up to a pixel or so."""
    rng = np.random.default_rng(seed)
    height, width = size
    y, x = np.mgrid[:height, :width].astype(float)
    truth = 6 + 3 * np.sin(x / 40) * np.cos(y / 30)
    phases = rng.uniform(0, 6, 5)
    waves = list(zip((0.9, 0.5, 0.23, 0.11, 0.05), (0.3, 0.7, 0.2, 0.15, 0.04), phases, strict=True))

    def texture(column):
        return 120 + sum(20 * np.sin(fx * column + fy * y + phase) for fx, fy, phase in waves)

    noise = rng.normal(0, 2, (2, *size))
    pair = np.clip(np.stack([texture(x - truth), 1.1 * texture(x) - 5]) + noise, 0, 255)
    u = truth + rng.normal(0, 0.7, size)
    return [plane.astype(np.float32) for plane in (*pair, u)]


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size", SIZES)
def test_one_warp_with_its_iterations_matches_the_reference(size, preset, native, reference):
    params = parse_params({"preset": preset, "gdr": {"warps": 1}}).gdr
    state = make_state(size)
    error = np.abs(native.solve(*state, params) - reference.solve(*state, params))
    assert error.max() <= 2e-4
    assert np.mean(error <= 1e-4) >= 0.999


@pytest.mark.parametrize("size", [(47, 61), (3, 200)])
def test_absolute_descriptors_match_the_reference(size, native, reference):
    params = parse_params({"gdr": {"warps": 1, "descriptor": "absolute"}}).gdr
    state = make_state(size)
    assert np.abs(native.solve(*state, params) - reference.solve(*state, params)).max() <= 2e-4


def test_disparities_out_of_the_image_match_the_reference(native, reference):
    left, right, u = make_state((20, 30))
    u[::2] *= -9
    u[1::4] += 1e5
    params = parse_params({"preset": "paper", "gdr": {"warps": 1}}).gdr
    assert np.allclose(
        native.solve(left, right, u, params), reference.solve(left, right, u, params), rtol=1e-6
    )


@pytest.mark.parametrize("size", SIZES)
def test_the_mismatch_matches_the_reference(size, native, reference):
    (left, right, u), rng = make_state(size), np.random.default_rng(12)
    valid = [rng.random(size) < share for share in (1.0, 0.7, 0.02)]
    readings = [Reading(right, u, valid[0]), Reading(left, -u, valid[1]), Reading(right, u / 2, valid[2])]
    for reading, (mean, count) in zip(readings, native.mismatch(left, readings), strict=True):
        [(expected, seen)] = reference.mismatch(left, [reading])
        assert count == seen
        assert mean == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("size", SIZES)
def test_the_mismatch_of_one_pixel_is_the_distance_of_its_descriptors(size, native, reference):
    left, right, u = make_state(size)
    distances = distance(*(plane.astype(np.float64) for plane in (left, right, u)))
    seen = np.flatnonzero(~reference.unobserved(u))
    for at in np.random.default_rng(13).permutation(seen)[:200]:
        only = np.zeros(size, bool)
        only.flat[at] = True
        [(mean, count)] = native.mismatch(left, [Reading(right, u, only)])
        assert count == 1
        assert abs(mean - distances.flat[at]) < 2e-3


def test_the_mismatch_of_nothing_is_0(native, reference):
    left, right, u = make_state((5, 7))
    nothing = np.zeros((5, 7), bool)
    readings = [Reading(right, u, nothing), Reading(right, u + 100, ~nothing)]
    assert native.mismatch(left, readings) == reference.mismatch(left, readings) == [(0.0, 0), (0.0, 0)]
    assert native.mismatch(left, []) == reference.mismatch(left, []) == []


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("preset", PRESETS)
def test_confidence_matches_the_reference(size, preset, native, reference):
    rng = np.random.default_rng(5)
    usable = Usable(rng.random(size) < 0.8, rng.random(size) < 0.9)
    state, params = make_state(size), parse_params({"preset": preset}).ldr
    expected = reference.confidence(*state, usable, params)
    assert np.abs(native.confidence(*state, usable, params) - expected).max() < 1e-4


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize(("share", "steps", "passes"), [(0.3, 20, 5), (0.01, 4, 2), (0.002, 1, 1)])
def test_filling_matches_the_reference(size, share, steps, passes, native, reference):
    if size == (479, 631) and share < 0.1:
        pytest.skip("brute force over 300,000 holes takes minutes; the smaller sizes show the same")
    rng = np.random.default_rng(11)
    u, known = rng.uniform(1, 60, size).astype(np.float32), rng.random(size) < share
    known.flat[rng.integers(known.size)] = True
    assert np.allclose(
        native.fill(u, known, steps, passes), reference.fill(u, known, steps, passes), rtol=1e-6
    )


def test_of_equally_near_inliers_the_leftmost_then_the_upper_is_taken(native):
    u = np.arange(25, dtype=np.float32).reshape(5, 5)
    known = np.zeros((5, 5), bool)
    known[0, 2] = known[2, 0] = known[2, 4] = known[4, 2] = True
    assert native.fill(u, known, steps=1, passes=1)[2, 2] == u[2, 0]
    known[2, 0] = False
    assert native.fill(u, known, steps=1, passes=1)[2, 2] == u[0, 2]


@pytest.mark.parametrize("shape", [(48, 64), (61, 47), (9, 300), (3, 3)])
def test_resizing_matches_the_reference(shape, native, reference):
    image = np.random.default_rng(2).uniform(0, 255, shape).astype(np.float32)
    half = tuple((side + 1) // 2 for side in shape)
    assert np.abs(native.shrink(image, half) - reference.shrink(image, half)).max() < 1e-3
    assert np.abs(native.enlarge(image, shape) - reference.enlarge(image, shape)).max() < 1e-3
    twice = tuple(2 * side - 1 for side in shape)
    assert np.abs(native.enlarge(image, twice) - reference.enlarge(image, twice)).max() < 2e-2


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("size", [(1, 1), (3, 2000), (479, 631)])
def test_results_are_bitwise_equal_for_any_number_of_threads(size, preset):
    params = parse_params({"preset": preset})
    left, right, u = make_state(size)
    usable = Usable(u > 5, left > 60)
    results = []
    for threads in (1, 2, 5):
        backend = select_backend("native", threads)
        confidence = backend.confidence(left, right, u, usable, params.ldr)
        filled = backend.fill(u, confidence > 0.5, 20, 5)
        solved = backend.solve(left, right, filled, params.gdr)
        results.append(
            [plane.tobytes() for plane in (confidence, filled, solved)]
            + backend.mismatch(left, [Reading(right, u, usable.matte), Reading(left, solved, usable.valid)])
        )
    assert results[0] == results[1] == results[2]


def test_instruction_sets_differ_by_rounding_only():
    left, right, u = make_state((100, 150))
    constants = {"data_weight": 0.5, "huber_epsilon": 0.1, "tau": 0.25, "sigma": 0.5}
    params = _native.SolverParams(**constants, warps=1, iterations=5, absolute=False)
    window = _native.ConfidenceParams(
        window=21, smoothness_weight=20, smoothness_power=1, photometric_weight=2
    )
    engines = [_native.Engine(1, name) for name in _native.instruction_sets()]
    solved = [engine.solve(left, right, u, None, params) for engine in engines]
    trusted = [engine.confidence(left, right, u, u > 5, left > 60, window) for engine in engines]
    assert len(engines) >= 1
    for k in range(1, len(engines)):
        assert np.abs(solved[k] - solved[0]).max() < 1e-4
        assert np.abs(trusted[k] - trusted[0]).max() < 1e-4
    with pytest.raises(ValueError, match="'z80' is not available"):
        _native.Engine(1, "z80")


def test_the_kernels_refuse_what_does_not_fit():
    plane, narrow = np.zeros((4, 5), np.float32), np.zeros((4, 4), np.float32)
    engine = _native.Engine(1)
    with pytest.raises(ValueError, match="differ in shape"):
        engine.mismatch(plane, [(plane, plane, plane > 0), (narrow, plane, plane > 0)])
    with pytest.raises(ValueError, match="no pixel"):
        engine.mismatch(plane[:0], [(plane[:0], plane[:0], plane[:0] > 0)])
    with pytest.raises(TypeError):
        engine.mismatch(plane, [(plane, plane.astype(np.float64), plane > 0)])
    with pytest.raises(ValueError, match="threads"):
        _native.Engine(0)
    even = _native.ConfidenceParams(window=4, smoothness_weight=1, smoothness_power=1, photometric_weight=1)
    with pytest.raises(ValueError, match="odd"):
        engine.confidence(plane, plane, plane, plane > 0, plane > 0, even)


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (47, 61)])
def test_the_weight_of_the_data_term_matches_the_reference(size, native, reference):
    params = parse_params({"gdr": {"warps": 2}}).gdr
    state = make_state(size)
    weight = np.random.default_rng(6).random(size).astype(np.float32)
    error = native.solve(*state, params, weight=weight) - reference.solve(*state, params, weight=weight)
    assert np.abs(error).max() <= 2e-4
    assert (native.solve(*state, params, weight=np.ones_like(weight)) == native.solve(*state, params)).all()


def test_an_engine_serves_all_sizes_in_any_order():
    kept = select_backend("native", threads=3)
    for size in [(47, 61), (3, 2000), (1, 1), (200, 150), (47, 61)]:
        left, right, u = make_state(size)
        params = parse_params({"preset": "released"})
        fresh = select_backend("native", threads=1)
        known = u > 6
        known.flat[0] = True
        assert (kept.solve(left, right, u, params.gdr) == fresh.solve(left, right, u, params.gdr)).all()
        assert (kept.fill(u, known, 3, 2) == fresh.fill(u, known, 3, 2)).all()


def test_calls_from_several_threads_wait_for_each_other():
    backend, params = select_backend("native", threads=2), parse_params({"preset": "released"}).gdr
    states = [make_state((60, 80), seed) for seed in range(6)]
    expected = [backend.solve(*state, params) for state in states]
    with ThreadPoolExecutor(6) as pool:
        found = list(pool.map(lambda state: backend.solve(*state, params), states))
    assert all((a == b).all() for a, b in zip(expected, found, strict=True))


def test_the_caller_s_arrays_stay_as_they_are(native):
    left, right, u = make_state((20, 30))
    before = [plane.copy() for plane in (left, right, u)]
    native.solve(left, right, u, parse_params().gdr)
    native.fill(u, u > 6, 3, 1)
    native.confidence(left, right, u, Usable(u > 0, u > 0), LdrParams())
    assert all((a == b).all() for a, b in zip((left, right, u), before, strict=True))


@pytest.mark.skipif(shutil.which("g++") is None or shutil.which("nm") is None, reason="needs g++ and nm")
@pytest.mark.parametrize("name", ["gdr_cpu", "ldr_cpu", "ceiling_loops"])
def test_the_sweeps_share_no_function_by_name(name, tmp_path):
    """Of those the linker would keep one copy, perhaps the one that older machines cannot run."""
    source = Path(__file__).parents[3] / "kernels" / f"{name}.cpp"
    compiled = tmp_path / "sweeps.o"
    tables = [f"-D{table.upper()}={table}_generic" for table in ("sweeps", "ldr_sweeps", "ceilings")]
    flags = ["-std=c++17", "-O3", "-fno-math-errno", "-fno-trapping-math", *tables]
    subprocess.run(["g++", *flags, "-c", source, "-o", compiled], check=True)
    listing = subprocess.run(["nm", "-C", compiled], capture_output=True, text=True, check=True)
    symbols = listing.stdout.splitlines()
    shared = [line.split()[-1] for line in symbols if line.split()[-2] in "WVTuDBR"]
    assert len(shared) == 1
    assert shared[0].endswith("_generic")


def test_alone_is_the_same_on_one_thread(native):
    assert native.alone is native.alone
    assert (native.alone.name, native.alone.kernel) == (native.name, native.kernel)
    plane = native.plane(np.random.default_rng(3).uniform(0, 255, (70, 90)))
    assert (native.alone.shrink(plane, (35, 45)) == native.shrink(plane, (35, 45))).all()
