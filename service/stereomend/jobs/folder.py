"""The data folder: what lies where."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from stereomend.errors import ConfigurationError
from stereomend.jobs.ledger import Ledger
from stereomend.jobs.records import JobState

LEDGER = "ledger.sqlite"
BLOBS = ("inputs", "results")


def open_ledger(
    folder: Path, on_ended: Callable[[JobState], None] | None = None, migrate: bool = True
) -> Ledger:
    """Open the ledger of a data folder; both are made if they are not there. The rest is as of `Ledger.open`.

    Raises:
        OutdatedLedger: without `migrate`, it is older.
        ConfigurationError: the folder cannot be made or the ledger not be used.
    """
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"data_dir {folder} cannot be made: {error.strerror}") from error
    return Ledger.open(f"sqlite:///{folder.absolute() / LEDGER}", on_ended=on_ended, migrate=migrate)
