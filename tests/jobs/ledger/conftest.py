"""Ledgers in SQLite and in a PostgreSQL of the tests' own.

Where PostgreSQL is missing its tests are skipped, and failed if REQUIRE_POSTGRES=1.
"""

import os
import pwd
import secrets
import shutil
import signal
import subprocess
import tempfile
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import sqlalchemy as sa

from stereomend.jobs.ledger import Ledger
from stereomend.jobs.records import NewJob, Outcome, Room, result_blob

PLENTY = Room(most_jobs=1000, most_bytes=10**9, most_jobs_of_owner=1000, free_disk_bytes=10**12)


class Clock:
    """Stands until it is moved."""

    def __init__(self):
        self.now = datetime(2024, 2, 29, 23, 59, 58, 123456, UTC)

    def __call__(self):
        return self.now

    def move(self, seconds):
        self.now += timedelta(seconds=seconds)


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request, tmp_path):
    """An empty database."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path}/ledger.sqlite"
    return request.getfixturevalue("postgres")()


@pytest.fixture
def ledger(url, clock):
    with opened(url, clock) as one:
        yield one


@contextmanager
def opened(url, clock=None):
    one = Ledger.open(url, clock)
    try:
        yield one
    finally:
        one.close()


@pytest.fixture
def open_ledger():
    """`with open_ledger(url) as ledger`."""
    return opened


def make_job(**given):
    plain = {
        "id": secrets.token_hex(16),
        "owner": "ann",
        "preset": "paper",
        "params": {"preset": "paper", "gdr": {"warps": 5, "tau": 0.25}},
        "input": {"width": 64, "height": 48, "sha256": "ab" * 32},
        "bytes_held": 1000,
        "bytes_reserved": 500,
    }
    return NewJob(**plain | given)


@pytest.fixture
def new_job():
    """A job to accept: `new_job(priority=3)`."""
    return make_job


@pytest.fixture
def accepted(ledger):
    """Accept a job where there is room: `accepted(priority=3)` is its record."""
    return lambda **given: ledger.accept(make_job(**given), PLENTY).record


@pytest.fixture
def running(ledger, accepted):
    """Accept a job and claim it for 30 s: the claim."""

    def start(**given):
        job = accepted(**given)
        claim = ledger.claim(30)
        assert claim.id == job.id, "another job was waiting"
        return claim

    return start


@pytest.fixture
def plenty():
    return PLENTY


@pytest.fixture
def success():
    """What a worker says at the end of a claim."""

    def make(claim, **given):
        return Outcome(result_blob=result_blob(claim.id, claim.attempt), result_sha256="cd" * 32, **given)

    return make


@pytest.fixture(scope="session")
def postgres():
    """Make an empty database; gives its URL."""
    programs = postgres_programs()
    if programs is None:
        reason = "PostgreSQL is not installed (Debian's package postgresql)"
        if os.environ.get("REQUIRE_POSTGRES") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    with running_postgres(programs) as server:
        admin = sa.create_engine(server("postgres"), isolation_level="AUTOCOMMIT")

        def make():
            name = f"test_{secrets.token_hex(6)}"
            with admin.connect() as connection:
                connection.execute(sa.text(f"CREATE DATABASE {name}"))
            return server(name)

        yield make
        admin.dispose()


def postgres_programs():
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=lambda path: int(path.parts[-3]))
    on_path = shutil.which("initdb")
    return found[-1].parent if found else Path(on_path).parent if on_path else None


@contextmanager
def running_postgres(programs):
    # It refuses to run as root, and the path of a socket has to be short.
    folder, user = Path(tempfile.mkdtemp(prefix="pg")), {}
    try:
        if os.geteuid() == 0:
            account = pwd.getpwnam("postgres")
            os.chown(folder, account.pw_uid, account.pw_gid)
            user = {"user": account.pw_uid, "group": account.pw_gid, "extra_groups": []}
        data = folder / "data"
        made = [
            programs / "initdb",
            "-D",
            data,
            "-U",
            "tests",
            "-A",
            "trust",
            "-E",
            "UTF8",
            "--locale=C",
            "-N",
        ]
        subprocess.run(made, check=True, capture_output=True, cwd=folder, **user)
        quick = ["-c", "listen_addresses=", "-c", "fsync=off", "-c", "max_connections=60"]
        started = [programs / "postgres", "-D", data, "-k", folder, *quick]
        with (folder / "log").open("w") as log:
            process = subprocess.Popen(started, stdout=log, stderr=log, cwd=folder, **user)
        try:
            ready = [programs / "pg_isready", "-h", folder, "-U", "tests", "-t", "20", "-q"]
            for _ in range(200):
                if subprocess.run(ready, check=False).returncode == 0:
                    break
                assert process.poll() is None, (folder / "log").read_text()
                with pytest.raises(subprocess.TimeoutExpired):
                    process.wait(0.1)
            yield lambda name: f"postgresql://tests@/{name}?host={folder}"
        finally:
            process.send_signal(signal.SIGINT)
            process.wait(20)
    finally:
        shutil.rmtree(folder)
