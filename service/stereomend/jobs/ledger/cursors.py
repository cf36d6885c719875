"""Cursors of pages: opaque to clients, the place of the last record shown."""

from __future__ import annotations

import binascii
from base64 import urlsafe_b64decode, urlsafe_b64encode
from datetime import datetime
from typing import Any

from sqlalchemy import ColumnElement, Row, literal

from stereomend.errors import InvalidParameter
from stereomend.jobs.ledger.schema import jobs
from stereomend.jobs.records import is_job_id


def cursor_of(row: Row[Any]) -> str:
    """Name the place of a row."""
    return urlsafe_b64encode(f"{row.id} {row.created_at.isoformat()}".encode()).decode()


def after(cursor: str) -> tuple[ColumnElement[datetime], ColumnElement[str]]:
    """Read a cursor: time and id that all later rows are below (raises InvalidParameter)."""
    try:
        id, _, created = urlsafe_b64decode(cursor.encode("ascii")).decode("ascii").partition(" ")
        at = datetime.fromisoformat(created)
    except (ValueError, binascii.Error):
        id, at = "", datetime.min
    if not is_job_id(id) or at.tzinfo is None:
        raise InvalidParameter("cursor is not one that a page of this server gave")
    return literal(at, jobs.c.created_at.type), literal(id)
