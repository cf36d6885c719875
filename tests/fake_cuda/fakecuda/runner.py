"""Calls a function in a process of its own, on the fake device: a breakdown there harms nobody here."""

import atexit
import inspect
import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from fakecuda.build import driver_folder


class Failed(Exception):
    """The function raised: the type's name and the message, as text."""


def run(
    function: Callable[..., Any],
    *,
    order: str = "forward",
    env: dict[str, str] | None = None,
    **arguments: Any,
) -> Any:
    """What `function(**arguments)` returns in a new process; `Failed` if it raises.

    The function is found again by its file and name. `order` is that of the threads, `env` holds further
    FAKE_CUDA_* variables.
    """
    parent = forking_process()
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "output"
        environment = {"FAKE_CUDA_ORDER": order, **(env or {})}
        packed = pickle.dumps(arguments)
        call = (inspect.getfile(function), function.__name__, packed, environment, str(output))
        status = ask(parent, pickle.dumps(call))
        if not output.exists():
            raise Failed(f"the process ended with status {status} and no answer")
        succeeded, value = pickle.loads(output.read_bytes())
    if not succeeded:
        raise Failed(value)
    return value


def ask(parent: "subprocess.Popen[bytes]", call: bytes) -> str:
    """The status that the parent says of the child it forked."""
    if parent.stdin is None or parent.stdout is None:
        raise Failed("no pipes")
    parent.stdin.write(call)
    parent.stdin.flush()
    status = parent.stdout.readline().decode().strip()
    if not status:
        forking_process.cache_clear()
        raise Failed(f"the forking process ended with status {parent.wait()}")
    return status


@cache
def forking_process() -> "subprocess.Popen[bytes]":
    """A process with PyCUDA and the fake driver loaded, for as long as this one lives."""
    paths = {"LD_LIBRARY_PATH": str(driver_folder()), "PYTHONPATH": str(Path(__file__).parents[1])}
    joined = {
        name: os.pathsep.join(filter(None, (path, os.environ.get(name)))) for name, path in paths.items()
    }
    command = [sys.executable, "-m", "fakecuda.child"]
    pipe = subprocess.PIPE
    parent = subprocess.Popen(
        command, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL, env={**os.environ, **joined}
    )
    atexit.register(end, parent)
    return parent


def end(parent: "subprocess.Popen[bytes]") -> None:
    """Closes the pipes, at which the process ends."""
    for pipe in (parent.stdin, parent.stdout):
        if pipe is not None:
            pipe.close()
    parent.wait()
