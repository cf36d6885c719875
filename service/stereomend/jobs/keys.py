"""The store of API keys: of a key only the hash is kept, so nobody can read it again."""

from __future__ import annotations

import hashlib
import secrets
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from sqlalchemy import Engine, Row, insert, select, update

from stereomend.errors import InvalidParameter
from stereomend.jobs.ledger.database import Database
from stereomend.jobs.ledger.schema import api_keys

SUBMIT, READ, ADMIN = SCOPES = ("submit", "read", "admin")
"""What a key may: send and cancel jobs, look at them and their results, and both with everybody's."""

_LONGEST_NAME = 64


@dataclass(frozen=True)
class Key:
    """What is known of a key; times are UTC and aware."""

    id: str
    name: str
    scopes: frozenset[str]
    created_at: datetime
    revoked_at: datetime | None
    digest: bytes = field(repr=False)
    """As `digest_of` gives it."""


def digest_of(key: str) -> bytes:
    """SHA-256 of a key. No slow hash is needed: keys of the store are 256 random bits."""
    return hashlib.sha256(key.encode("utf-8", "surrogatepass")).digest()


class KeyStore:
    """Keys in the ledger's database; safe to use from several threads and beside a running server.

    All methods raise NotReady while the database cannot be reached, and those that change it DiskFull.
    """

    def __init__(self, engine: Engine) -> None:
        self._database = Database(engine)

    def add(self, name: str, scopes: Iterable[str]) -> tuple[Key, str]:
        """Make a key and give it with its secret, which is kept nowhere.

        Raises:
            InvalidParameter: a scope is unknown or none is given, or the name empty, long or not printable.
        """
        _check(name, chosen := sorted(set(scopes)))
        secret = f"stereomend_{secrets.token_urlsafe(32)}"
        id = secrets.token_hex(6)
        values = {
            "id": id,
            "name": name,
            "hash": digest_of(secret).hex(),
            "scopes": chosen,
            "created_at": datetime.now(UTC),
        }
        with self._database.writing() as connection:
            connection.execute(insert(api_keys).values(values))
        return self._one(id), secret

    def all(self) -> Sequence[Key]:
        """Every key, revoked ones too, oldest first."""
        with self._database.reading() as connection:
            rows = connection.execute(select(api_keys).order_by(api_keys.c.created_at, api_keys.c.id))
            return [_key(row) for row in rows]

    def live(self) -> Sequence[Key]:
        """The keys that were not revoked."""
        return [key for key in self.all() if key.revoked_at is None]

    def revoke(self, id: str) -> Key:
        """Make a key worthless; a running server sees it within a second. Twice does no harm.

        Raises:
            InvalidParameter: no key has this id.
        """
        unrevoked = (api_keys.c.id == id) & api_keys.c.revoked_at.is_(None)
        with self._database.writing() as connection:
            connection.execute(update(api_keys).where(unrevoked).values(revoked_at=datetime.now(UTC)))
        return self._one(id)

    def _one(self, id: str) -> Key:
        with self._database.reading() as connection:
            row = connection.execute(select(api_keys).where(api_keys.c.id == id)).one_or_none()
        if row is None:
            raise InvalidParameter(f"no key has the id {id!r}; `stereomend keys list` shows all")
        return _key(row)


def _key(row: Row[Any]) -> Key:
    scopes = frozenset(row.scopes)
    return Key(row.id, row.name, scopes, row.created_at, row.revoked_at, bytes.fromhex(row.hash))


def _check(name: str, scopes: Sequence[str]) -> None:
    if not (0 < len(name) <= _LONGEST_NAME and name.isprintable()):
        raise InvalidParameter(f"name {name!r}: expected 1 to {_LONGEST_NAME} printable characters")
    for scope in scopes or [""]:
        if scope not in SCOPES:
            raise InvalidParameter(f"scope {scope!r} is unknown; expected {', '.join(SCOPES)}")
