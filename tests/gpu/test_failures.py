"""A GPU without memory, or whose kernels fail: the driver's own errors, each in a process of its own."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from stereomend.refinement.backends.cuda_compile import Sources

pytestmark = pytest.mark.usefixtures("gpu")

PREPARED = """
import numpy as np
from problems import NATIVE, problem_of
from stereomend.refinement.backends.cuda import CudaBackend
from stereomend.refinement.backends.cuda_compile import Sources
problem, params = problem_of("robust", 61, 47)
"""

SOLVED = PREPARED + "CudaBackend(1, 'test').globally(problem, params)"

FILLED = """
from pycuda import driver
backend = CudaBackend(1, "test")
first = backend.globally(problem, params).u
hoard, size = [], 1 << 34
with backend._gpu.current():
    backend._solver.give_back()
    while size >= 4:
        try:
            hoard.append(driver.mem_alloc(size))
        except driver.MemoryError:
            size //= 2
without = backend.globally(problem, params)
with backend._gpu.current():
    hoard.clear()
after = backend.globally(problem, params)
assert without.warnings == ("device-out-of-memory",), without.warnings
assert without.u.tobytes() == NATIVE.globally(problem, params).u.tobytes()
assert not after.warnings and after.device
assert after.u.tobytes() == first.tobytes()
"""

FAILING = """
texts = dict(Sources.installed().texts)
texts["gdr_pyramid.cuh"] = texts["gdr_pyramid.cuh"].replace(BEFORE, BEFORE + AFTER, 1)
backend = CudaBackend(1, "test", Sources(texts))
for _ in range(2):
    try:
        backend.globally(problem, params)
    except Exception as error:
        print(type(error).__name__, error)
"""

FIRST_LINE = "KERNEL halve(const float* planes, float* out, int width, int height, int map) {"
FAULTS = {
    "illegal address": "*(volatile float*)8 = 1.0f;",
    "misaligned address": "*(volatile float*)((char*)out + 1) = 1.0f;",
    "launch failed": 'asm volatile("trap;");',
}


def python(code, *prefix, folder):
    env_path = [str(Path(__file__).parents[1] / "cuda"), str(Path(__file__).parents[1] / "fake_cuda")]
    code = f"import sys; sys.path[:0] = {env_path!r}\n{code}"
    return subprocess.run(
        [*prefix, sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=folder
    )


def test_a_full_device_leaves_the_work_to_the_cpu_and_is_used_again_once_it_has_room(tmp_path):
    done = python(PREPARED + FILLED, folder=tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_line_that_the_next_test_edits_is_there():
    assert FIRST_LINE in Sources.installed().texts["gdr_pyramid.cuh"]


@pytest.mark.parametrize("name", FAULTS)
def test_a_kernel_that_fails_loses_the_device_and_the_error_names_it(tmp_path, monkeypatch, name):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    edit = f"BEFORE, AFTER = {FIRST_LINE!r}, {FAULTS[name]!r}"
    done = python("\n".join([PREPARED, edit, FAILING]), folder=tmp_path)
    said = done.stdout.splitlines()
    print(done.stdout, done.stderr)
    assert len(said) == 2
    assert all(line.startswith("DeviceFault the GPU failed with CUDA error ") for line in said)
    assert all(f"({name})" in line for line in said)


@pytest.mark.parametrize("tool", ["memcheck", "racecheck", "synccheck", "initcheck"])
def test_the_kernels_are_clean_under_nvidias_own_checks(tmp_path, tool):
    checker = shutil.which("compute-sanitizer") or shutil.which(
        "compute-sanitizer", path="/usr/local/cuda/bin"
    )
    if checker is None:
        pytest.skip("compute-sanitizer is not on this machine (part of the CUDA toolkit)")
    done = python(SOLVED, checker, "--tool", tool, "--error-exitcode", "9", folder=tmp_path)
    print(done.stdout[-3000:], done.stderr[-3000:])
    assert done.returncode == 0
    assert "ERROR SUMMARY: 0 errors" in done.stdout or "RACECHECK SUMMARY: 0 hazards" in done.stdout
