"""The benchmark as a person runs it, in its short form: that it works, never how fast."""

import json
import subprocess
import sys
from time import perf_counter

import numpy as np
import pytest

from stereomend import _native
from stereomend.bench.cases import Setup
from stereomend.bench.ceilings import Ceiling
from stereomend.bench.clock import Spread, Timed, interleaved
from stereomend.bench.sweeps import FEW, MANY, sweep_times

COLUMNS = 100


def bench(*arguments):
    command = [sys.executable, "-m", "stereomend", "bench", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    file = tmp_path_factory.mktemp("bench") / "bench.json"
    done = bench("--quick", "--threads", 1, 2, "--backend", "native", "reference", "--json", file)
    assert done.returncode == 0, done.stderr
    return done.stdout, json.loads(file.read_text())


def test_it_prints_every_table_within_100_columns(quick):
    text, _ = quick
    for title in ("What the machine can do", "LDR and GDR", "The finest level", "Over HTTP"):
        assert f"\n{title}" in text
    assert [line for line in text.splitlines() if len(line) > COLUMNS] == []


def test_the_file_says_what_was_measured_and_on_what(quick):
    _, report = quick
    assert report["machine"]["kernel"] == _native.KERNEL_HASH
    assert report["machine"]["cores"] >= 1
    assert {"cpu", "instruction_set", "python", "versions"} <= set(report["machine"])
    assert report["load_before"] >= 0
    assert report["load_after"] >= 0
    assert report["paper"] == {
        "worked": [360, 288],
        "ms": {"LDR on an Intel i9": 118.0, "GDR on an Nvidia Titan X": 375.0},
    }


def test_every_configuration_is_there_once(quick):
    _, report = quick
    stages = [(one["backend"], one["preset"], one["threads"]) for one in report["stages"]]
    presets = report["plan"]["presets"]
    backends = (("native", 1), ("native", 2), ("reference", 1))
    assert sorted(stages) == sorted((name, preset, count) for name, count in backends for preset in presets)
    assert [(one["backend"], one["threads"]) for one in report["sweeps"]] == list(backends)


def test_times_are_in_order_and_per_pixel_of_the_working_size(quick):
    _, report = quick
    for one in report["stages"]:
        scale = 0.75 if one["preset"] == "robust" else 0.5
        assert one["worked"] == [round(side * scale) for side in one["input"]]
        for stage in ("ldr", "gdr"):
            times = one[f"{stage}_ms"]
            assert 0 < times["min"] <= times["median"] <= times["max"]
            pixels = one["worked"][0] * one["worked"][1]
            assert one[f"{stage}_ns_per_pixel"] * pixels == pytest.approx(times["median"] * 1e6)


def test_what_a_client_waits_for_besides_the_stages_is_taken_apart(quick):
    _, report = quick
    assert [one["preset"] for one in report["http"]] == report["plan"]["presets"]
    for one in report["http"]:
        assert set(one["parts"]) == {
            "queue",
            "decode",
            "prepare",
            "initial",
            "finish",
            "encode",
            "inside",
            "outside",
        }
        assert 0 < one["besides"]["p50"] < one["client"]["p50"]


def test_multiply_adds_are_faster_than_numpy_multiplies():
    a, b = np.ones(4096, np.float32), np.full(4096, 0.5, np.float32)
    assert least_s(lambda: np.multiply(a, b, out=a), 100) > 0

    def faster():
        rate = a.size / least_s(lambda: np.multiply(a, b, out=a), 100) * 1e-9
        # A multiply-add counts twice and needs no memory; no processor does thousands per nanosecond.
        return rate < _native.multiply_add(1) < 4096

    assert ever(faster)


def test_the_triad_moves_at_least_as_much_as_numpy_does():
    a, b, c = (np.ones(1 << 24, np.float32) for _ in range(3))

    def as_much():
        rate = 12 * a.size / least_s(lambda: np.add(b, c, out=a), 5) * 1e-9
        return rate / 2 < _native.triad(1) < 4096

    assert ever(as_much)


def ever(holds):
    """Whether it holds in one of many rounds: in the others other programs may have had the processor."""
    return any(holds() for _ in range(30))


def least_s(call, repeats):
    def once():
        began = perf_counter()
        call()
        return perf_counter() - began

    return min(once() for _ in range(repeats))


@pytest.mark.parametrize("rate", [_native.triad, _native.multiply_add])
def test_a_ceiling_needs_a_sensible_number_of_threads(rate):
    for threads in (0, -1, 1025):
        with pytest.raises(ValueError, match="threads"):
            rate(threads)


def test_rounds_visit_every_job_in_turn():
    visits = []
    jobs = {name: Timed(lambda name=name: visits.append(name), 1) for name in "abc"}
    times = interleaved(jobs, repeats=3)
    assert visits == list("aabbcc") * 3  # short jobs run once unmeasured first
    assert set(times) == set("abc")


def test_the_slope_of_two_solves_separates_iterations_from_what_comes_before():
    linearise_ms, iteration_ms, pixels = 3.0, 0.5, 40 * 32
    setup = Setup("native", (80, 64), 1)
    times = {(setup, n): at(linearise_ms + n * iteration_ms) for n in (FEW, MANY)}
    (found,) = sweep_times(times, [Ceiling(1, triad_gb_s=10.0, multiply_add_gflop_s=100.0)])
    assert found.iteration_ms == pytest.approx(iteration_ms)
    assert found.before_ms == pytest.approx(linearise_ms)
    assert found.gflop_s == pytest.approx(25 * pixels / (iteration_ms * 1e-3) * 1e-9)
    assert found.of_multiply_add == pytest.approx(found.gflop_s / 100)
    assert found.gb_s == pytest.approx(48 * pixels / (iteration_ms * 1e-3) * 1e-9)
    assert found.speedup == pytest.approx(1)


def test_a_gpu_has_no_share_of_what_the_cpu_could_do():
    setup = Setup("cuda", (80, 64), 2)
    (found,) = sweep_times({(setup, FEW): at(1.0), (setup, MANY): at(2.0)}, [Ceiling(2, 10.0, 100.0)])
    assert found.gflop_s > 0
    assert found.of_multiply_add is found.of_triad is None


def test_where_noise_hides_the_slope_nothing_is_claimed():
    setup = Setup("native", (80, 64), 1)
    (found,) = sweep_times({(setup, FEW): at(5.0), (setup, MANY): at(4.0)}, [Ceiling(1, 10.0, 100.0)])
    assert found.iteration_ms is found.before_ms is found.gflop_s is found.of_triad is None


def at(ms):
    return Spread(ms, ms, ms)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--size", "8x8"), "stereomend: --size 8x8: expected sides of at least 32 px\n"),
        (("--threads", "0"), "stereomend: --threads 0: expected 1 to 1024\n"),
        (("--repeats", "0"), "stereomend: --repeats 0: expected at least 1\n"),
        (("--preset", "best"), "stereomend: preset: got 'best', expected one of "),
        (("--backend", "fpga"), "stereomend: backend: got 'fpga', expected one of "),
    ],
)
def test_bad_usage_is_one_line_and_code_2(arguments, message):
    done = bench("--quick", "--no-http", *arguments)
    assert done.returncode == 2
    assert done.stderr.startswith(message)
    assert done.stderr.count("\n") == 1
