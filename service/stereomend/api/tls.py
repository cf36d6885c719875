"""TLS of the server's own: certificates checked before anything listens."""

from __future__ import annotations

import ssl
from pathlib import Path

from stereomend.errors import ConfigurationError
from stereomend.settings import Settings


def tls_context(settings: Settings) -> ssl.SSLContext | None:
    """Read the certificate and its key; None where the settings name none.

    Raises:
        ConfigurationError: a file cannot be read or is no PEM, or the key is encrypted or another one's.
    """
    certificate, key = settings.tls_certfile, settings.tls_keyfile
    if certificate is None or key is None:
        return None
    for name, path in (("tls_certfile", certificate), ("tls_keyfile", key)):
        _check_readable(name, path)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    try:
        # An encrypted key would otherwise be asked for on the terminal.
        context.load_cert_chain(certificate, key, password=_no_password)
    except ssl.SSLError as error:
        raise ConfigurationError(_fault(error, certificate, key)) from error
    return context


def _check_readable(name: str, path: Path) -> None:
    try:
        path.open("rb").close()
    except OSError as error:
        raise ConfigurationError(f"{name}: {path} cannot be read: {error.strerror}") from error


def _no_password() -> str:
    return ""


def _fault(error: ssl.SSLError, certificate: Path, key: Path) -> str:
    if error.reason == "KEY_VALUES_MISMATCH":
        return f"tls_keyfile: {key} is not the key of the certificate in {certificate}"
    why = error.reason or error
    return f"tls_certfile {certificate} or tls_keyfile {key} is no PEM file, or the key is encrypted: {why}"
