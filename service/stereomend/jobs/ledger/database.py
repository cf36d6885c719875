"""SQLite or PostgreSQL under the ledger: opening, migrating, transactions, and their faults by name.

What is committed is on the disk: SQLite syncs its write-ahead log each time, and PostgreSQL is told to.
Writers of SQLite take their turns; on PostgreSQL rows are locked.
"""

from __future__ import annotations

import json
import sqlite3
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, nullcontext
from datetime import UTC, datetime
from functools import partial
from importlib.resources import files
from pathlib import Path

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import Connection, Engine, event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError

from stereomend.errors import ConfigurationError, DiskFull, NotReady, OutdatedLedger, StereomendError

Clock = Callable[[], datetime]
"""Tells the time, aware."""

BUSY_S = 10.0
"""How long a transaction of SQLite waits for another process."""

_READS = "stereomend_reads"
# Any number: one lock of PostgreSQL's for admission, one for migrations.
_ADMISSION, _MIGRATION = 7_301, 7_302


class Database:
    """One engine and its transactions; thread-safe."""

    def __init__(self, engine: Engine, clock: Clock | None = None) -> None:
        self.engine = engine
        self._clock = clock
        self._postgres = engine.dialect.name == "postgresql"
        # Fair and at once, where SQLite's own waiting is neither.
        self._turn = nullcontext() if self._postgres else threading.Lock()

    @classmethod
    def open(cls, url: str, clock: Clock | None = None, migrate: bool = True) -> Database:
        """Connect and migrate.

        Raises:
            OutdatedLedger: without `migrate`, the schema is older.
            ConfigurationError: the URL is of no use here, or what it names cannot be reached or written, is
                damaged, or was made by a newer version.
        """
        parsed = _checked(url)
        engine = _engine(parsed)
        try:
            database = cls(engine, clock)
            with database.engine.begin() as connection:
                database._migrate(connection, migrate)
        except OutdatedLedger:
            engine.dispose()
            raise
        except (DBAPIError, ConfigurationError) as error:
            engine.dispose()
            why = _first_line(error.orig) if isinstance(error, DBAPIError) else str(error)
            raise ConfigurationError(f"the ledger {_shown(parsed)} cannot be used: {why}") from error
        return database

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """One transaction that only reads (raises NotReady)."""
        with _named_faults(), self.engine.connect().execution_options(**{_READS: True}) as connection:
            yield connection

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """One transaction, committed at the end.

        Raises:
            DiskFull: nothing was changed.
            NotReady: the database is busy or cannot be reached; whether it was committed is not known.
        """
        with self._turn, _named_faults(), self.engine.begin() as connection:
            yield connection

    def admitting(self, connection: Connection) -> None:
        """Let no other transaction admit until this one ends."""
        self._lock(connection, _ADMISSION)

    def now(self, connection: Connection) -> datetime:
        """The time: of PostgreSQL's host, for its clients' clocks may differ; of this host otherwise."""
        if self._clock:
            return self._clock()
        if self._postgres:
            now: datetime = connection.execute(sa.select(sa.func.clock_timestamp())).scalar_one()
            return now.astimezone(UTC)
        return datetime.now(UTC)

    def facts(self) -> Mapping[str, str]:
        """What the database says of its own settings, by name."""
        names = _POSTGRES_FACTS if self._postgres else _SQLITE_FACTS
        ask = "SHOW" if self._postgres else "PRAGMA"
        with self.reading() as connection:
            return {name: str(connection.exec_driver_sql(f"{ask} {name}").scalar()) for name in names}

    def _migrate(self, connection: Connection, really: bool) -> None:
        self._lock(connection, _MIGRATION)
        if not self._postgres:
            _check_pages(connection)
        config = Config()
        # A % would be taken for a reference to another option.
        config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
        config.attributes["connection"] = connection
        scripts = ScriptDirectory.from_config(config)
        known = {script.revision for script in scripts.walk_revisions()}
        found = set(MigrationContext.configure(connection).get_current_heads())
        if found - known:
            raise ConfigurationError(
                f"its schema {', '.join(found - known)} is newer than this Stereomend, "
                f"which knows {max(known)}"
            )
        if not really and found != set(scripts.get_heads()):
            raise OutdatedLedger(f"of schema {', '.join(found)}; migrated at the next start")
        command.upgrade(config, "head")

    def _lock(self, connection: Connection, number: int) -> None:
        if self._postgres:
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(number)))


