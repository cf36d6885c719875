"""What the doctor finds on machines that lack something."""

import os
import resource
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from stereomend import doctor
from stereomend.doctor import (
    clock,
    data_folder,
    file_system,
    file_system_of,
    free_space,
    keys,
    open_files,
    pragmas,
)
from stereomend.jobs.folder import LEDGER, open_ledger
from stereomend.settings import load_settings


@pytest.fixture
def examine(tmp_path):
    """Run `stereomend doctor` on a data folder: `examine(min_free_disk_mb=1)` gives lines by subject."""

    def run(**settings):
        given = {"data_dir": tmp_path / "data"} | settings
        environment = os.environ | {f"STEREOMEND_{name.upper()}": str(given[name]) for name in given}
        command = [sys.executable, "-m", "stereomend", "doctor"]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        lines = {line[4:23].strip(): line for line in done.stdout.splitlines()}
        return done.returncode, lines

    return run


def test_a_fresh_machine_is_fine_and_nothing_is_made_on_it(examine, tmp_path):
    code, found = examine()
    assert code == 0
    assert "is made at the first start" in found["data folder"]
    assert all(found[what].startswith("ok ") for what in ("clock", "open files", "free space", "API keys"))
    assert not (tmp_path / "data").exists()


def test_what_keeps_a_server_from_working_is_named(examine, tmp_path):
    (tmp_path / "data").write_text("a file")
    code, found = examine(
        host="0.0.0.0", min_free_disk_mb=10**9, tls_certfile="none.pem", tls_keyfile="none.pem"
    )
    assert code == 1
    for what in ("data folder", "free space", "TLS", "API keys"):
        assert found[what].startswith("no "), what
    assert "none.pem cannot be read" in found["TLS"]


MOUNTS = """\
21 1 8:1 / / rw,relatime shared:1 - ext4 /dev/sda1 rw
40 21 0:45 / /mnt/my\\040share rw - nfs4 server:/export rw
41 40 8:2 / /mnt/my\\040share/disk rw master:2 - xfs /dev/sdb1 rw
"""


@pytest.mark.parametrize(
    ("folder", "kind"),
    [
        ("/srv/data", "ext4"),
        ("/mnt/my share/data", "nfs4"),
        ("/mnt/my shares", "ext4"),
        ("/mnt/my share/disk/data", "xfs"),
    ],
)
def test_the_file_system_of_a_folder_is_that_of_the_nearest_mount(folder, kind):
    assert file_system_of(Path(folder), MOUNTS) == kind


def test_a_network_file_system_is_no_place_for_a_ledger(tmp_path):
    assert file_system(tmp_path).fine
    network = file_system(Path("/mnt/my share/data"), MOUNTS)
    assert not network.fine
    assert "nfs4" in network.detail


def test_an_older_ledger_is_left_as_it_is(examine, tmp_path):
    open_ledger(tmp_path / "data").close()
    with closing(sqlite3.connect(tmp_path / "data" / LEDGER)) as database, database:
        database.execute("UPDATE alembic_version SET version_num = '0001'")
    code, found = examine()
    assert code == 0
    assert "schema 0001" in found["ledger"]
    assert "migrated at the next start" in found["ledger"]
    with closing(sqlite3.connect(tmp_path / "data" / LEDGER)) as database:
        assert database.execute("SELECT version_num FROM alembic_version").fetchall() == [("0001",)]


def test_a_used_folder_is_told_with_its_ledger_and_keys(examine, tmp_path):
    command = [sys.executable, "-m", "stereomend", "keys", "add", "x", "--data-dir", str(tmp_path / "data")]
    subprocess.run(command, check=True, capture_output=True)
    code, found = examine(host="0.0.0.0")
    assert code == 0
    assert "journal_mode wal, synchronous 2, foreign_keys 1" in found["ledger"]
    assert "1 in the data folder" in found["API keys"]


def test_a_damaged_ledger_is_no_traceback(examine, tmp_path):
    (tmp_path / "data").mkdir(mode=0o700)
    (tmp_path / "data" / LEDGER).write_bytes(b"no database" * 1000)
    code, found = examine()
    assert code == 1
    assert found["ledger"].startswith("no ")


def test_a_folder_that_others_can_read_is_told(tmp_path):
    tmp_path.chmod(0o755)
    assert not data_folder(tmp_path).fine
    assert not data_folder(tmp_path).needed
    tmp_path.chmod(0o700)
    assert data_folder(tmp_path).fine


def test_a_pragma_that_does_not_keep_a_commit_is_named(tmp_path):
    ledger = open_ledger(tmp_path)
    assert pragmas(ledger).fine
    told = dict(ledger.check())

    class Hasty:
        def check(self):
            with sqlite3.connect(tmp_path / LEDGER) as connection:
                connection.execute("PRAGMA synchronous = NORMAL")
                (synchronous,) = connection.execute("PRAGMA synchronous").fetchone()
            connection.close()
            return told | {"synchronous": str(synchronous)}

    found = pragmas(Hasty())
    ledger.close()
    assert not found.fine
    assert "wrong: synchronous" in found.detail


def test_a_clock_before_the_installation_or_set_while_watched_is_told(monkeypatch):
    assert clock().fine
    real, steps = time.time, iter([0.0] * 20 + [3600.0] * 21)
    monkeypatch.setattr(doctor.time, "time", lambda: real() + next(steps))
    assert not clock().fine
    monkeypatch.setattr(doctor.time, "time", real)
    os_stat = os.stat(doctor.__file__)
    monkeypatch.setattr(doctor, "_installed_at", lambda: os_stat.st_mtime + 2 * 366 * 86400)
    assert not clock().fine


def test_too_few_open_files_for_the_queue_are_told():
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    try:
        resource.setrlimit(resource.RLIMIT_NOFILE, (512, before[1]))
        assert not open_files(load_settings(max_queued_jobs=256)).fine
        assert open_files(load_settings(max_queued_jobs=64)).fine
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


def test_free_space_is_compared_with_what_jobs_leave(tmp_path):
    free = os.statvfs(tmp_path).f_bavail * os.statvfs(tmp_path).f_frsize >> 20
    assert free_space(load_settings(data_dir=tmp_path / "new", min_free_disk_mb=free // 2)).fine
    assert not free_space(load_settings(data_dir=tmp_path / "new", min_free_disk_mb=2 * free)).fine


def test_only_an_address_that_others_reach_needs_a_key():
    assert keys(load_settings(), 0).fine
    assert not keys(load_settings(host="0.0.0.0"), 0).fine
    assert keys(load_settings(host="0.0.0.0"), 1).fine
    assert keys(load_settings(host="0.0.0.0", api_keys="x"), 0).fine
