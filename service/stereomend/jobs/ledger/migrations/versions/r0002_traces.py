"""The trace that a job's stages belong to."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Add its column to the jobs."""
    op.add_column("jobs", sa.Column("traceparent", sa.Text))
