"""The keys that open a running server: those of the settings, and those of the store as they are now."""

from __future__ import annotations

import asyncio
import hashlib
import hmac
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from time import monotonic

from stereomend.errors import ConfigurationError, NotReady
from stereomend.jobs.keys import ADMIN, READ, SCOPES, SUBMIT, KeyStore, digest_of
from stereomend.settings import Settings

_FRESH_S = 0.5
"""For so long the store is not read again, so that a revoked key opens nothing after it."""


@dataclass(frozen=True)
class Principal:
    """Who asks: the key's id and what it may."""

    owner: str
    scopes: frozenset[str]
    digest: bytes = field(repr=False)


LOCAL = Principal("local", frozenset((SUBMIT, READ)), b"")
"""Who asks where no key is needed."""


class KeyRing:
    """Finds whose key it is. A server that has needed keys once needs them until it ends."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._store: KeyStore | None = None
        self._of_settings = [_from_settings(key.get_secret_value()) for key in settings.api_keys]
        self._of_store: Sequence[Principal] = ()
        self._needed = settings.reachable or bool(self._of_settings)
        self._read_at = -_FRESH_S
        self._reading = asyncio.Lock()

    async def open(self, store: KeyStore) -> None:
        """Take the keys of a store too, and refuse to serve other machines without any key.

        Raises:
            ConfigurationError: the address is not loopback, and neither settings nor store have a live key.
        """
        self._store = store
        await self._refresh()
        if self._settings.reachable and not (self._of_settings or self._of_store):
            raise ConfigurationError(
                f"host {self._settings.host} is reachable from other machines and there is no API key; "
                "run `stereomend keys add NAME`, set STEREOMEND_API_KEYS or listen on 127.0.0.1"
            )

    async def needed(self) -> bool:
        """Whether requests need a key (raises NotReady if the store cannot be read)."""
        if not self._needed:
            await self._refresh()
        return self._needed

    async def find(self, key: str) -> Principal | None:
        """Find who has this key (raises NotReady if the store cannot be read)."""
        digest = digest_of(key)
        found = _match(digest, self._of_settings)
        if found is None:
            await self._refresh()
            found = _match(digest, self._of_store)
        return found

    async def _refresh(self) -> None:
        async with self._reading:
            began = monotonic()
            if began - self._read_at < _FRESH_S:
                return
            if self._store is None:
                raise _starting()
            keys = await asyncio.to_thread(self._store.live)
            self._of_store = [Principal(key.id, _with_implied(key.scopes), key.digest) for key in keys]
            self._needed = self._needed or bool(keys)
            self._read_at = began


def _starting() -> NotReady:
    error = NotReady("the server is starting")
    error.retry_after = 1
    return error


def _match(digest: bytes, principals: Iterable[Principal]) -> Principal | None:
    # All are compared, so that the time taken does not tell which one was close.
    matches = [principal for principal in principals if hmac.compare_digest(digest, principal.digest)]
    return matches[0] if matches else None


def _from_settings(key: str) -> Principal:
    # The id must outlive a restart, as jobs belong to it. It is logged, and people choose short keys: a slow
    # hash keeps it from being guessed by trying.
    name = hashlib.scrypt(key.encode(), salt=b"stereomend key id", n=1 << 14, r=8, p=1, dklen=4)
    return Principal(f"setting-{name.hex()}", frozenset((SUBMIT, READ)), digest_of(key))


def _with_implied(scopes: frozenset[str]) -> frozenset[str]:
    return frozenset(SCOPES) if ADMIN in scopes else scopes
