"""Signatures of records: made by the service, checked by `dohyo verify`, and worth nothing for a changed record."""

from __future__ import annotations

import base64
import json
import stat
from pathlib import Path
from typing import Any

import pytest
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.signature import Signature, public_key, read_signature, sign, signature_path
from dohyo.evaluation.records.store import read_record, seal, write_record
from dohyo.service.cli.commands.signatures import check_signature
from dohyo.service.client.client import Client
from dohyo.service.client.known_keys import KnownKeys
from dohyo.service.signing.keys import SigningKeys
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import drive, ego, episode
from tests.service.harness import Harness, running


@pytest.fixture
def private() -> Ed25519PrivateKey:
    return Ed25519PrivateKey.generate()


@pytest.fixture
def signed(tmp_path: Path, private: Ed25519PrivateKey) -> Path:
    """A record with a good signature."""
    path = write_record(tmp_path, "one", seal(episode()), drive())
    signature_path(path).write_text(sign(private, read_record(path).record_hash).model_dump_json())
    return path


def changed(path: Path) -> EpisodeRecord:
    """Replaces a record by one with better facts and a correct hash; the signature stays."""
    better = seal(episode(ego(progress_m=1000.0)))
    write_record(path.parent, path.stem, better, drive())
    return better


def test_a_signature_names_its_key(signed: Path, private: Ed25519PrivateKey) -> None:
    record, key = read_record(signed), public_key(private)
    assert check_signature(signed, record, None, None).document == {"key": key, "owner": None}
    assert "not known here" in str(check_signature(signed, record, None, None))
    assert check_signature(signed, record, key, None).owner == "as given by --key"
    (signed.parent / "key.txt").write_text(key + "\n")
    assert check_signature(signed, record, str(signed.parent / "key.txt"), None).key == key
    other = public_key(Ed25519PrivateKey.generate())
    with pytest.raises(InvalidInputError, match="got one by"):
        check_signature(signed, record, other, None)
    signature_path(signed).unlink()
    assert str(check_signature(signed, record, None, None)) == "none"
    with pytest.raises(InvalidInputError, match="there is none"):
        check_signature(signed, record, key, None)


def test_a_changed_record_with_the_old_signature_is_refused(signed: Path) -> None:
    with pytest.raises(InvalidInputError, match="of another record"):
        check_signature(signed, changed(signed), None, None)


def test_a_signature_cannot_be_moved_to_another_hash(signed: Path) -> None:
    better = changed(signed)
    old = json.loads(signature_path(signed).read_text())
    signature_path(signed).write_text(json.dumps(old | {"record_hash": better.record_hash}))
    with pytest.raises(InvalidInputError, match="not made with key"):
        check_signature(signed, better, None, None)


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"x" * 10_000, b'{"key": "../x"}', b"[" * 4000])
def test_a_damaged_signature_is_refused(signed: Path, content: bytes) -> None:
    signature_path(signed).write_bytes(content)
    with pytest.raises(InvalidInputError, match="expected a signature"):
        read_signature(signed)


def test_the_signature_covers_its_purpose(private: Ed25519PrivateKey) -> None:
    record = seal(episode())
    made = sign(private, record.record_hash)
    made.check(record)
    bare = base64.b64encode(private.sign(record.record_hash.encode())).decode()
    with pytest.raises(InvalidInputError):
        Signature(**{**made.model_dump(), "signature": bare}).check(record)


# Keys of the service


def test_the_key_is_made_once_and_nobody_else_may_read_it(tmp_path: Path) -> None:
    current, retired = tmp_path / "key.pem", tmp_path / "retired"
    made = SigningKeys(current, retired).public
    assert stat.S_IMODE(current.stat().st_mode) == 0o600
    assert SigningKeys(current, retired).public == made
    assert list(tmp_path.iterdir()) == [current]
    current.chmod(0o644)
    with pytest.raises(InvalidInputError, match="only its owner"):
        SigningKeys(current, retired).prepare()
    current.write_text("no key")
    current.chmod(0o600)
    with pytest.raises(InvalidInputError, match="Ed25519 private key"):
        SigningKeys(current, retired).prepare()


def test_a_retired_key_still_counts(tmp_path: Path) -> None:
    with running(tmp_path / "data") as service:
        old = service.client.get("/v1/signing-key").json()
    folder = tmp_path / "data" / "retired-signing-keys"
    folder.mkdir()
    (tmp_path / "data" / "signing-key.pem").rename(folder / "2026.pem")
    with running(tmp_path / "data") as service:
        new = service.client.get("/v1/signing-key").json()
    assert old["retired"] == []
    assert (new["retired"], new["key"] != old["key"]) == ([old["key"]], True)


def test_a_server_whose_key_changes_is_noticed(
    service: Harness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers: dict[str, Any] = {"key": public_key(Ed25519PrivateKey.generate()), "retired": []}
    monkeypatch.setattr(Client, "get", lambda *_: answers)
    path = tmp_path / "known.json"
    assert KnownKeys(path).of_server("http://one") == [answers["key"]]
    assert KnownKeys(path).server_of(answers["key"]) == "http://one"
    first, answers["key"] = answers["key"], public_key(Ed25519PrivateKey.generate())
    with pytest.raises(InvalidInputError, match=f"its key was {first[:8]}".replace("+", r"\+")):
        KnownKeys(path).of_server("http://one")
