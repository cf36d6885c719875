"""Tasks, and a pool with real workers."""

import asyncio
import subprocess
import time
from contextlib import asynccontextmanager

import pytest

from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.service import Submission
from stereomend.jobs.task import Files, Task
from stereomend.refinement import parse_params
from stereomend.settings import load_settings

NPY = "application/x-npy"
QUICK = {"gdr": {"warps": 1, "levels": 1}}


@pytest.fixture
def make_task(scene):
    """A task of the small scene: `make_task(gdr={"warps": 1})`."""

    def make(media_type=NPY, **params):
        return Task(**scene.files, params=parse_params(params), media_type=media_type)

    return make


@pytest.fixture
def quick(make_task):
    """A task that is done at once."""
    return make_task(**QUICK)


@pytest.fixture
def endless(make_task):
    """A task that takes minutes."""
    return make_task(gdr={"warps": 1000, "iterations": 1000, "levels": 1}, processing_scale=1.0)


@pytest.fixture
def submission(scene):
    """What a client sends, done at once unless parameters are given: `submission(SLOW, priority=1)`."""

    def make(params=QUICK, owner="local", files=None, **options):
        return Submission(Files(**(files or scene.files)), parse_params(params), owner, **options)

    return make


@pytest.fixture
def supervise():
    """Run a coroutine function with a pool: `supervise(scenario, workers=2)`."""

    def start(scenario, **settings):
        async def run():
            async with pool(**settings) as running:
                return await asyncio.wait_for(scenario(running), 60)

        return asyncio.run(run())

    return start


@asynccontextmanager
async def pool(**settings):
    running = WorkerPool(load_settings(backend="reference", **settings))
    try:
        await running.start()
        yield running
    finally:
        began = time.monotonic()
        await running.stop(grace_s=0)
        assert time.monotonic() - began < 10


@pytest.fixture
def small_disk(tmp_path):
    """A folder on a disk of 2 MiB."""
    folder = tmp_path / "small"
    folder.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", folder], check=False, capture_output=True
    )
    if mounted.returncode:
        pytest.skip("only root can mount a small disk")
    yield folder
    subprocess.run(["umount", "--lazy", folder], check=True)
