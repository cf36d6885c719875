"""`stereomend evaluate` as a person runs it."""

import csv
import json
import subprocess
import sys

import numpy as np
import pytest

from stereomend import refine
from stereomend.opencv import cv2


def evaluate(*arguments, before=""):
    code = f"import sys; {before}from stereomend.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "evaluate", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def read(path):
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


@pytest.fixture(scope="module")
def reported(phantoms, tmp_path_factory):
    out = tmp_path_factory.mktemp("out")
    done = evaluate(
        *("phantom", phantoms / "data", "--predictions", phantoms / "maps", "--presets", "released"),
        *("--stages", "ldr", "ldr,gdr", "-o", out / "report"),
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(out / f"report.{ending}") for ending in ("md", "csv", "html")]
    assert done.stderr == ""
    return out


def expected(folder, prediction, stages):
    """RMSE in px, share over 2 px in percent, RMSE of depth in mm; all and visible pixels."""
    truth = read(folder / "truth.png") / 256
    left, right = (
        np.ascontiguousarray(read(folder / f"{side}.png")[..., ::-1]) for side in ("left", "right")
    )
    disparity = prediction
    if stages:
        disparity = refine(left, right, prediction, preset="released", stages=stages).disparity
    known = json.loads((folder / "calibration.json").read_text())
    constant = known["focal_px"] * known["baseline_mm"]
    given = np.where(np.isfinite(disparity) & (disparity > 0), disparity, 0).astype(np.float64)
    depth = np.where(given > 0, constant / np.where(given > 0, given, 1), 0)
    for where in (np.ones(truth.shape, bool), read(folder / "occluded.png") == 0):
        error, millimetres = (given - truth)[where], (depth - constant / truth)[where]
        yield np.sqrt(np.mean(error**2)), 100 * np.mean(abs(error) > 2), np.sqrt(np.mean(millimetres**2))


def test_the_csv_has_what_was_predicted_and_what_refinement_made_of_it(phantoms, reported):
    with (reported / "report.csv").open() as file:
        rows = list(csv.DictReader(file))
    variants = {"raw": [], "released ldr": ["ldr"], "released ldr+gdr": ["ldr", "gdr"]}
    assert [(row["frame"], row["variant"]) for row in rows] == [
        (f"phantom_{seed:04d}", variant) for seed in range(7) for variant in variants
    ]
    for row in rows[:6]:
        prediction = np.load(phantoms / "maps/net" / f"{row['frame']}.npy")
        both = expected(phantoms / "data" / row["frame"], prediction, variants[row["variant"]])
        for prefix, (rmse, bad2, depth) in zip(("", "visible_"), both, strict=True):
            assert float(row[f"{prefix}rmse_px"]) == pytest.approx(rmse, rel=1e-5)
            assert float(row[f"{prefix}bad2_percent"]) == pytest.approx(bad2, abs=0.1)
            assert float(row[f"{prefix}depth_rmse_mm"]) == pytest.approx(depth, rel=1e-4)


def test_the_markdown_has_the_means_of_the_csv(reported):
    with (reported / "report.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["variant"] == "released ldr+gdr"]
    rmse = np.array([float(row["rmse_px"]) for row in rows])
    text = (reported / "report.md").read_text()
    (line, _) = (line for line in text.splitlines() if line.startswith("| net | released ldr+gdr"))
    assert f"{rmse.mean():.2f} ± {rmse.std(ddof=1):.2f}" in line.split("|")[3]
    assert "7 frames, 1 method; stereomend" in text


def test_without_an_output_the_markdown_is_printed_and_nothing_written(phantoms, tmp_path):
    done = evaluate(
        *("phantom", phantoms / "data", "--predictions", phantoms / "maps", "--presets", "released"),
        before=f"import os; os.chdir({str(tmp_path)!r}); ",
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("# Evaluation on phantom\n\n7 frames, 1 method; ")
    assert "| net | released | **" in done.stdout
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"dataset": "scarred"}, "dataset: got 'scarred', expected one of serv-ct, scared, "),
        ({"root": "/nowhere"}, "/nowhere does not exist; expected */truth.png in it"),
        ({"--predictions": "/nowhere"}, "/nowhere does not exist; expected * in it"),
        ({"--presets": "best"}, "preset: got 'best', expected one of "),
        ({"--stages": "sgm"}, "stages.0: Input should be 'ldr' or 'gdr', got 'sgm'"),
        ({"--backend": "fpga"}, "backend: got 'fpga', expected one of "),
    ],
)
def test_bad_usage_is_one_line_and_code_2(phantoms, changed, message):
    given = {"dataset": "phantom", "root": phantoms / "data", "--predictions": phantoms / "maps"} | changed
    flags = [part for flag in given if flag.startswith("--") for part in (flag, given[flag])]
    done = evaluate(given["dataset"], given["root"], *flags)
    assert done.returncode == 2
    assert done.stderr.startswith(f"stereomend: {message}"), done.stderr
    assert done.stderr.count("\n") == 1


def test_a_map_of_another_size_is_named_by_frame(phantoms, tmp_path):
    for path in (phantoms / "maps/net").iterdir():
        (tmp_path / "net").mkdir(exist_ok=True)
        np.save(tmp_path / "net" / path.name, np.load(path)[:, : 90 if "0003" in path.name else 96])
    done = evaluate("phantom", phantoms / "data", "--predictions", tmp_path, "--presets", "released")
    assert done.returncode == 2
    assert done.stderr.startswith("stereomend: phantom_0003: "), done.stderr
    assert "90 x 64" in done.stderr
    assert "96 x 64" in done.stderr


@pytest.mark.parametrize("absent", ["scipy", "jinja2"])
def test_without_the_extra_the_command_says_what_to_install(absent, tmp_path):
    done = evaluate(
        "phantom", tmp_path, "--predictions", tmp_path, before=f"sys.modules[{absent!r}] = None; "
    )
    assert done.returncode == 2
    assert done.stderr == f"stereomend: evaluate needs {absent}: pip install 'stereomend[evaluate]'\n"


def test_metrics_need_no_extra():
    code = "import sys; sys.modules['scipy'] = sys.modules['jinja2'] = None; "
    done = subprocess.run(
        [sys.executable, "-c", code + "import stereomend.evaluation.metrics"],
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
