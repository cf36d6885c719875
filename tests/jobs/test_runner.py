"""The runner between ledger and pool."""

import asyncio

from stereomend.jobs.changes import Changes
from stereomend.jobs.pool import WorkerPool
from stereomend.jobs.runner import Runner
from stereomend.jobs.store import Store
from stereomend.settings import load_settings


def test_a_runner_closes_though_a_job_is_announced(tmp_path):
    async def scenario():
        settings = load_settings(backend="reference", data_dir=tmp_path, min_free_disk_mb=0)
        store, pool = Store(settings, lambda state: None), WorkerPool(settings)
        pool.welcomes_job.set()
        runner = Runner(store, pool, settings, Changes())
        runner.start()
        await asyncio.sleep(0.2)  # It waits for the bell.
        runner.ring()
        await asyncio.wait_for(runner.close(), 10)
        store.close()

    asyncio.run(scenario())
