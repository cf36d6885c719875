"""Jobs and API keys."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Make both tables."""
    _make_jobs()
    op.create_table(
        "api_keys",
        sa.Column("id", sa.String(32), primary_key=True),
        sa.Column("name", sa.Text, nullable=False),
        sa.Column("hash", sa.Text, nullable=False),
        sa.Column("scopes", sa.JSON, nullable=False),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        sa.Column("revoked_at", sa.DateTime(timezone=True)),
    )


def _make_jobs() -> None:
    op.create_table(
        "jobs",
        sa.Column("id", sa.String(32), primary_key=True),
        *_texts("owner"),
        sa.Column("idempotency_key", sa.Text),
        sa.Column("state", sa.String(9), nullable=False),
        *_integers("version", "attempt", "crashes"),
        sa.Column("cancel_requested", sa.Boolean, nullable=False),
        *_texts("preset"),
        *(sa.Column(name, sa.JSON, nullable=False) for name in ("params", "input")),
        *_integers("priority"),
        sa.Column("keep_inputs", sa.Boolean, nullable=False),
        *_texts("request_id"),
        *(sa.Column(name, sa.BigInteger, nullable=False) for name in ("bytes_held", "bytes_reserved")),
        *_texts("phase"),
        *_integers("phase_done", "phase_total"),
        sa.Column("created_at", sa.DateTime(timezone=True), nullable=False),
        *(
            sa.Column(name, sa.DateTime(timezone=True))
            for name in ("deadline", "not_before", "lease_until", "started_at", "finished_at", "expires_at")
        ),
        *(sa.Column(name, sa.Text) for name in ("backend", "device")),
        *(sa.Column(name, sa.JSON) for name in ("timings_ms", "meta")),
        sa.Column("result_blob", sa.Text),
        sa.Column("result_sha256", sa.String(64)),
        sa.Column("error", sa.JSON),
        sa.UniqueConstraint("owner", "idempotency_key", name="uq_jobs_owner_idempotency_key"),
    )
    op.create_index("ix_jobs_state_priority_created_at", "jobs", ["state", "priority", "created_at"])
    op.create_index("ix_jobs_owner_created_at", "jobs", ["owner", "created_at"])


def _texts(*names: str) -> list[sa.Column[str]]:
    return [sa.Column(name, sa.Text, nullable=False) for name in names]


def _integers(*names: str) -> list[sa.Column[int]]:
    return [sa.Column(name, sa.Integer, nullable=False) for name in names]
