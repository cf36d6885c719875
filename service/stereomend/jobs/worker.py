"""The worker process: decodes, refines and encodes one task at a time, under limits.

Files from clients are read here and nowhere else. What a worker sends is JSON and raw bytes, never a pickle,
so that a decoder taken over by a hostile file gains nothing in the server.
"""

from __future__ import annotations

import json
import logging
import os
import resource
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NoReturn

from stereomend.errors import DeviceFault, InternalError, StereomendError, WorkLimitExceeded, error_from_slug
from stereomend.jobs.attendant import Attendant
from stereomend.jobs.logs import LogFormat, configure_logging
from stereomend.jobs.memory import keep_freed_memory
from stereomend.jobs.records import Progress
from stereomend.jobs.task import TIMINGS, Answer, Files, Task, perform
from stereomend.opencv import cv2
from stereomend.refinement import Backend, select_backend
from stereomend.settings import Settings

log = logging.getLogger(__name__)

DEVICE_FAULT_CODE = 86
"""Exit code of a worker that cannot use its GPU any more."""

_FILES = tuple(field.name for field in fields(Files))


@dataclass(frozen=True)
class WorkerPlan:
    """What a worker is told when it starts; `memory_mb` in MiB."""

    backend: str
    threads: int
    memory_mb: int
    max_pixels: int
    log_format: LogFormat

    @classmethod
    def of(cls, settings: Settings) -> WorkerPlan:
        """The part of the settings that workers need; keys are not in it."""
        return cls(
            settings.backend,
            settings.threads_per_worker,
            settings.work_limit_mb,
            settings.max_pixels,
            settings.log_format,
        )


@dataclass(frozen=True)
class Hello:
    """What a worker says when it is ready: what computes and why."""

    backend: str
    reason: str
    kernel: str


def work(connection: Connection, bell: Connection, plan: WorkerPlan) -> None:
    """Say hello, then answer tasks until the server closes the connection or dies."""
    attendant = Attendant(connection, bell)
    attendant.start()
    configure_logging(plan.log_format)
    cv2.setNumThreads(plan.threads)
    try:
        backend = select_backend(plan.backend, plan.threads)
    except StereomendError as error:
        attendant.answer(_problem(error))
        return
    keep_freed_memory()
    _limit(plan.memory_mb << 20)
    attendant.answer({"backend": backend.name, "reason": backend.reason, "kernel": backend.kernel})
    while (task := receive_task(connection)) is not None:
        attendant.begin()
        outcome = _outcome(task, backend, plan, attendant)
        _send_outcome(attendant, outcome)
        if isinstance(outcome, DeviceFault):
            _leave(task, outcome)


def receive_hello(connection: Connection) -> Hello:
    """Read what a worker says first.

    Raises:
        StereomendError: the worker cannot start, as its backend is not available.
        EOFError, OSError: the worker died.
    """
    return Hello(**_receive_head(connection))


def send_task(connection: Connection, task: Task) -> None:
    """Send a task to a worker; blocks until it is read (raises BrokenPipeError, OSError if the worker died).

    Each file is sent as it is: within the pickle it would be copied several times over.
    """
    names = [name for name in _FILES if getattr(task, name) is not None]
    emptied: dict[str, Any] = dict.fromkeys(names, b"")
    connection.send(replace(task, **emptied))
    for name in names:
        connection.send_bytes(getattr(task, name))


def receive_answer(connection: Connection, on_beat: Callable[[Progress], None]) -> Answer:
    """Read the beats of a task and the answer to it.

    Raises:
        StereomendError: the worker's.
        EOFError, OSError: it died.
        ValueError, TypeError: it says what no worker says.
    """
    while "beat" in (head := _receive_head(connection)):
        on_beat(_progress(*head["beat"]))
    return Answer(body=connection.recv_bytes(), **head)


def _progress(phase: str, done: int, total: int) -> Progress:
    if phase not in TIMINGS:
        raise ValueError("a worker is in no phase that is known")
    return Progress(phase, int(done), int(total))


def _leave(task: Task, fault: DeviceFault) -> NoReturn:
    log.error("request %s: %s", task.request_id, fault)
    # Not sys.exit: to clean up on a broken device can hang.
    os._exit(DEVICE_FAULT_CODE)


def _limit(memory: int) -> None:
    # On top of what the libraries took for themselves, which grows with the number of cores.
    most = _data_size() + memory
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    # A core file would hold a patient's images.
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def _data_size() -> int:
    status = Path("/proc/self/status").read_text()
    return int(status.partition("VmData:")[2].split()[0]) << 10


def receive_task(connection: Connection) -> Task | None:
    """Read the next task; None when there is none to come, or it does not fit into the memory."""
    try:
        task: Task = connection.recv()
        names = [name for name in _FILES if getattr(task, name) is not None]
        files: dict[str, Any] = {name: connection.recv_bytes() for name in names}
        return replace(task, **files)
    except (EOFError, OSError):
        return None
    except MemoryError:
        # What is left of the request in the pipe cannot be told from the next one.
        log.exception("a request does not fit into the memory that a refinement may take")
        return None


def _outcome(
    task: Task, backend: Backend, plan: WorkerPlan, attendant: Attendant
) -> Answer | StereomendError:
    try:
        return perform(task, backend, plan.max_pixels, attendant.watch)
    except StereomendError as error:
        return error
    except MemoryError:
        return _out_of_memory(plan)
    except Exception as error:
        if isinstance(error, cv2.error) and error.code == cv2.Error.StsNoMem:
            return _out_of_memory(plan)
        log.exception("request %s failed", task.request_id)
        return InternalError("the refinement failed unexpectedly; the server's log has the details")


def _out_of_memory(plan: WorkerPlan) -> WorkLimitExceeded:
    return WorkLimitExceeded(
        f"the refinement needs more than the {plan.memory_mb} MiB of memory that it may take; "
        "send smaller images, or raise work_limit_mb"
    )


def _send_outcome(attendant: Attendant, outcome: Answer | StereomendError) -> None:
    if isinstance(outcome, StereomendError):
        attendant.answer(_problem(outcome))
        return
    head = {"media_type": outcome.media_type, "meta": dict(outcome.meta), "timings": outcome.timings}
    attendant.answer(head, outcome.body)


def _problem(error: StereomendError) -> dict[str, str]:
    return {"error": error.slug, "detail": str(error)}


def _receive_head(connection: Connection) -> dict[str, Any]:
    head: dict[str, Any] = json.loads(connection.recv_bytes())
    if "error" in head:
        raise error_from_slug(head["error"], head["detail"])
    return head
