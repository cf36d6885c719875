"""A disk that is full: while uploads are stored, while the ledger is written, and when results come."""

from __future__ import annotations

import errno
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx
import numpy as np

from trials.killing import SETTINGS, Trial
from trials.service import Service, service, until
from trials.work import Client, Told, kinds, look_again

DISK_MB = 128


@contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    """A tmpfs of `DISK_MB` at this folder (raises CalledProcessError: this user may not mount)."""
    folder.mkdir()
    size = f"size={DISK_MB}m"
    subprocess.run(["mount", "-t", "tmpfs", "-o", size, "tmpfs", folder], check=True, capture_output=True)
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)


def fill_disk(folder: Path, seconds: float, seed: int) -> Trial:
    """Upload to a full disk, then take and give back all room at random moments while clients submit."""
    trial, told = Trial(), Told()
    with small_disk(folder / "disk") as disk:
        (folder / "run").mkdir()
        with service(folder / "run", **{**SETTINGS, "workers": 1, "data_dir": disk}) as running:
            hog = _Hog(disk / "hog")
            _at_upload(running, hog, told)
            clients = [Client(running.url, f"client-{number}", told) for number in range(3)]
            for client in clients:
                client.start()
            _at_random(hog, seconds, seed, trial)
            for client in clients:
                client.finish()
            look_again(running.url, told, trial.attempts)
            trial.starts, trial.jobs, trial.answers = running.starts, len(told.ids), told.answers
            temporary = [path.name for path in disk.rglob("*.part")]
            if temporary:
                told.blame(f"temporary files are left: {temporary}")
    trial.faults = told.faults
    return trial


def _at_upload(running: Service, hog: _Hog, told: Told) -> None:
    hog.take_all()
    answer = httpx.post(f"{running.url}/v1/jobs", files=kinds()[0].form, timeout=30)
    if answer.status_code != 507 or "Retry-After" not in answer.headers:
        told.blame(f"an upload to a full disk was answered {answer.status_code}: {answer.text[:200]}")
    listed = httpx.get(f"{running.url}/v1/jobs", timeout=30)
    if listed.status_code != 200 or listed.json()["jobs"]:
        told.blame(f"on a full disk jobs are listed as {listed.status_code}: {listed.text[:200]}")
    hog.give_back()
    until(running.ready, "the service is ready")


def _at_random(hog: _Hog, seconds: float, seed: int, trial: Trial) -> None:
    """Room is gone for a moment between any two writes of the service: for blobs, ledger and results."""
    random = np.random.default_rng(seed)
    began = time.monotonic()
    while time.monotonic() - began < seconds:
        hog.take_all(int(random.choice((0, 0, 4096, 16384, 65536, 300_000))))
        trial.kills["disk full"] += 1
        time.sleep(float(random.uniform(0.02, 0.6)))
        hog.give_back()
        time.sleep(float(random.uniform(0.05, 0.6)))


class _Hog:
    """A file that takes the room."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def take_all(self, but: int = 0) -> None:
        """Leave `but` bytes of the disk."""
        with self._path.open("wb", buffering=0) as file:
            for size in (1 << 20, 1 << 12):
                with suppress(OSError):
                    while True:
                        file.write(bytes(size))
            with suppress(OSError):
                file.truncate(max(0, file.tell() - but))

    def give_back(self) -> None:
        """Leave all of it."""
        with suppress(FileNotFoundError):
            self._path.unlink()


def may_mount(folder: Path) -> bool:
    """Whether this process may mount a small disk."""
    try:
        with small_disk(folder / "probe"):
            return True
    except (subprocess.CalledProcessError, OSError) as error:
        if isinstance(error, OSError) and error.errno not in (errno.EPERM, errno.EACCES, errno.ENOENT):
            raise
        return False
