"""Files of jobs on the disk: inputs until a job ends, results for their time.

A blob is whole or not there: it is written under a temporary name, synced, renamed, and its folder synced.
"""

from __future__ import annotations

import errno
import json
import os
import re
import secrets
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from stereomend.errors import ConfigurationError, DiskFull, InternalError, ResultExpired
from stereomend.jobs.task import Files

_NAME = re.compile(r"inputs/[0-9a-f]{32}|results/[0-9a-f]{32}\.[0-9]{1,9}")
_TEMPORARY = re.compile(rf"({_NAME.pattern})\.[0-9a-f]{{8}}\.part")
_PARTS = ("left", "right", "disparity", "mask")


class Blob(NamedTuple):
    """A file of the store, temporary ones included."""

    name: str
    age_s: float
    """Since it was last written [s]."""


class BlobStore:
    """Blobs in a folder: `inputs/<id>` and `results/<id>.<attempt>`; thread-safe."""

    def __init__(self, folder: Path) -> None:
        """Make the folder where it is missing (raises ConfigurationError: it cannot be)."""
        self._folder = folder
        for part in (folder, folder / "inputs", folder / "results"):
            try:
                part.mkdir(mode=0o700, parents=True, exist_ok=True)
            except OSError as error:
                raise ConfigurationError(f"the folder {part} cannot be made: {error.strerror}") from error

    def put(self, name: str, chunks: Iterable[bytes]) -> None:
        """Store a blob; when this returns it is on the disk.

        Raises:
            DiskFull: there is no room, or the quota is used up; nothing is left of it.
            OSError: the disk fails otherwise; at most the whole blob is left.
        """
        path = self._path(name)
        temporary = path.with_name(f"{path.name}.{secrets.token_hex(4)}.part")
        with _full_disk_named():
            try:
                _write(temporary, chunks)
                temporary.rename(path)
            except BaseException:
                with suppress(OSError):
                    temporary.unlink()
                raise
            _sync(path.parent)

    def get(self, name: str) -> bytes:
        """Read a blob (raises FileNotFoundError)."""
        return self._path(name).read_bytes()

    def result(self, name: str) -> bytes:
        """Read the blob of a result (raises ResultExpired: it was deleted since its record was read)."""
        try:
            return self.get(name)
        except FileNotFoundError as error:
            raise ResultExpired("the result was deleted after its time") from error

    def delete(self, name: str) -> None:
        """Remove a blob if it is there; who has opened it reads on."""
        self._path(name, _TEMPORARY).unlink(missing_ok=True)

    def names(self) -> Iterator[Blob]:
        """Yield all files, also those left by a process that died while it wrote."""
        now = time.time()
        for kind in ("inputs", "results"):
            with os.scandir(self._folder / kind) as entries:
                for entry in entries:
                    # One that is gone meanwhile is of no interest.
                    with suppress(FileNotFoundError):
                        yield Blob(f"{kind}/{entry.name}", now - entry.stat(follow_symlinks=False).st_mtime)

    def free_bytes(self) -> int:
        """Bytes that this process may still write to the disk."""
        disk = os.statvfs(self._folder)
        return disk.f_bavail * disk.f_frsize

    def _path(self, name: str, also: re.Pattern[str] = _NAME) -> Path:
        if not (_NAME.fullmatch(name) or also.fullmatch(name)):
            raise ValueError(f"{name!r} is no name of a blob")
        return self._folder / name


def pack(files: Files) -> list[bytes]:
    """Lay files out as one blob, in chunks: a line of JSON (`[[name, size], ...]`), then their bytes."""
    parts = [(name, part) for name in _PARTS if (part := getattr(files, name)) is not None]
    head = json.dumps([[name, len(part)] for name, part in parts]).encode() + b"\n"
    return [head, *(part for _, part in parts)]


def unpack(blob: bytes) -> Files:
    """Take apart what `pack` made (raises InternalError: the blob is damaged)."""
    head, _, rest = blob.partition(b"\n")
    try:
        sizes = dict(json.loads(head))
        if not {"left", "right"} <= sizes.keys() <= set(_PARTS):
            raise ValueError("other parts")
        if min(sizes.values()) < 0 or sum(sizes.values()) != len(rest):
            raise ValueError("sizes do not add up")
        files: dict[str, Any] = dict.fromkeys(_PARTS)
        start = 0
        for name, size in sizes.items():
            files[name] = rest[start : start + size]
            start += size
        return Files(**files)
    except (ValueError, TypeError) as error:
        raise InternalError("the stored inputs are damaged") from error


def _write(path: Path, chunks: Iterable[bytes]) -> None:
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as file:
        for chunk in chunks:
            file.write(chunk)
        file.flush()
        os.fsync(file.fileno())


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _full_disk_named() -> Iterator[None]:
    try:
        yield
    except OSError as error:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise DiskFull("there is no room on the disk to keep what was sent, or its result") from error
        raise
