"""What the operating system tells about processes."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path


def descendants(pid: int) -> list[int]:
    """All children, their children and so on, parents first; zombies are left out."""
    parents = {child: parent for child, parent, state in _table() if state != "Z"}
    found, todo = [], [pid]
    while todo:
        parent = todo.pop(0)
        children = sorted(child for child, its in parents.items() if its == parent)
        found += children
        todo += children
    return found


def alive(pid: int) -> bool:
    """Whether a process runs; a zombie does not."""
    return any(child == pid and state != "Z" for child, _, state in _table())


def is_worker(pid: int) -> bool:
    """Whether a process was spawned by `multiprocessing`, its resource tracker left out."""
    return b"spawn_main" in _read(f"/proc/{pid}/cmdline")


def named_in_environment(mark: str) -> list[int]:
    """The processes, other than this, whose environment holds `mark`; zombies have none."""
    wanted = mark.encode()
    return [pid for pid, _, _ in _table() if pid != os.getpid() and wanted in _read(f"/proc/{pid}/environ")]


def memory_mb(pid: int, line: str) -> float:
    """`VmRSS` (now) or `VmHWM` (highest) [MiB]; 0 if the process is gone."""
    _, found, rest = _read(f"/proc/{pid}/status").decode().partition(f"{line}:")
    return int(rest.split()[0]) / 1024 if found else 0.0


def forget_highest(pid: int) -> None:
    """Let `VmHWM` begin anew (raises OSError where the kernel does not allow it)."""
    Path(f"/proc/{pid}/clear_refs").write_text("5")


def cpu_s(pid: int) -> float:
    """Seconds of processor time so far; 0 if the process is gone."""
    fields = _read(f"/proc/{pid}/stat").decode().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def _table() -> Iterator[tuple[int, int, str]]:
    """Process, its parent, its state."""
    for folder in Path("/proc").iterdir():
        fields = _read(f"/proc/{folder.name}/stat").decode().rpartition(")")[2].split()
        if folder.name.isdecimal() and fields:
            yield int(folder.name), int(fields[1]), fields[0]


def _read(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except OSError:
        return b""
