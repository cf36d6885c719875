"""The command as a person runs it: real processes, real files."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plyfile import PlyData

from stereomend import Client, refine
from stereomend.opencv import cv2

ROOT = Path(__file__).parents[1]


def stereomend(*arguments, **options):
    command = [sys.executable, "-m", "stereomend", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, **options)


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A phantom as `stereomend phantom` writes it."""
    out = tmp_path_factory.mktemp("phantoms")
    done = stereomend("phantom", "-o", out, "--seed", 4, "--size", "96x64", "--instrument")
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"{out}/phantom_0004\n"
    return out / "phantom_0004"


@pytest.fixture(scope="session")
def native_server(tmp_path_factory):
    from stereomend.api.server import server_process
    from stereomend.settings import load_settings

    with (
        (tmp_path_factory.mktemp("log") / "log").open("w") as log,
        server_process(load_settings(port=0, data_dir=tmp_path_factory.mktemp("data")), log) as server,
    ):
        yield server.url


def inputs(folder):
    return [folder / name for name in ("left.png", "right.png", "network.png")]


def arrays(folder):
    left, right = (np.ascontiguousarray(cv2.imread(str(path))[..., ::-1]) for path in inputs(folder)[:2])
    return left, right, cv2.imread(str(folder / "network.png"), cv2.IMREAD_UNCHANGED) / np.float32(256)


def expected(folder, **params):
    return refine(*arrays(folder), **params)


def read(path):
    if path.suffix == ".npy":
        return np.load(path)
    if path.suffix == ".npz":
        return np.load(path)["disparity"]
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize("ending", ["npy", "npz", "pfm", "tiff"])
def test_refine_writes_what_the_library_computes(folder, tmp_path, ending):
    out = tmp_path / f"refined.{ending}"
    done = stereomend("refine", *inputs(folder), "-o", out, "--preset", "released", "--set", "gdr.warps=3")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(f"{out}: 96 x 64 px, released on native: kept ")
    assert (read(out) == expected(folder, preset="released", gdr={"warps": 3}).disparity).all()


def test_a_png_holds_256ths_and_a_preview_comes_along(folder, tmp_path, stages):
    out, preview = tmp_path / "refined.png", tmp_path / "preview.png"
    done = stereomend(
        "refine", *inputs(folder), "-o", out, "--stages", "ldr", "--preview", preview, "--timings"
    )
    assert done.returncode == 0, done.stderr
    disparity = expected(folder, stages=["ldr"]).disparity
    assert np.abs(read(out) / 256 - disparity).max() <= 0.5 / 256 + 1e-6
    assert cv2.imread(str(preview)).shape[2] == 3
    assert [line.split()[0] for line in done.stdout.splitlines()[1:]] == stages


def test_a_server_gives_the_same_bytes(folder, tmp_path, native_server):
    outs = [tmp_path / "here.png", tmp_path / "there.png"]
    for out, where in zip(outs, ([], ["--url", native_server]), strict=True):
        done = stereomend("refine", *inputs(folder), "-o", out, *where)
        assert done.returncode == 0, done.stderr
    assert outs[0].read_bytes() == outs[1].read_bytes()


def test_a_mask_and_a_calibration_give_a_point_cloud_here_and_there(folder, tmp_path, native_server):
    outs = [tmp_path / "here.ply", tmp_path / "there.ply"]
    known = json.loads((folder / "calibration.json").read_text())
    calibration = ["--focal-px", known["focal_px"], "--baseline-mm", known["baseline_mm"], "--cx", 40]
    for out, where in zip(outs, ([], ["--url", native_server]), strict=True):
        mask = ["--mask", folder / "instrument.png"]
        done = stereomend("refine", *inputs(folder), "-o", out, *mask, *calibration, *where)
        assert done.returncode == 0, done.stderr
    assert outs[0].read_bytes() == outs[1].read_bytes()
    shown = read(folder / "instrument.png") > 0
    expected = refine(*arrays(folder), mask=shown, **known, cx=40)
    vertex = PlyData.read(str(outs[0]))["vertex"]
    assert (vertex["z"] == expected.depth_mm[shown]).all()
    columns = np.nonzero(shown)[1]
    np.testing.assert_allclose(vertex["x"], (columns - 40) * vertex["z"] / known["focal_px"], rtol=1e-5)


def readme_block(start):
    """The lines of the README's code block that starts with `start`."""
    blocks = (ROOT / "README.md").read_text().split("```")[1::2]
    return next(block for block in blocks if block.strip().startswith(start)).strip().splitlines()


