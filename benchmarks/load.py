"""What a server under load does, and what it takes itself of an unloaded client's time.

    python benchmarks/load.py                                 # 16 clients for 180 s, then one client alone
    python benchmarks/load.py --seconds 10 --requests 20

Half of the clients ask for refinements and wait, half submit durable jobs and wait for their results. The
server holds fewer of each than there are clients, who ask again after 429 when they are told to. Ends with 1
if there was any other error, if an accepted client waited longer than the queue explains, or if memory grew.
All figures go to `benchmarks/results/load.json`.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from trials.loading import Done, Load, Own, form, measure_own, run_clients
from trials.record import keep
from trials.service import Service, service

from stereomend.jobs.turns import DURABLE_EVERY

MOST_QUEUED = 6
"""Requests, and as many jobs, that the server holds; the others are refused."""
MOST_SLOPE = 5.0
"""Of resident memory under load [MiB/min]."""
MOST_OWN_MS = 10.0
_WARM_UP = 5


def main() -> None:
    given = _arguments()
    settings = {"min_free_disk_mb": 0, "max_queued_jobs": MOST_QUEUED}
    with TemporaryDirectory() as folder, service(Path(folder), **settings) as running:
        alone = {f"{w}x{h} {p}": _alone(running, (w, h), p, given.requests) for w, h, p in _cases()}
        loaded = _loaded(running, given) if given.seconds else {}
    wrong = [name for name, one in alone.items() if one["own_p50_ms"] > MOST_OWN_MS] + loaded.get("wrong", [])
    print(f"wrong: {', '.join(wrong) or 'nothing'}; {keep('load', 0, {'alone': alone, 'loaded': loaded})}")
    sys.exit(bool(wrong))


def _arguments() -> argparse.Namespace:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--clients", type=int, default=16)
    options.add_argument("--seconds", type=float, default=180, help="0: only the client alone")
    options.add_argument("--preset", default="robust", help="under load")
    options.add_argument("--requests", type=int, default=60, help="of the client alone, for each case")
    return options.parse_args()


def _cases() -> list[tuple[int, int, str]]:
    return [(*size, preset) for size in ((640, 512), (720, 576)) for preset in ("released", "robust")]


def _alone(running: Service, size: tuple[int, int], preset: str, requests: int) -> dict[str, float]:
    measured = measure_own(running.url, form(size, preset), _WARM_UP + requests)[_WARM_UP:]
    own = [one.wait - one.stages for one in measured]
    found = {f"own_p{at}_ms": float(np.percentile(own, at)) for at in (10, 50, 90)}
    found |= {"wait_p50_ms": _median(measured, "wait"), "stages_p50_ms": _median(measured, "stages")}
    print(
        f"{size[0]}x{size[1]} {preset:9s} alone: the server itself {found['own_p50_ms']:.1f} ms "
        f"(p10 {found['own_p10_ms']:.1f}, p90 {found['own_p90_ms']:.1f}) of {found['wait_p50_ms']:.1f} ms",
        flush=True,
    )
    return found


def _median(measured: Sequence[Own], name: str) -> float:
    return float(np.median([getattr(one, name) for one in measured]))


def _loaded(running: Service, given: argparse.Namespace) -> dict[str, Any]:
    load = run_clients(
        running.url, running.supervisor or 0, given.clients, given.seconds, form((640, 512), given.preset)
    )
    slopes = {name: load.slope_mb_per_minute(name) for name in load.memory_mb}
    waits = {name: _waits(load, durable) for name, durable in (("refine", False), ("jobs", True))}
    wrong = list(load.faults)
    wrong += [f"memory of {name} grows" for name, slope in slopes.items() if slope > MOST_SLOPE]
    wrong += [f"{name} wait too long" for name, one in waits.items() if one["p99_s"] > one["bound_s"]]
    _say(load, slopes, waits)
    return {
        "clients": given.clients,
        "seconds": given.seconds,
        "preset": given.preset,
        "statuses": dict(load.statuses),
        "waits": waits,
        "memory_mb": load.memory_mb,
        "slopes_mb_per_minute": slopes,
        "wrong": wrong,
    }


def _waits(load: Load, durable: bool) -> dict[str, float]:
    """Percentiles, and the longest wait that the queue explains.

    Each waits at most for all others of its kind that the server holds, and these for their turns: every
    fourth at least is a durable job's, the others are left to requests.
    """
    seconds = [one.seconds for one in load.done if one.durable is durable]
    turn = _longest_turn(load.done)
    turns = MOST_QUEUED * (DURABLE_EVERY if durable else DURABLE_EVERY / (DURABLE_EVERY - 1)) + 1
    p50, p99 = np.percentile(seconds, (50, 99))
    return {"count": len(seconds), "p50_s": p50, "p99_s": p99, "bound_s": turns * turn, "turn_s": turn}


def _longest_turn(done: Sequence[Done]) -> float:
    return float(np.percentile([one.work_s for one in done], 99))


def _say(load: Load, slopes: dict[str, float], waits: dict[str, dict[str, float]]) -> None:
    print(", ".join(f"{name}: {times}" for name, times in sorted(load.statuses.items())))
    for name, one in waits.items():
        print(
            f"{name}: {one['count']} done, p50 {one['p50_s']:.2f} s, p99 {one['p99_s']:.2f} s, "
            f"bound {one['bound_s']:.2f} s of turns of {1e3 * one['turn_s']:.0f} ms"
        )
    for name, slope in slopes.items():
        first, last = load.memory_mb[name][0], load.memory_mb[name][-1]
        print(
            f"memory of {name}: {first:.0f} to {last:.0f} MiB, {slope:+.1f} MiB/min after the first quarter"
        )


if __name__ == "__main__":
    main()
