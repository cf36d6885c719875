"""Blobs on real disks, full ones included."""

import os
import re
import stat
import subprocess
import sys
import threading

import pytest

from stereomend.errors import ConfigurationError, DiskFull, InternalError, ResultExpired
from stereomend.jobs.blobs import BlobStore, pack, unpack
from stereomend.jobs.task import Files

INPUTS, RESULT = f"inputs/{'a' * 32}", f"results/{'a' * 32}.1"


@pytest.fixture
def blobs(tmp_path):
    return BlobStore(tmp_path / "data")


def names(blobs):
    return sorted(blob.name for blob in blobs.names())


def test_a_blob_is_read_as_it_was_written(blobs):
    blobs.put(INPUTS, [b"ab", b"", bytes(1 << 20)])
    assert blobs.get(INPUTS) == b"ab" + bytes(1 << 20)
    assert names(blobs) == [INPUTS]


def test_what_is_put_again_replaces_the_blob_and_who_reads_the_old_one_reads_on(blobs, tmp_path):
    blobs.put(RESULT, [b"old"])
    with (tmp_path / "data" / RESULT).open("rb") as reader:
        blobs.put(RESULT, [b"new"])
        assert (blobs.get(RESULT), reader.read()) == (b"new", b"old")


def test_a_deleted_blob_is_gone_and_may_be_deleted_again(blobs):
    blobs.put(RESULT, [b"x"])
    for _ in range(2):
        blobs.delete(RESULT)
    with pytest.raises(FileNotFoundError):
        blobs.get(RESULT)
    with pytest.raises(ResultExpired):
        blobs.result(RESULT)


def test_nobody_else_may_look(tmp_path):
    before = os.umask(0)
    try:
        BlobStore(tmp_path / "data").put(INPUTS, [b"x"])
    finally:
        os.umask(before)
    modes = {path: stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "data").rglob("*")}
    assert sorted(modes.values()) == [0o600, 0o700, 0o700]
    assert stat.S_IMODE((tmp_path / "data").stat().st_mode) == 0o700


@pytest.mark.parametrize(
    "name",
    ["", "x", "/etc/passwd", "../x", f"inputs/../{'a' * 32}", f"{INPUTS}.1", f"{INPUTS}\n",
     f"results/{'a' * 32}", f"{RESULT}.0123abcd.part", f"inputs/{'A' * 32}", "inputs/\0"],
)  # fmt: skip
def test_other_names_are_refused(blobs, name):
    for call in (lambda: blobs.put(name, [b"x"]), lambda: blobs.get(name)):
        with pytest.raises(ValueError, match="no name of a blob"):
            call()


def test_a_writer_that_fails_leaves_nothing(blobs):
    def chunks():
        yield b"some"
        assert len(names(blobs)) == 1
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        blobs.put(INPUTS, chunks())
    assert names(blobs) == []


def test_a_blob_is_whole_or_not_there(blobs):
    seen = []

    def chunks():
        for _ in range(3):
            yield b"part"
            with pytest.raises(FileNotFoundError):
                blobs.get(INPUTS)
            seen.append(1)

    blobs.put(INPUTS, chunks())
    assert (len(seen), blobs.get(INPUTS)) == (3, b"partpartpart")


def test_it_is_synced_before_it_has_its_name_and_its_folder_after(tmp_path):
    """As the kernel sees it, by the names in /proc of what is synced."""
    code = f"""
import os, sys
from pathlib import Path
from stereomend.jobs.blobs import BlobStore
sync, rename = os.fsync, Path.rename
def told_sync(fd):
    print("sync", os.readlink(f"/proc/self/fd/{{fd}}"), flush=True)
    sync(fd)
def told_rename(path, to):
    print("rename", path, flush=True)
    return rename(path, to)
os.fsync, Path.rename = told_sync, told_rename
BlobStore(Path(sys.argv[1])).put("{INPUTS}", [b"x"])
"""
    said = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True)
    steps = re.sub(r"\.[0-9a-f]{8}\.part", ".part", said.stdout).split()
    part = f"{tmp_path}/{INPUTS}.part"
    assert steps == ["sync", part, "rename", part, "sync", f"{tmp_path}/inputs"]


def test_a_full_disk_is_named_and_leaves_nothing(small_disk):
    blobs = BlobStore(small_disk / "data")
    blobs.put(RESULT, [bytes(1000)])
    with pytest.raises(DiskFull):
        blobs.put(INPUTS, (bytes(100_000) for _ in range(40)))
    assert names(blobs) == [RESULT]
    assert blobs.free_bytes() > 900_000
    blobs.put(INPUTS, [bytes(100_000)])
    assert blobs.get(INPUTS) == bytes(100_000)


def test_a_disk_without_room_for_a_name_is_full_too(small_disk):
    blobs = BlobStore(small_disk)
    subprocess.run(["mount", "-o", "remount,nr_inodes=4", small_disk], check=True)
    # Three folders and one file.
    blobs.put(RESULT, [b"x"])
    with pytest.raises(DiskFull):
        blobs.put(INPUTS, [b"x"])


def test_the_free_bytes_are_those_that_can_be_written(small_disk):
    blobs = BlobStore(small_disk)
    free = blobs.free_bytes()
    blobs.put(INPUTS, [bytes(4096 * 10)])
    assert free - blobs.free_bytes() == 4096 * 10


def test_writers_of_one_name_do_not_mix(blobs):
    bodies = [bytes([number]) * 300_000 for number in range(6)]
    threads = [threading.Thread(target=blobs.put, args=(RESULT, [body])) for body in bodies]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert blobs.get(RESULT) in bodies
    assert names(blobs) == [RESULT]


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(ConfigurationError, match=r"file.* cannot be made: Not a directory"):
        BlobStore(tmp_path / "file" / "data")


@pytest.mark.parametrize(
    "files",
    [
        Files(b"left", b"right", None),
        Files(b"", b"\n\n", b"\n"),
        Files(b"l", b"r", None, mask=b"m" * 1000),
        Files(bytes(range(256)), b'[["left", 3]]\n', b"d", mask=b""),
    ],
)
def test_files_come_out_of_a_blob_as_they_went_in(files):
    assert unpack(b"".join(pack(files))) == files


@pytest.mark.parametrize(
    "blob",
    [b"", b"\n", b"x\n", b"[]\n", b"7\nx", b'[["left", 1]]\nx', b'[["left", 1], ["right", 1]]\nx',
     b'[["left", -1], ["right", 3]]\nxy', b'[["left", 1], ["right", 1], ["other", 1]]\nxyz',
     b'[["left", "1"], ["right", 1]]\nxy', b'[["left"]]\n', b"[[[], 1]]\nx", b"\xff\n"],
)  # fmt: skip
def test_a_damaged_blob_is_named(blob):
    with pytest.raises(InternalError, match="damaged"):
        unpack(blob)
