"""The store of keys on a real database."""

import hashlib
import os

import pytest

from stereomend.errors import InvalidParameter
from stereomend.jobs.folder import LEDGER, open_ledger
from stereomend.jobs.keys import KeyStore


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "data"


@pytest.fixture
def store(folder):
    ledger = open_ledger(folder)
    yield KeyStore(ledger.engine)
    ledger.close()


def test_a_key_is_256_random_bits_and_only_its_hash_is_kept(store, folder):
    key, secret = store.add("theatre 3", ["read", "submit"])
    assert len(secret.removeprefix("stereomend_")) == 43
    assert store.add("theatre 3", ["read"])[1] != secret
    assert key.digest == hashlib.sha256(secret.encode()).digest()
    assert key.scopes == {"submit", "read"}
    kept = b"".join(path.read_bytes() for path in folder.iterdir())
    assert secret.encode() not in kept
    assert secret[-43:].encode() not in kept
    assert key.digest.hex().encode() in kept


def test_the_folder_of_the_keys_is_for_its_user_alone(store, folder):
    assert os.stat(folder).st_mode & 0o777 == 0o700
    assert os.stat(folder / LEDGER).st_mode & 0o777 == 0o600


def test_a_revoked_key_is_listed_and_no_longer_live(store):
    kept, gone = store.add("kept", ["read"])[0], store.add("gone", ["admin"])[0]
    revoked = store.revoke(gone.id)
    assert revoked.revoked_at >= gone.created_at
    assert store.revoke(gone.id) == revoked
    assert list(store.all()) == [kept, revoked]
    assert list(store.live()) == [kept]


def test_keys_outlive_the_process_that_made_them(store, folder):
    key, _ = store.add("theatre 3", ["submit"])
    again = open_ledger(folder)
    assert list(KeyStore(again.engine).all()) == [key]
    again.close()


@pytest.mark.parametrize(
    ("name", "scopes", "named"),
    [
        ("x", ["write"], "'write'"),
        ("x", [], "submit, read, admin"),
        ("", ["read"], "1 to 64"),
        ("x" * 65, ["read"], "1 to 64"),
        ("two\nlines", ["read"], "printable"),
    ],
)
def test_a_wrong_scope_or_name_is_refused(store, name, scopes, named):
    with pytest.raises(InvalidParameter, match=named):
        store.add(name, scopes)
    assert list(store.all()) == []


def test_an_unknown_id_cannot_be_revoked(store):
    with pytest.raises(InvalidParameter, match="'none'"):
        store.revoke("none")
