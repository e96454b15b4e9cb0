"""Files of TLS: checked before the server listens, so that a mistake is one line."""

from __future__ import annotations

import ssl
from pathlib import Path

from dohyo.sumo_networks.errors import InvalidInputError


def check_certificate(certificate: Path, key: Path) -> None:
    """Loads a certificate and its key, as the server will.

    Raises:
        InvalidInputError: They cannot be used.
    """
    asked = False

    def password() -> str:
        nonlocal asked
        asked = True
        return ""  # without this, OpenSSL asks at the terminal

    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(certificate, key, password)
    except (OSError, ValueError) as error:
        if asked:
            why = "the key is encrypted, expected one without a password"
        elif getattr(error, "reason", None) == "KEY_VALUES_MISMATCH":
            why = "the key is of another certificate"
        elif isinstance(error, ssl.SSLError):
            why = "expected PEM files of a certificate and of its key"
        else:
            why = str(error)
        raise InvalidInputError(f"TLS: '{certificate}' and '{key}' cannot be used: {why}") from error


def check_authorities(file: Path) -> None:
    """Loads certificates of authorities.

    Raises:
        InvalidInputError: They cannot be used.
    """
    try:
        ssl.create_default_context(cafile=file)
    except OSError as error:
        why = "expected a PEM file of certificates" if isinstance(error, ssl.SSLError) else str(error)
        raise InvalidInputError(f"TLS: '{file}' cannot be used: {why}") from error
