"""A service that is killed, stopped and left without disk space: whether it loses, changes or doubles a job.

    python benchmarks/kill.py                     # 60 kills at random, 3 at each named point, and the rest
    python benchmarks/kill.py --only random --kills 200 --seed 7

Prints what was done and what came of it, and ends with 1 if any accepted job did not end well. All figures go
to `benchmarks/results/kill.json`. A full disk is tried where this user may mount a tmpfs.
"""

import argparse
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from trials.filling import fill_disk, may_mount
from trials.killing import Trial, kill_at_points, kill_at_random, plan
from trials.record import keep
from trials.stopping import stop_past_lease


def main() -> None:
    given = _arguments()
    trials: Mapping[str, Callable[[Path], Trial]] = {
        "random": lambda folder: kill_at_random(folder, plan(given.kills, given.seed)),
        "points": lambda folder: kill_at_points(folder, given.deaths, given.seed),
        "stopped": lambda folder: stop_past_lease(folder, given.stops),
        "disk": lambda folder: fill_disk(folder, given.full_s, given.seed),
    }
    found = {name: _run(name, run) for name, run in trials.items() if name in given.only}
    faults = sum(len(trial.faults) for trial in found.values())
    figures = {name: trial.as_json() for name, trial in found.items()}
    print(f"{faults} faults; {keep('kill', given.seed, figures)}")
    sys.exit(faults > 0)


def _arguments() -> argparse.Namespace:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--only", nargs="+", default=["random", "points", "stopped", "disk"])
    options.add_argument("--kills", type=int, default=60, help="at random moments")
    options.add_argument("--deaths", type=int, default=3, help="at each named point")
    options.add_argument("--stops", type=int, default=3, help="of worker and API process each")
    options.add_argument("--full-s", type=float, default=20, help="seconds of a disk that is full at times")
    options.add_argument("--seed", type=int, default=1)
    return options.parse_args()


def _run(name: str, run: Callable[[Path], Trial]) -> Trial:
    with TemporaryDirectory() as folder:
        if name == "disk" and not may_mount(Path(folder)):
            return Trial(faults=["no tmpfs can be mounted here"])
        began = time.monotonic()
        trial = run(Path(folder))
        trial.seconds = time.monotonic() - began
        if trial.faults:
            print(next(Path(folder).rglob("service.log")).read_text()[-4000:], file=sys.stderr)
    done = ", ".join(f"{what} {times}" for what, times in trial.kills.items())
    attempts = ", ".join(f"{jobs} in {count}" for count, jobs in sorted(trial.attempts.items()))
    print(f"{name}: {done}; {trial.jobs} jobs, by attempts: {attempts}; {trial.seconds:.0f} s", flush=True)
    for fault in trial.faults[:20]:
        print(f"    {fault}", flush=True)
    return trial


if __name__ == "__main__":
    main()
