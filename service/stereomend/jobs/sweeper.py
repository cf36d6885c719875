"""Deletes what nobody needs any more: results past their time, old records, files that no job knows."""

from __future__ import annotations

import logging
from typing import NamedTuple

from stereomend.jobs.blobs import BlobStore
from stereomend.jobs.ledger import Ledger

log = logging.getLogger(__name__)

ORPHAN_AGE_S = 3600.0
"""Younger files may be on their way into the ledger."""


class Swept(NamedTuple):
    """How many files were deleted."""

    expired: int
    orphans: int


class Sweeper:
    """Sweeps a store by what a ledger says; any number may run at once, beside readers and writers."""

    def __init__(self, ledger: Ledger, blobs: BlobStore, record_ttl_s: float) -> None:
        self._ledger = ledger
        self._blobs = blobs
        self._record_ttl_s = record_ttl_s
        self._suspects: set[str] = set()

    def sweep(self) -> Swept:
        """Sweep once; an orphan goes when it is found for the second time (raises what the ledger raises).

        Once is not enough: after a jump of the clock, or a sleep of the machine, a file looks old whose job
        is accepted in the next moment.
        """
        expired = self._ledger.expired(self._record_ttl_s)
        for name in expired:
            self._blobs.delete(name)
        # Files first: what is stored and accepted in between would else look like an orphan.
        old = {blob.name for blob in self._blobs.names() if blob.age_s > ORPHAN_AGE_S}
        orphans = old - self._ledger.known_blobs()
        gone = orphans & self._suspects
        for name in gone:
            self._blobs.delete(name)
        self._suspects = orphans - gone
        if expired or gone:
            log.info(
                "deleted %d results and inputs past their time, %d orphan files", len(expired), len(gone)
            )
        return Swept(len(expired), len(gone))
