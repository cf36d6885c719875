"""The ledger of jobs, in SQLite or PostgreSQL."""

from stereomend.jobs.ledger.answers import Accepted, Page, Reaped, Renewal, Stats
from stereomend.jobs.ledger.ledger import Ledger

__all__ = ["Accepted", "Ledger", "Page", "Reaped", "Renewal", "Stats"]
