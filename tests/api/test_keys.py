"""Keys of the store and their scopes, at a real server."""

import subprocess
import sys
import time

import httpx
import pytest

from stereomend.jobs.folder import open_ledger
from stereomend.jobs.keys import KeyStore

QUICK = {"gdr": {"warps": 1, "levels": 1}}


def bearer(key):
    return {"Authorization": f"Bearer {key}"}


@pytest.fixture
def store(tmp_path):
    """The store of the servers that `serving` starts."""
    ledger = open_ledger(tmp_path / "data")
    yield KeyStore(ledger.engine)
    ledger.close()


def serve(*words):
    command = [sys.executable, "-m", "stereomend", "serve", "--port", "0", *words]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_each_scope_opens_its_methods_and_no_others(serving, store, post, is_problem):
    secrets = {scope: store.add(scope, [scope])[1] for scope in ("submit", "read", "admin")}
    with serving() as server:
        for scope, secret in secrets.items():
            refined = post(server, params=QUICK, headers=bearer(secret))
            figures = httpx.get(f"{server.url}/metrics", headers=bearer(secret))
            assert refined.status_code == (403 if scope == "read" else 200)
            assert figures.status_code == (403 if scope == "submit" else 200)
            assert httpx.get(f"{server.url}/v1/presets", headers=bearer(secret)).status_code == 200
        problem = is_problem(post(server, headers=bearer(secrets["read"])), 403, "forbidden")
        assert "POST needs submit" in problem["detail"]
        for method in ("DELETE", "PUT", "PATCH"):
            answer = httpx.request(method, f"{server.url}/v1/jobs/1", headers=bearer(secrets["read"]))
            is_problem(answer, 403, "forbidden")


def test_a_key_without_the_scope_is_refused_before_its_body_is_sent(serving, store, connect):
    reader = store.add("reader", ["read"])[1]
    with serving() as server:
        with connect(server) as connection:
            connection.sendall(
                b"POST /v1/refine HTTP/1.1\r\nHost: localhost\r\nContent-Length: 1000000\r\n"
                b"Content-Type: multipart/form-data; boundary=x\r\n"
                b"Authorization: Bearer " + reader.encode() + b"\r\n\r\n"
            )
            answer = connection.recv(1 << 16).decode()
        assert answer.startswith("HTTP/1.1 403 ")
        assert "connection: close" in answer.lower()


def test_a_key_that_is_revoked_opens_nothing_a_second_later(serving, store, is_problem):
    kept, gone = store.add("kept", ["read"])[1], store.add("gone", ["read"])
    with serving() as server, httpx.Client(base_url=server.url) as client:
        assert client.get("/metrics", headers=bearer(gone[1])).status_code == 200
        store.revoke(gone[0].id)
        revoked = time.monotonic()
        while client.get("/metrics", headers=bearer(gone[1])).status_code == 200:
            assert time.monotonic() - revoked < 1
        is_problem(client.get("/metrics", headers=bearer(gone[1])), 401, "unauthorized")
        assert client.get("/metrics", headers=bearer(kept)).status_code == 200


def test_a_key_that_is_added_opens_a_running_server_which_then_needs_one(serving, store, eventually):
    with serving() as server:
        assert httpx.get(f"{server.url}/metrics").status_code == 200
        key, secret = store.add("first", ["read"])
        eventually(lambda: httpx.get(f"{server.url}/metrics").status_code == 401, 2)
        assert httpx.get(f"{server.url}/metrics", headers=bearer(secret)).status_code == 200
        store.revoke(key.id)
        # Nobody may get in by the loss of the last key.
        eventually(lambda: httpx.get(f"{server.url}/metrics", headers=bearer(secret)).status_code == 401, 2)
        assert httpx.get(f"{server.url}/metrics").status_code == 401


def test_keys_of_the_settings_and_of_the_store_open_the_same_server(serving, store):
    secret = store.add("stored", ["submit", "read"])[1]
    with serving(api_keys="from-the-settings") as server:
        for key, status in ((secret, 200), ("from-the-settings", 200), ("neither", 401)):
            assert httpx.get(f"{server.url}/metrics", headers=bearer(key)).status_code == status


def test_another_address_needs_a_live_key_in_the_store(serving, store, tmp_path):
    key, secret = store.add("theatre 3", ["read"])
    with serving(host="0.0.0.0") as server:
        assert httpx.get(f"{server.url}/metrics").status_code == 401
        assert httpx.get(f"{server.url}/metrics", headers=bearer(secret)).status_code == 200
    store.revoke(key.id)
    refused = serve("--host", "0.0.0.0", "--data-dir", str(tmp_path / "data"))
    assert refused.returncode == 2
    assert "0.0.0.0" in refused.stderr
    assert "stereomend keys add" in refused.stderr
    assert refused.stderr.count("\n") == 1
    assert refused.stdout == ""


def test_the_log_names_keys_by_their_ids(serving, store):
    key, secret = store.add("Dr Smith", ["read"])
    with serving(api_keys="from-the-settings") as server:
        httpx.get(f"{server.url}/metrics", headers=bearer(secret))
        httpx.get(f"{server.url}/metrics", headers=bearer("from-the-settings"))
        httpx.get(f"{server.url}/metrics", headers=bearer("wrong-key"))
    log = server.log.read_text()
    assert f" key {key.id} " in log
    assert " key setting-" in log
    assert not [told for told in (secret, "from-the-settings", "wrong-key", "Smith") if told in log]
