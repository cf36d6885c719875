"""What a ledger can be, and that each obstacle is named in one line."""

import os
import sqlite3
import stat
import subprocess

import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from stereomend.errors import ConfigurationError
from stereomend.jobs.ledger import Ledger
from stereomend.jobs.ledger.schema import metadata


def refused(url, match):
    with pytest.raises(ConfigurationError, match=match) as error:
        Ledger.open(url)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_the_migrations_make_what_the_code_expects(ledger):
    with ledger.engine.connect() as connection:
        context = MigrationContext.configure(connection)
        assert compare_metadata(context, metadata) == []
        assert context.get_current_heads() == ("0001",)


def test_a_column_that_the_migrations_miss_would_be_seen(ledger):
    with ledger.engine.begin() as connection:
        connection.execute(sa.text("ALTER TABLE jobs DROP COLUMN device"))
        (difference,) = compare_metadata(MigrationContext.configure(connection), metadata)
        assert (difference[0], difference[3].name) == ("add_column", "device")


def test_opening_again_changes_nothing(url, open_ledger, new_job, plenty):
    for count in range(3):
        with open_ledger(url) as ledger:
            assert len(ledger.page(None).records) == count
            ledger.accept(new_job(), plenty)


def test_a_newer_schema_is_refused_and_left_as_it_is(url, open_ledger):
    with open_ledger(url) as ledger, ledger.engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = '9999'"))
    refused(url, "schema 9999 is newer than this Stereomend, which knows 0001")
    engine = sa.create_engine(url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.connect() as connection:
        assert connection.execute(sa.text("SELECT version_num FROM alembic_version")).scalar() == "9999"
    engine.dispose()


def test_both_databases_promise_that_what_is_committed_stays(ledger):
    facts = ledger.check()
    if "journal_mode" in facts:
        assert (facts["journal_mode"], facts["synchronous"], facts["foreign_keys"]) == ("wal", "2", "1")
        assert facts["quick_check"] == "ok"
    else:
        assert facts["synchronous_commit"] == "on"
        assert facts["transaction_isolation"] == "read committed"


def test_nobody_else_may_read_the_file(tmp_path, open_ledger, new_job, plenty):
    before = os.umask(0)
    try:
        with open_ledger(f"sqlite:///{tmp_path}/ledger.sqlite") as ledger:
            ledger.accept(new_job(), plenty)
            files = list(tmp_path.iterdir())
            assert len(files) == 3
            assert {stat.S_IMODE(file.stat().st_mode) for file in files} == {0o600}
    finally:
        os.umask(before)


def test_a_percent_sign_in_the_path_is_a_percent_sign(tmp_path, open_ledger):
    folder = tmp_path / "50%(here)s ü"
    folder.mkdir()
    with open_ledger(f"sqlite:///{folder}/ledger.sqlite"):
        assert (folder / "ledger.sqlite").is_file()


@pytest.mark.parametrize(
    "url", ["sqlite://", "sqlite:///:memory:", "sqlite:////d/l?mode=ro", "sqlite://host/file"]
)
def test_what_is_no_file_of_this_host_is_refused(url):
    refused(url, "path of a file on this host|cannot be read")


@pytest.mark.parametrize(
    "url",
    ["mysql://u@h/d", "redis://h", "postgresql+psycopg2://h/d", "sqlite+pysqlcipher:///f", "http://h/x"],
)
def test_other_databases_are_refused(url):
    refused(url, r"has to be SQLite \(sqlite:////folder/file\) or PostgreSQL")


@pytest.mark.parametrize("url", ["", "ledger.sqlite", "/data/ledger.sqlite"])
def test_what_is_no_url_is_refused(url):
    refused(url, "is like sqlite:////folder/file")


def test_a_password_is_not_told():
    assert "hunter2" not in refused("mysql://ann:hunter2@h/d", "cannot be used")
    assert "hunter2" not in refused("postgresql://ann:hunter2@127.0.0.1:1/d", "refused")


def test_a_folder_that_is_missing_is_named(tmp_path):
    refused(
        f"sqlite:///{tmp_path}/missing/ledger.sqlite", "missing/ledger.sqlite cannot be used: No such file"
    )


def test_a_folder_is_no_ledger(tmp_path):
    refused(f"sqlite:///{tmp_path}", "Is a directory")


def test_another_file_is_no_ledger_and_stays_as_it_is(tmp_path):
    path = tmp_path / "ledger.sqlite"
    path.write_bytes(b"precious pixels " * 1000)
    refused(f"sqlite:///{path}", "file is not a database")
    assert path.read_bytes() == b"precious pixels " * 1000


def test_a_damaged_page_is_noticed(tmp_path, open_ledger, new_job, plenty):
    path = tmp_path / "ledger.sqlite"
    with open_ledger(f"sqlite:///{path}") as ledger:
        for _ in range(50):
            ledger.accept(new_job(), plenty)
    pages = bytearray(path.read_bytes())
    assert len(pages) > 10 * 4096
    for start in range(2 * 4096, len(pages), 4096):
        pages[start : start + 64] = bytes(range(64))
    path.write_bytes(pages)
    refused(f"sqlite:///{path}", "damaged|malformed")


def test_a_read_only_folder_is_refused(small_disk, open_ledger):
    url = f"sqlite:///{small_disk}/ledger.sqlite"
    with open_ledger(url):
        pass
    subprocess.run(["mount", "-o", "remount,ro", small_disk], check=True)
    refused(url, "Read-only file system")


def test_a_file_that_is_locked_by_another_is_refused(tmp_path, open_ledger, monkeypatch):
    monkeypatch.setattr("stereomend.jobs.ledger.database.BUSY_S", 0.05)
    path = tmp_path / "ledger.sqlite"
    with open_ledger(f"sqlite:///{path}"):
        pass
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN EXCLUSIVE")
    refused(f"sqlite:///{path}", "database is locked")
    other.close()
