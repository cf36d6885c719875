"""A real GPU: skipped without one, failed without one if REQUIRE_GPU=1."""

import os

import pytest

from stereomend.errors import BackendUnavailable
from stereomend.refinement import select_backend


@pytest.fixture(scope="session")
def gpu():
    """The backend, on the first device."""
    try:
        return select_backend("cuda", 2)
    except BackendUnavailable as error:
        if os.environ.get("REQUIRE_GPU") == "1":
            raise
        pytest.skip(str(error))