def test_curl_as_the_readme_says_and_the_sdk_give_the_same_bytes(tmp_path, native_server):
    lines = readme_block(".venv/bin/stereomend phantom")
    phantom = lines[0].removeprefix(".venv/bin/stereomend ").split()
    assert stereomend(*phantom, cwd=tmp_path).returncode == 0
    curl = "\n".join(lines[1:]).replace("http://127.0.0.1:8000", native_server)
    done = subprocess.run(curl, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "server-timing: queue;dur=" in done.stdout.lower()
    scene = [
        tmp_path / "phantoms" / "phantom_0000" / name for name in ("left.png", "right.png", "network.png")
    ]
    with Client(native_server) as client:
        body, _ = client.refine_bytes(*scene, {"preset": "robust"}, accept="image/png")
        result = client.refine(*scene, preset="robust")
    assert (tmp_path / "refined.png").read_bytes() == body
    assert np.abs(read(tmp_path / "refined.png") / 256 - result.disparity).max() <= 0.5 / 256 + 1e-6


def test_a_job_as_the_readme_says_gives_the_map_of_the_library(tmp_path, native_server):
    phantom = readme_block(".venv/bin/stereomend phantom")[0].removeprefix(".venv/bin/stereomend ").split()
    assert stereomend(*phantom, cwd=tmp_path).returncode == 0
    curl = "\n".join(readme_block("JOB=$(curl")).replace("http://127.0.0.1:8000", native_server)
    done = subprocess.run(curl, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert '"state":"succeeded"' in (tmp_path / "events.txt").read_text()
    disparity = expected(tmp_path / "phantoms" / "phantom_0000").disparity
    assert (np.load(tmp_path / "later.npy") == disparity).all()


def test_the_readme_names_the_commands_that_work():
    readme = (ROOT / "README.md").read_text()
    for commands in (
        "install . && .venv/bin/stereomend demo",
        "install -e '.[test]' && .venv/bin/pytest -n 4",
    ):
        assert f"python3 -m venv .venv && .venv/bin/pip {commands}" in readme


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({0: "nowhere.png"}, "nowhere.png: No such file"),
        ({2: "README"}, "disparity: "),
        ({"--preset": "best"}, "preset: got 'best'"),
        ({"--set": "gdr.colour=3"}, "gdr.colour: unknown"),
        ({"--set": "warps=3"}, "--set warps=3: expected"),
        ({"--stages": "sgm"}, "stages"),
        ({"--backend": "gpu"}, "backend: got 'gpu'"),
        ({"-o": "refined.jpg"}, "refined.jpg: ends in '.jpg'"),
        ({"-o": "nowhere/refined.png"}, "nowhere/refined.png: No such file"),
        ({"--disparity-scale": "-1"}, "disparity_scale"),
        ({"--focal-px": "100"}, "baseline_mm is missing"),
        ({"--mask": "nowhere.png"}, "nowhere.png: No such file"),
        ({"-o": "refined.ply"}, "focal_px and baseline_mm"),
    ],
)
def test_bad_usage_is_one_line_and_exit_code_2(folder, tmp_path, change, named):
    (tmp_path / "README").write_text("not a map")
    files = [change.get(i, path) for i, path in enumerate(inputs(folder))]
    options = {"-o": "refined.png"} | {name: value for name, value in change.items() if isinstance(name, str)}
    done = stereomend(
        "refine", *files, *(word for option in options.items() for word in option), cwd=tmp_path
    )
    assert done.returncode == 2
    assert done.stderr.startswith("stereomend: ")
    assert named in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "refined.png").exists()


def test_a_server_that_is_not_there_is_exit_code_1(folder, tmp_path):
    done = stereomend("refine", *inputs(folder), "-o", tmp_path / "out.png", "--url", "http://127.0.0.1:9")
    assert done.returncode == 1
    assert done.stderr.startswith("stereomend: http://127.0.0.1:9 cannot be reached")


def test_serve_refuses_to_be_open_to_all_without_a_key(tmp_path):
    done = stereomend("serve", "--host", "0.0.0.0", "--port", 0, "--data-dir", tmp_path / "data")
    assert done.returncode == 2
    assert "STEREOMEND_API_KEYS" in done.stderr
    assert done.stderr.count("\n") == 1


def test_doctor_names_what_is_there():
    done = stereomend("doctor")
    assert done.returncode == 0, done.stdout
    assert "ok  backend native" in done.stdout
    assert "ok  memory" in done.stdout


def test_the_phantom_is_written_with_its_calibration(folder):
    calibration = json.loads((folder / "calibration.json").read_text())
    assert calibration.keys() == {"focal_px", "baseline_mm"}
    truth = read(folder / "truth.png") / 256
    assert truth.shape == (64, 96)
    assert truth.min() > 0
    assert (read(folder / "instrument.png") == 255).any()


def test_the_demo_refines_over_http_and_draws(tmp_path):
    done = stereomend("demo", "-o", tmp_path / "demo")
    assert done.returncode == 0, done.stderr
    rmse = [float(line.split("RMSE")[1].split()[0]) for line in done.stdout.splitlines() if "RMSE" in line]
    assert len(rmse) == 5
    assert rmse[4] < min(rmse[2:4]) <= max(rmse[2:4]) < rmse[1] < rmse[0]
    pictures = {path.name for path in (tmp_path / "demo").iterdir()}
    assert {"overview.png", "refined_colour.png", "error_after_colour.png", "refined.png"} <= pictures
    assert cv2.imread(str(tmp_path / "demo" / "overview.png")).shape[1] > 2000
