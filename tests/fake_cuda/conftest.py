"""Everything here needs nvcc and PyCUDA: skipped without them, failed without them where REQUIRE_CUDA=1."""

import importlib.util
import os

import pytest
from fakecuda import driver_folder, missing_tools


@pytest.fixture(autouse=True, scope="session")
def fake_driver():
    reason = missing_tools()
    if importlib.util.find_spec("pycuda") is None:
        reason = "PyCUDA is not installed (tests/fake_cuda/install_pycuda)"
    if reason and os.environ.get("REQUIRE_CUDA") == "1":
        pytest.fail(reason)
    if reason:
        pytest.skip(reason)
    return driver_folder()
