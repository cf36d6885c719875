"""What uses `emulated` needs nvcc and PyCUDA: skipped without them, failed without if REQUIRE_CUDA=1."""

import importlib.util
import os

import pytest
from fakecuda import driver_folder, missing_tools
from fakecuda.build import CACHE


@pytest.fixture(scope="session")
def emulated():
    reason = missing_tools()
    if importlib.util.find_spec("pycuda") is None:
        reason = "PyCUDA is not installed (tests/fake_cuda/install_pycuda)"
    if reason and os.environ.get("REQUIRE_CUDA") == "1":
        pytest.fail(reason)
    if reason:
        pytest.skip(reason)
    return driver_folder()


@pytest.fixture
def faulty_device(emulated, monkeypatch, tmp_path):
    """Processes started from here on have the emulated device, and look for the faults that `plant` plans."""
    monkeypatch.setenv("LD_LIBRARY_PATH", str(emulated))
    monkeypatch.setenv("XDG_CACHE_HOME", str(CACHE))
    monkeypatch.setenv("FAKE_CUDA_FAULT_FILE", str(tmp_path / "fault"))


@pytest.fixture
def plant(tmp_path):
    """Plan a fault of whichever process works next: `plant("launch 2:700")`."""

    def write(fault):
        (tmp_path / "fault.new").write_text(fault)
        (tmp_path / "fault.new").rename(tmp_path / "fault")

    return write
