"""Mutants against the codec, in a child process with bounded memory, so that a crash is seen and told."""

from __future__ import annotations

import multiprocessing
import os
import resource
import time
from collections import Counter
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from pathlib import Path
from tempfile import NamedTemporaryFile
from types import SimpleNamespace
from typing import Any

import numpy as np

from stereomend.codec import decode_disparity, decode_image, decode_mask
from stereomend.disparity import DisparityMap
from stereomend.errors import InputError, StereomendError
from trials.mutations import make_mutant
from trials.originals import Format

MOST_PIXELS = 16_000_000
"""As servers have it by default: what lies about sides may ask for."""
MOST_MEMORY = 1 << 30
"""Bytes that the child may take on top of what it starts with."""
LONGEST_S = 1.0
_SILENCE_S = 60.0
_UNFORESEEN = "cannot be decoded ("


@dataclass
class Decoded:
    """What came of the mutants of one format; numbers name mutants."""

    mutants: int = 0
    outcomes: Counter[str] = field(default_factory=Counter)
    """`decoded`, or the name of the error."""
    unforeseen: Counter[str] = field(default_factory=Counter)
    """Errors that no check of ours foresaw, turned into `DamagedFile` at the last moment."""
    faults: dict[int, str] = field(default_factory=dict)
    crashes: dict[int, str] = field(default_factory=dict)
    longest_cpu_s: float = 0.0
    slowest: int = -1
    grown_mb: float = 0.0
    """Highest resident memory less what the child started with."""

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return dict(vars(self))


def decode_mutants(format: Format, numbers: range, seed: int) -> Decoded:
    """Decode these mutants; after a crash or a minute of silence another child goes on behind it.

    Raises:
        RuntimeError: a child dies before it decodes anything.
    """
    total = Decoded()
    first = numbers.start
    while first < numbers.stop:
        found, died_at, how = _one_child(format, range(first, numbers.stop), seed)
        _add(total, found)
        if died_at is not None and died_at < first:
            raise RuntimeError(f"the child that decodes does not start: {how}")
        if died_at is not None:
            total.crashes[died_at] = how
            total.mutants += died_at + 1 - first
        first = numbers.stop if died_at is None else died_at + 1
    return total


def _one_child(format: Format, numbers: range, seed: int) -> tuple[Decoded, int | None, str]:
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    at = spawn.Value("l", numbers.start - 1, lock=False)
    with NamedTemporaryFile() as said:
        child = spawn.Process(target=_run_child, args=(theirs, at, said.name, (format, numbers, seed)))
        child.start()
        theirs.close()
        try:
            return (ours.recv(), None, "") if _speaks(ours, at) else (Decoded(), at.value, "silent")
        except EOFError:
            child.join()
            last_words = Path(said.name).read_text(errors="replace")[-500:]
            return Decoded(), at.value, f"exit code {child.exitcode}: {last_words}"
        finally:
            child.kill()
            child.join()


def _speaks(pipe: Connection, at: Any) -> bool:
    """Wait until the child is done or dead; false if it stays at one mutant."""
    silent_since, last = time.monotonic(), at.value
    while not pipe.poll(0.2):
        if at.value != last:
            silent_since, last = time.monotonic(), at.value
        if time.monotonic() - silent_since > _SILENCE_S:
            return False
    return True


def _run_child(pipe: Connection, at: Any, said: str, what: tuple[Format, range, int]) -> None:
    # Libraries comment on every damaged file.
    os.dup2(os.open(said, os.O_WRONLY | os.O_APPEND), 2)
    format, numbers, seed = what
    _decode_all(SimpleNamespace(), format, range(-40, 0), seed)  # libraries take what they need once
    started = _status("VmRSS")
    most = (_status("VmData") << 10) + MOST_MEMORY
    resource.setrlimit(resource.RLIMIT_DATA, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    found = _decode_all(at, format, numbers, seed)
    found.grown_mb = (_status("VmHWM") - started) / 1024
    pipe.send(found)


def _decode_all(at: Any, format: Format, numbers: range, seed: int) -> Decoded:
    found = Decoded(mutants=len(numbers))
    for number in numbers:
        at.value = number
        data = make_mutant(format, number, seed).data
        began = time.process_time()
        _attempt(format, data, found, number)
        elapsed = time.process_time() - began
        if elapsed > found.longest_cpu_s:
            found.longest_cpu_s, found.slowest = elapsed, number
        if elapsed > LONGEST_S:
            found.faults[number] = f"took {elapsed:.2f} s"
    return found


def _attempt(format: Format, data: bytes, found: Decoded, number: int) -> None:
    try:
        fault = _fault(format, _decode(format, data))
        found.outcomes["decoded"] += 1
    except InputError as error:
        found.outcomes[type(error).__name__] += 1
        fault = "" if str(error).startswith("part: ") and len(str(error)) < 300 else f"says {error}"
        if _UNFORESEEN in str(error):
            found.unforeseen[str(error).partition("(")[2].rstrip(")")] += 1
    except StereomendError as error:
        fault = f"raised {type(error).__name__}: {error}"
    except BaseException as error:
        fault = f"raised {error!r}"
    if fault:
        found.faults[number] = fault


def _decode(format: Format, data: bytes) -> Any:
    if format.part == "image":
        return decode_image(data, "part", MOST_PIXELS)
    if format.part == "mask":
        return decode_mask(data, "part", MOST_PIXELS)
    try:
        return decode_disparity(data, "part", MOST_PIXELS)
    except InputError as error:
        if "disparity_scale is missing" not in str(error):
            raise
    return decode_disparity(data, "part", MOST_PIXELS, 16.0)


def _fault(format: Format, decoded: Any) -> str:
    """What is wrong with what came out, or nothing."""
    pixels = decoded.values if isinstance(decoded, DisparityMap) else decoded
    kinds = {"image": (np.uint8, np.uint16), "mask": (np.bool_,), "map": (np.float32,)}[format.part]
    axes = pixels.ndim == 2 or (format.part == "image" and pixels.shape[2:] == (3,))
    if not (axes and pixels.dtype in kinds and 0 < pixels.shape[0] * pixels.shape[1] <= MOST_PIXELS):
        return f"gave {pixels.dtype} of shape {pixels.shape}"
    if format.part == "map" and not (np.isfinite(pixels).all() and pixels.min() >= 0):
        return "gave a map with values below 0 or not finite"
    return ""


def _add(total: Decoded, found: Decoded) -> None:
    total.mutants += found.mutants
    total.outcomes += found.outcomes
    total.unforeseen += found.unforeseen
    total.faults |= found.faults
    if found.longest_cpu_s > total.longest_cpu_s:
        total.longest_cpu_s, total.slowest = found.longest_cpu_s, found.slowest
    total.grown_mb = max(total.grown_mb, found.grown_mb)


def _status(name: str) -> int:
    """A line of this process's status [KiB]."""
    return int(Path("/proc/self/status").read_text().partition(f"{name}:")[2].split()[0])
