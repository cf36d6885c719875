"""Durable jobs on a GPU that fails under them."""

import asyncio

import numpy as np
import pytest

from stereomend.codec import render
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.records import JobState
from stereomend.jobs.service import JobService, Submission
from stereomend.jobs.task import Files
from stereomend.refinement import parse_params, refine
from stereomend.settings import load_settings

pytestmark = pytest.mark.usefixtures("faulty_device")

BRIEF = {"preset": "released", "gdr": {"warps": 1, "levels": 1}}


@pytest.fixture
def ended(scene, tmp_path):
    """Run a job on the device to its end: its record, and its stored result if it has one."""

    async def run():
        settings = load_settings(backend="cuda", data_dir=tmp_path / "data", min_free_disk_mb=0)
        pool = WorkerPool(settings)
        jobs = JobService(settings, pool)
        try:
            await jobs.start()
            await pool.start()
            submission = Submission(Files(**scene.files), parse_params(BRIEF), "local")
            record = (await jobs.submit(submission)).record
            while not record.state.final:
                record = await jobs.changed(record.id, None, record.version, 60)
            done = record.state is JobState.SUCCEEDED
            return record, (await jobs.result(record.id, None)).content if done else None
        finally:
            await jobs.stop(0)

    return lambda: asyncio.run(asyncio.wait_for(run(), 120))


def test_a_job_that_met_a_fault_runs_again(ended, plant, scene, tmp_path):
    plant("launch 1:700")
    record, content = ended()
    assert (record.state, record.attempt, record.backend) == (JobState.SUCCEEDED, 2, "cuda")
    assert record.device == "Fake CUDA device"
    assert {"h2d", "d2h"} < set(record.timings_ms)
    npy = tmp_path / "result.npy"
    npy.write_bytes(render(content, "application/x-npy"))
    expected = refine(scene.left, scene.right, scene.disparity, backend="native", **BRIEF).disparity
    assert np.mean(np.abs(np.load(npy) - expected) <= 0.01) >= 0.997


def test_a_job_whose_every_attempt_meets_a_fault_is_given_up(ended, monkeypatch):
    monkeypatch.setenv("FAKE_CUDA_FAIL_LAUNCH", "0:719")
    record, _ = ended()
    assert (record.state, record.attempt) == (JobState.FAILED, 3)
    assert record.error["slug"] == "poison-job"
