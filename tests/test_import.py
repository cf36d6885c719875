import subprocess
import sys

import pytest


def modules_after(code):
    shown = subprocess.run(
        [sys.executable, "-c", f"{code}\nimport sys; print(*sys.modules)"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    return shown.split()


@pytest.mark.parametrize(
    "code",
    [
        "from stereomend import DisparityMap",
        "from stereomend import Client",
        "from stereomend import AsyncClient",
    ],
)
def test_the_sdk_pulls_in_neither_the_server_nor_opencv_nor_the_kernels(code):
    loaded = modules_after(code)
    assert "stereomend.disparity" in loaded
    assert not {
        "fastapi",
        "cv2",
        "pydantic",
        "sqlalchemy",
        "stereomend._native",
        "stereomend.refinement",
    } & set(loaded)


def test_the_supervisor_is_small():
    loaded = modules_after("import stereomend.api.server, stereomend.jobs.supervisor")
    assert not {"fastapi", "uvicorn", "numpy", "cv2", "sqlalchemy"} & set(loaded)


def test_in_process_refinement_pulls_in_no_http():
    loaded = modules_after("from stereomend import refine")
    assert "stereomend.refinement" in loaded
    assert not {"fastapi", "httpx", "uvicorn"} & set(loaded)
