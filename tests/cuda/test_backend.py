"""Which backend is taken, and what a machine without CUDA says."""

import os
import subprocess
import sys
from types import ModuleType

import device_work
import numpy as np
import pytest
from fakecuda import Failed, run
from problems import REFERENCE, case_of, solved

from stereomend.errors import BackendUnavailable
from stereomend.refinement import select_backend
from stereomend.refinement.backends.cuda_compile import Nvrtc, compilers


@pytest.fixture
def without_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "pycuda", None)


def test_without_the_package_it_is_named_in_one_line(without_package):
    with pytest.raises(
        BackendUnavailable, match=r"^cuda: the package pycuda is not installed .*\[gpu\]"
    ) as e:
        select_backend("cuda")
    assert "\n" not in str(e.value)


def test_auto_then_takes_native_and_says_why(without_package):
    backend = select_backend("auto", 1)
    assert backend.name == "native"
    assert "pycuda is not installed" in backend.reason


def test_without_a_driver_it_is_named(monkeypatch):
    package = ModuleType("pycuda")
    monkeypatch.setitem(sys.modules, "pycuda", package)
    monkeypatch.setattr(
        package,
        "__getattr__",
        lambda name: (_ for _ in ()).throw(ImportError("libcuda.so.1: cannot open shared object file")),
        raising=False,
    )
    with pytest.raises(BackendUnavailable, match=r"^cuda: no NVIDIA driver: libcuda\.so\.1"):
        select_backend("cuda")


def test_without_a_device_it_is_named(emulated):
    with pytest.raises(Failed, match=r"BackendUnavailable: cuda: no device: .*no CUDA-capable device"):
        run(device_work.chosen, name="cuda", env={"FAKE_CUDA_DEVICES": "0"})


def test_auto_takes_a_device_that_works_and_says_which(emulated):
    name, reason, kernel = run(device_work.chosen, name="auto")
    assert name == "cuda"
    assert "auto" in reason
    assert "Fake CUDA device, compute 8.6, nvcc" in reason
    assert select_backend("native", 1).kernel in kernel


def test_kernels_made_by_nvrtc_give_the_map_that_those_of_nvcc_give(emulated):
    if not any(isinstance(compiler, Nvrtc) for compiler in compilers()):
        pytest.skip("NVRTC is not on this machine (package nvidia-cuda-nvrtc)")
    nowhere = {"PATH": "", "CUDA_HOME": "/nonexistent", "CUDA_ROOT": "/nonexistent"}
    case = case_of("all", (61, 70), warps=2)
    assert "NVRTC" in run(device_work.chosen, name="cuda", env=nowhere)[1]
    found = run(device_work.solve, cases=[case], env=nowhere)[0]
    assert np.abs(found - solved(REFERENCE, case)).max() <= 4e-4


def test_a_process_that_used_the_device_ends_without_a_word(emulated):
    code = (
        "from stereomend.refinement import select_backend; import numpy as np;"
        "from stereomend.refinement.stage_params import GdrParams;"
        "backend = select_backend('cuda', 1);"
        "backend.solve(*np.ones((3, 9, 12), np.float32), GdrParams())"
    )
    env = os.environ | {"LD_LIBRARY_PATH": str(emulated)}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_server_that_is_told_to_use_cuda_ends_with_one_line_without_it(tmp_path):
    nowhere = {"CUDA_VISIBLE_DEVICES": "", "LD_LIBRARY_PATH": ""}
    env = os.environ | nowhere | {"STEREOMEND_DATA_DIR": str(tmp_path)}
    command = [sys.executable, "-m", "stereomend", "serve", "--backend", "cuda", "--port", "0"]
    done = subprocess.run(command, env=env, capture_output=True, text=True, timeout=60, check=False)
    lines = [line for line in done.stderr.splitlines() if " INFO " not in line]
    assert done.returncode == 2
    assert len(lines) == 1
    assert lines[0].startswith("stereomend: cuda: ")
