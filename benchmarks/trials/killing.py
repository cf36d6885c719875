"""kill -9 of every process of a service, at random moments and at named points, while clients submit jobs."""

from __future__ import annotations

import signal
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trials.processes import alive
from trials.service import ORPHAN_S, Service, kill, service, until
from trials.work import Client, Told, look_again

POINTS = ("inputs-renamed", "job-inserted", "job-accepted", "results-renamed", "result-stored")
"""Where the API process kills itself; see `jobs/killpoints.py`."""
CLIENTS = 4
SETTINGS = {"backend": "native", "threads": 1, "workers": 2, "min_free_disk_mb": 0, "max_jobs_per_key": 256}
_TARGETS = ("api", "worker", "supervisor")
_SHARES = (0.45, 0.35, 0.2)


class Kill(NamedTuple):
    """One kill of the plan."""

    target: str
    """`api`, `worker` or `supervisor`."""
    ready: bool
    """Whether the service is ready when the delay begins; if not, it may be starting."""
    delay_s: float
    which: float
    """Chooses among the workers, in [0, 1)."""


@dataclass
class Trial:
    """What was done to a service, and what came of its jobs."""

    kills: Counter[str] = field(default_factory=Counter)
    starts: int = 0
    """Of the supervisor, the first one included."""
    jobs: int = 0
    answers: dict[int, int] = field(default_factory=dict)
    """How often each status came; 0: the connection broke."""
    attempts: Counter[int] = field(default_factory=Counter)
    """How many jobs needed so many attempts."""
    slowest_end_s: float = 0.0
    """How long a process outlasted the one that it belongs to, at most."""
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return dict(vars(self))


def plan(kills: int, seed: int) -> list[Kill]:
    """So many kills, of which each kind of process gets its share."""
    random = np.random.default_rng(seed)
    targets = [_TARGETS[at % 3] if at < 3 else str(random.choice(_TARGETS, p=_SHARES)) for at in range(kills)]
    return [
        Kill(target, random.random() < 0.75, float(random.uniform(0.05, 0.7)), random.random())
        for target in targets
    ]


def kill_at_random(folder: Path, kills: Sequence[Kill]) -> Trial:
    """Carry out a plan under load, then let the clients finish and look at everything once more."""
    with _under_load(folder) as (running, trial):
        for one in kills:
            if one.ready:
                until(running.ready, "the service is ready")
            time.sleep(one.delay_s)
            until(partial(_kill, running, one, trial), f"there is a process to kill: {one.target}")
    return trial


def kill_at_points(folder: Path, deaths: int, seed: int) -> Trial:
    """Let the API process die `deaths` times at each named point, each time a few jobs further."""
    random = np.random.default_rng(seed)
    with _under_load(folder, workers=1) as (running, trial):
        for point in POINTS:
            # From the second on: the job that is next after each start must not always be the one that dies.
            running.set("STEREOMEND_KILL_AT", f"{point}:{random.integers(2, 6)}")
            running.restart(signal.SIGTERM)
            for _ in range(deaths):
                until(partial(_died, running, running.some_api()), f"it dies at {point}")
                trial.kills[point] += 1
        running.set("STEREOMEND_KILL_AT", None)
        running.restart(signal.SIGTERM)
    return trial


def _died(running: Service, api: int) -> bool:
    return not alive(api) and running.api not in (None, api)


@contextmanager
def _under_load(folder: Path, **settings: object) -> Iterator[tuple[Service, Trial]]:
    """A service with clients at work; at the end all of their jobs have ended, and are checked."""
    trial, told, began = Trial(), Told(), time.monotonic()
    with service(folder, **{**SETTINGS, **settings}) as running:
        clients = [Client(running.url, f"client-{number}", told) for number in range(CLIENTS)]
        for client in clients:
            client.start()
        yield running, trial
        until(running.ready, "the service is ready after all")
        for client in clients:
            client.finish()
        look_again(running.url, told, trial.attempts)
        trial.starts, trial.jobs, trial.answers = running.starts, len(told.ids), told.answers
        told.expect(not running.orphans(), f"processes {running.orphans()} belong to no supervisor")
    told.expect(not running.all_processes(), "processes are left after the service was ended")
    trial.faults, trial.seconds = told.faults, time.monotonic() - began


def _kill(running: Service, one: Kill, trial: Trial) -> bool:
    """Kill, and see what belongs to the victim end too; false if there is no such process now."""
    api, workers = [running.api] if running.api else [], running.workers
    supervisor = [running.supervisor] if running.supervisor else []
    chosen = workers[int(one.which * len(workers)) :][:1]
    families = {"worker": chosen, "api": api + workers, "supervisor": supervisor + api + workers}
    heads = {"worker": chosen, "api": api, "supervisor": supervisor}
    if not heads[one.target] or not kill(heads[one.target][0]):
        return False
    trial.kills[one.target] += 1
    gone = families[one.target]
    lasted = until(lambda: not any(map(alive, gone)), f"{one.target} and what belongs to it ends", ORPHAN_S)
    trial.slowest_end_s = max(trial.slowest_end_s, lasted)
    return True