_MIGRATIONS = files("stereomend.jobs.ledger") / "migrations"
_SQLITE_FACTS = ("journal_mode", "synchronous", "foreign_keys", "busy_timeout", "quick_check")
_POSTGRES_FACTS = (
    "server_version",
    "transaction_isolation",
    "synchronous_commit",
    "fsync",
    "full_page_writes",
)


def _checked(url: str) -> URL:
    try:
        parsed = make_url(url)
    except ArgumentError as error:
        raise ConfigurationError(
            "the ledger's URL cannot be read: it is like sqlite:////folder/file"
        ) from error
    if parsed.drivername in ("postgresql", "postgresql+psycopg"):
        return parsed.set(drivername="postgresql+psycopg")
    if parsed.drivername != "sqlite":
        raise ConfigurationError(
            f"the ledger {_shown(parsed)} cannot be used: it has to be SQLite (sqlite:////folder/file) "
            "or PostgreSQL (postgresql://...)"
        )
    if parsed.host or parsed.query or parsed.database in (None, "", ":memory:"):
        raise ConfigurationError(
            f"the ledger {_shown(parsed)} cannot be used: SQLite needs the path of a file on this host, "
            "and takes no options"
        )
    return parsed


def _shown(url: URL) -> str:
    return url.render_as_string(hide_password=True)


def _engine(url: URL) -> Engine:
    encode = partial(json.dumps, allow_nan=False)
    if url.drivername == "sqlite":
        _make_private(Path(str(url.database)), url)
        engine = sa.create_engine(url, json_serializer=encode, connect_args={"timeout": BUSY_S})
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    try:
        engine = sa.create_engine(
            url, json_serializer=encode, pool_pre_ping=True, isolation_level="READ COMMITTED"
        )
    except ModuleNotFoundError as error:
        raise ConfigurationError(
            "a ledger in PostgreSQL needs: pip install 'stereomend[postgres]'"
        ) from error
    event.listen(engine, "connect", _prepare_postgres)
    return engine


def _make_private(path: Path, url: URL) -> None:
    # What SQLite puts beside the file has the file's own mode.
    try:
        path.touch(mode=0o600)
        with path.open("r+b"):
            pass
    except OSError as error:
        raise ConfigurationError(f"the ledger {_shown(url)} cannot be used: {error.strerror}") from error


def _prepare_sqlite(connection: sqlite3.Connection, _: object) -> None:
    # Transactions are begun by `_begin_sqlite`: the driver would begin them at the first write only.
    connection.isolation_level = None
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON"):
        connection.execute(f"PRAGMA {pragma}")


def _begin_sqlite(connection: Connection) -> None:
    # One that reads first and writes later could find that another has written in between.
    reads = connection.get_execution_options().get(_READS)
    connection.exec_driver_sql("BEGIN" if reads else "BEGIN IMMEDIATE")


def _prepare_postgres(connection: sa.engine.interfaces.DBAPIConnection, _: object) -> None:
    cursor = connection.cursor()
    cursor.execute("SET synchronous_commit TO on")
    cursor.execute("SET TIME ZONE 'UTC'")
    cursor.close()
    connection.commit()


def _check_pages(connection: Connection) -> None:
    mode = connection.exec_driver_sql("PRAGMA journal_mode").scalar()
    if mode != "wal":
        raise ConfigurationError(f"its file system allows no write-ahead log (journal mode {mode})")
    found = connection.exec_driver_sql("PRAGMA quick_check(1)").scalar()
    if found != "ok":
        raise ConfigurationError(f"it is damaged: {_first_line(found)}")


@contextmanager
def _named_faults() -> Iterator[None]:
    try:
        yield
    except DBAPIError as error:
        raise _fault(error) or error from error


def _fault(error: DBAPIError) -> StereomendError | None:
    code = getattr(error.orig, "sqlite_errorcode", None) or getattr(error.orig, "sqlstate", None)
    if code in _FULL:
        return DiskFull("there is no room on the disk of the ledger")
    if code in _BUSY or error.connection_invalidated:
        fault = NotReady(f"the ledger cannot be reached: {_first_line(error.orig)}")
        fault.retry_after = 1
        return fault
    return None


# PostgreSQL's 53100 is disk_full.
_FULL = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_SHMSIZE, "53100")
_BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


def _first_line(error: object) -> str:
    return next(iter(str(error).strip().splitlines()), "no reason was given")
