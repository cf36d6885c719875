"""A disk without room under SQLite, and databases that are busy or away."""

import sqlite3

import pytest

from stereomend.errors import ConfigurationError, DiskFull, NotReady
from stereomend.jobs.ledger import Ledger
from stereomend.jobs.records import JobState


def fill(folder):
    """Leave no byte; gives the file to delete."""
    ballast = folder / "ballast"
    with ballast.open("wb", buffering=0) as file:
        try:
            while True:
                file.write(bytes(4096))
        except OSError:
            return ballast


def test_a_full_disk_is_named_and_loses_nothing(small_disk, open_ledger, new_job, plenty, success):
    with open_ledger(f"sqlite:///{small_disk}/ledger.sqlite") as ledger:
        accepted = {ledger.accept(new_job(), plenty).record.id for _ in range(3)}
        claim = ledger.claim(600)
        ballast = fill(small_disk)
        refused = 0
        # The room that SQLite has already taken may do for some.
        while not refused:
            job = new_job(params={"text": "x" * 20_000})
            try:
                accepted.add(ledger.accept(job, plenty).record.id)
            except DiskFull:
                refused += 1
        before = {record.id: record for record in ledger.page(None).records}
        assert before.keys() == accepted
        with pytest.raises(DiskFull):
            ledger.finish(claim, success(claim, meta={"text": "x" * 20_000}), 60)
        assert {record.id: record for record in ledger.page(None).records} == before

        ballast.unlink()
        assert ledger.finish(claim, success(claim), 60)
        ledger.accept(job, plenty)
        assert ledger.check()["quick_check"] == "ok"
        assert ledger.stats().counts[JobState.QUEUED] == len(accepted)


def test_what_a_full_disk_kept_is_there_after_the_process_is_gone(small_disk, open_ledger, new_job, plenty):
    url = f"sqlite:///{small_disk}/ledger.sqlite"
    with open_ledger(url) as ledger:
        ids = {ledger.accept(new_job(), plenty).record.id for _ in range(3)}
        ballast = fill(small_disk)
    ballast.unlink()
    with open_ledger(url) as ledger:
        assert {record.id for record in ledger.page(None).records} == ids


def test_a_ledger_is_not_made_on_a_full_disk(small_disk):
    fill(small_disk)
    with pytest.raises(
        ConfigurationError, match=r"cannot be used: (No space left|database or disk is full|disk I/O)"
    ):
        Ledger.open(f"sqlite:///{small_disk}/ledger.sqlite")


def test_a_ledger_that_another_process_holds_is_not_ready(
    tmp_path, open_ledger, new_job, plenty, monkeypatch
):
    monkeypatch.setattr("stereomend.jobs.ledger.database.BUSY_S", 0.05)
    path = tmp_path / "ledger.sqlite"
    with open_ledger(f"sqlite:///{path}") as ledger:
        other = sqlite3.connect(path, isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(NotReady, match="locked") as busy:
            ledger.accept(new_job(), plenty)
        assert busy.value.retry_after
        assert ledger.page(None).records == []
        other.execute("ROLLBACK")
        other.close()
        ledger.accept(new_job(), plenty)


def test_a_connection_that_postgres_ends_is_replaced(postgres, open_ledger, new_job, plenty):
    with open_ledger(postgres()) as ledger, open_ledger(ledger.engine.url.render_as_string(False)) as other:
        first = ledger.accept(new_job(), plenty).record
        with other.engine.begin() as connection:
            connection.exec_driver_sql(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE pid <> pg_backend_pid() AND datname = current_database()"
            )
        assert ledger.get(first.id, None) == first


def test_a_connection_that_ends_within_a_transaction_is_not_ready(postgres, open_ledger, new_job, plenty):
    with open_ledger(postgres()) as ledger:
        url = ledger.engine.url.render_as_string(False)
        with open_ledger(url) as other, pytest.raises(NotReady):
            lose_connection(ledger, other)
        ledger.accept(new_job(), plenty)


def lose_connection(ledger, other):
    with ledger._database.writing() as connection:
        pid = connection.exec_driver_sql("SELECT pg_backend_pid()").scalar()
        with other.engine.begin() as killer:
            killer.exec_driver_sql(f"SELECT pg_terminate_backend({pid})")
        connection.exec_driver_sql("SELECT 1")
