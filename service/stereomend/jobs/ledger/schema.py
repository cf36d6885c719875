"""The tables of the ledger; `migrations/` makes them."""

from __future__ import annotations

from datetime import UTC, datetime

from sqlalchemy import (
    JSON,
    BigInteger,
    Boolean,
    Column,
    DateTime,
    Dialect,
    Index,
    Integer,
    MetaData,
    String,
    Table,
    Text,
    TypeDecorator,
    UniqueConstraint,
)


class Utc(TypeDecorator[datetime]):
    """An aware time, kept in UTC (SQLite has no time zones, and compares times as texts of one length)."""

    impl = DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """To UTC."""
        return None if value is None else value.astimezone(UTC)

    def process_result_value(self, value: datetime | None, dialect: Dialect) -> datetime | None:
        """From UTC."""
        if value is None:
            return None
        return value.astimezone(UTC) if value.tzinfo else value.replace(tzinfo=UTC)


_JSON = JSON(none_as_null=True)

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    }
)

jobs = Table(
    "jobs",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("owner", Text, nullable=False),
    Column("idempotency_key", Text),
    Column("state", String(9), nullable=False),
    Column("version", Integer, nullable=False),
    Column("attempt", Integer, nullable=False),
    Column("crashes", Integer, nullable=False),
    Column("cancel_requested", Boolean, nullable=False),
    Column("preset", Text, nullable=False),
    Column("params", _JSON, nullable=False),
    Column("input", _JSON, nullable=False),
    Column("priority", Integer, nullable=False),
    Column("keep_inputs", Boolean, nullable=False),
    Column("request_id", Text, nullable=False),
    Column("traceparent", Text),
    # 0 once the blob of inputs may go.
    Column("bytes_held", BigInteger, nullable=False),
    # 0 once there will be no (other) result.
    Column("bytes_reserved", BigInteger, nullable=False),
    Column("phase", Text, nullable=False),
    Column("phase_done", Integer, nullable=False),
    Column("phase_total", Integer, nullable=False),
    Column("created_at", Utc, nullable=False),
    Column("deadline", Utc),
    Column("not_before", Utc),
    Column("lease_until", Utc),
    Column("started_at", Utc),
    Column("finished_at", Utc),
    Column("expires_at", Utc),
    Column("backend", Text),
    Column("device", Text),
    Column("timings_ms", _JSON),
    Column("meta", _JSON),
    Column("result_blob", Text),
    Column("result_sha256", String(64)),
    Column("error", _JSON),
    UniqueConstraint("owner", "idempotency_key"),
    Index(None, "state", "priority", "created_at"),
    Index(None, "owner", "created_at"),
)

api_keys = Table(
    "api_keys",
    metadata,
    Column("id", String(32), primary_key=True),
    Column("name", Text, nullable=False),
    Column("hash", Text, nullable=False),
    # A list of names.
    Column("scopes", _JSON, nullable=False),
    Column("created_at", Utc, nullable=False),
    Column("revoked_at", Utc),
)
