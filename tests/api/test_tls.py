"""TLS with real certificates."""

import json
import os
import re
import socket
import ssl
import subprocess
import sys
from pathlib import Path

import httpx
import pytest
import trustme


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """PEM files: `authority`, `certificate`, `key`, and `other`, another certificate's key."""
    folder = tmp_path_factory.mktemp("tls")
    authority = trustme.CA()
    authority.cert_pem.write_to_path(folder / "authority")
    ours, other = authority.issue_cert("127.0.0.1"), authority.issue_cert("127.0.0.1")
    for index, pem in enumerate(ours.cert_chain_pems):
        pem.write_to_path(folder / "certificate", append=index > 0)
    ours.private_key_pem.write_to_path(folder / "key")
    other.private_key_pem.write_to_path(folder / "other")
    return folder


@pytest.fixture(scope="module")
def trusting(files):
    return ssl.create_default_context(cafile=files / "authority")


def serve(certificate, key, *words, folder):
    command = [sys.executable, "-m", "stereomend", "serve", "--port", "0", "--data-dir", str(folder), *words]
    command += ["--tls-certfile", str(certificate), "--tls-keyfile", str(key)]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def test_the_server_speaks_https_with_the_certificate_that_it_is_given(serving, files, trusting, scene):
    with serving(tls_certfile=files / "certificate", tls_keyfile=files / "key") as server:
        assert server.url.startswith("https://127.0.0.1:")
        with httpx.Client(base_url=server.url, verify=trusting) as client:
            assert client.get("/livez").json() == {"status": "alive"}
            assert client.post("/v1/refine", files=scene.files, timeout=60).status_code == 200
        with pytest.raises(httpx.ConnectError, match="certificate verify failed"):
            httpx.get(f"{server.url}/livez")
        with pytest.raises(httpx.TransportError):
            httpx.get(server.url.replace("https", "http") + "/livez")


def health_check(server, **environment):
    """What the container's health check ends with, asked of a server."""
    text = (Path(__file__).parents[2] / "Dockerfile").read_text().partition("HEALTHCHECK")[2]
    command = json.loads(text.partition("CMD ")[2].partition("\n\n")[0].replace("\\\n", ""))
    port = {"STEREOMEND_PORT": server.url.rpartition(":")[2]}
    return subprocess.run(
        [sys.executable, *command[1:]], env=os.environ | port | environment, check=False
    ).returncode


def test_the_health_check_of_the_container_is_the_server_s(serving, files):
    with serving() as server:
        assert health_check(server) == 0
    assert health_check(server) != 0
    with serving(tls_certfile=files / "certificate", tls_keyfile=files / "key") as server:
        assert health_check(server, STEREOMEND_TLS_CERTFILE=str(files / "certificate")) == 0


@pytest.mark.filterwarnings("ignore:ssl.TLSVersion:DeprecationWarning")
def test_nothing_below_tls_1_2_is_spoken(serving, files, trusting):
    def handshake(version):
        context = ssl.create_default_context(cafile=files / "authority")
        context.set_ciphers("ALL:@SECLEVEL=0")
        context.minimum_version = context.maximum_version = version
        with (
            socket.create_connection(address, timeout=10) as connection,
            context.wrap_socket(connection, server_hostname="127.0.0.1") as secured,
        ):
            return secured.version()

    with serving(tls_certfile=files / "certificate", tls_keyfile=files / "key") as server:
        host, port = server.url.removeprefix("https://").split(":")
        address = host, int(port)
        assert handshake(ssl.TLSVersion.TLSv1_2) == "TLSv1.2"
        assert handshake(ssl.TLSVersion.TLSv1_3) == "TLSv1.3"
        for version in (ssl.TLSVersion.TLSv1, ssl.TLSVersion.TLSv1_1):
            with pytest.raises((ssl.SSLError, ConnectionError)):
                handshake(version)


@pytest.mark.parametrize(
    ("certificate", "key", "named"),
    [
        ("certificate", "other", "is not the key of the certificate"),
        ("certificate", "none", "tls_keyfile: .*none cannot be read: No such file"),
        ("none", "key", "tls_certfile: .*none cannot be read: No such file"),
        ("key", "key", "no PEM file"),
        ("certificate", "certificate", "no PEM file"),
        ("certificate", "encrypted", "encrypted"),
    ],
)
def test_files_that_cannot_be_used_are_told_in_one_line(files, tmp_path, certificate, key, named, encrypted):
    done = serve(files / certificate, files / key, folder=tmp_path)
    assert done.returncode == 2
    assert re.search(named, done.stderr), done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""


@pytest.fixture(scope="module")
def encrypted(files):
    from cryptography.hazmat.primitives import serialization

    key = serialization.load_pem_private_key((files / "key").read_bytes(), None)
    pem = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.BestAvailableEncryption(b"secret"),
    )
    (files / "encrypted").write_bytes(pem)
