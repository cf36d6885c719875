"""Processes that are stopped for longer than a lease, and go on when nobody expects it any more."""

from __future__ import annotations

import signal
import time
from pathlib import Path

from trials.killing import SETTINGS, Trial
from trials.processes import alive
from trials.service import Service, kill, service, until
from trials.work import Client, Told, look_again

LEASE_S = 2.0


def stop_past_lease(folder: Path, rounds: int) -> Trial:
    """Stop the worker, then the API process, for longer than the lease while jobs run; wake them up later."""
    trial, told = Trial(), Told()
    with service(folder, **{**SETTINGS, "workers": 1, "lease_s": LEASE_S}) as running:
        clients = [Client(running.url, f"client-{number}", told) for number in range(2)]
        for client in clients:
            client.start()
        for _ in range(rounds):
            _stop_worker(running, trial)
            _stop_api(running, trial)
        for client in clients:
            client.finish()
        look_again(running.url, told, trial.attempts)
        trial.starts, trial.jobs, trial.answers = running.starts, len(told.ids), told.answers
    trial.faults = told.faults
    return trial


def _stop_worker(running: Service, trial: Trial) -> None:
    """The pool replaces a worker that is silent; what was stopped gets no chance to go on."""
    until(running.ready, "the service is ready")
    until(lambda: running.workers, "there is a worker")
    stopped = running.workers[0]
    kill(stopped, signal.SIGSTOP)
    until(lambda: not alive(stopped), "the silent worker is replaced", 10 * LEASE_S)
    kill(stopped, signal.SIGCONT)
    trial.kills["worker stopped"] += 1


def _stop_api(running: Service, trial: Trial) -> None:
    """Leases run out meanwhile; the process goes on with what it had in hand."""
    until(running.ready, "the service is ready")
    stopped = running.some_api()
    kill(stopped, signal.SIGSTOP)
    time.sleep(2 * LEASE_S)
    kill(stopped, signal.SIGCONT)
    until(running.ready, "the service answers again")
    trial.kills["API process stopped"] += 1
