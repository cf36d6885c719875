"""`perform`: from files to an answer, in this process."""

import io
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import Pipe

import numpy as np
import pytest

from stereomend.codec import MEDIA_TYPES, PREVIEW_TYPE, encode_result
from stereomend.errors import ShapeMismatch
from stereomend.jobs.task import TIMINGS, Task, perform
from stereomend.jobs.worker import receive_task, send_task
from stereomend.refinement import parse_params, refine, select_backend


@pytest.fixture(scope="module")
def backend():
    return select_backend("reference")


def test_the_answer_holds_what_the_package_computes(quick, backend, scene):
    answer = perform(quick, backend, 10**6)
    expected = refine(
        scene.left, scene.right, scene.disparity, backend="reference", gdr={"warps": 1, "levels": 1}
    )
    np.testing.assert_array_equal(np.load(io.BytesIO(answer.body)), expected.disparity)
    assert answer.media_type == quick.media_type
    assert answer.meta["quality"] == expected.quality


@pytest.mark.parametrize("media_type", sorted({*MEDIA_TYPES.values(), PREVIEW_TYPE} - {"application/zip"}))
def test_no_answer_misses_the_confidences_that_it_holds(quick, scene, backend, media_type):
    given = {"gdr": {"warps": 1, "levels": 1}, "focal_px": 50.0, "baseline_mm": 5.0}
    task = replace(quick, params=parse_params(given), media_type=media_type)
    whole = refine(scene.left, scene.right, scene.disparity, backend="reference", **given)
    assert np.isfinite(whole.confidence).all()
    assert perform(task, backend, 10**6).body == encode_result(whole, media_type, left=scene.left)


def test_a_zip_holds_the_confidences_that_the_package_computes(quick, scene, backend):
    answer = perform(replace(quick, media_type="application/zip"), backend, 10**6)
    whole = refine(
        scene.left, scene.right, scene.disparity, backend="reference", gdr={"warps": 1, "levels": 1}
    )
    with np.load(io.BytesIO(answer.body)) as arrays:
        np.testing.assert_array_equal(arrays["confidence"], whole.confidence)
        np.testing.assert_array_equal(arrays["input_confidence"], whole.input_confidence)


def test_all_stages_are_timed_and_add_up(quick, backend):
    timings = perform(quick, backend, 10**6).timings
    assert tuple(timings) == TIMINGS
    assert timings["queue"] == timings["initial"] == 0
    assert 0 < sum(timings[name] for name in TIMINGS[:-1]) <= timings["total"]


def test_both_shapes_are_named_when_they_differ(scene, as_npy, backend):
    files = scene.files | {"disparity": as_npy(scene.disparity[:, 1:])}
    task = Task(**files, params=parse_params(), media_type="image/png")
    with pytest.raises(ShapeMismatch, match=r"63 x 48.*64 x 48"):
        perform(task, backend, 10**6)


def test_the_size_of_a_task_is_that_of_its_files(quick, scene):
    assert quick.size == sum(map(len, scene.files.values()))
    assert Task(b"12", b"345", None, quick.params, quick.media_type).size == 5


@pytest.mark.parametrize(
    "files", [{}, {"disparity": b""}, {"mask": bytes(300_000)}, {"disparity": b"d", "mask": b"m"}]
)
def test_a_task_reaches_a_worker_as_it_was_sent(files):
    task = Task(
        **{"left": b"l", "right": bytes(5), "disparity": None} | files,
        params=parse_params(),
        media_type="a/b",
    )
    ours, theirs = Pipe()
    with ours, theirs, ThreadPoolExecutor(1) as pool:
        sending = pool.submit(send_task, ours, task)
        assert receive_task(theirs) == task
        sending.result()
