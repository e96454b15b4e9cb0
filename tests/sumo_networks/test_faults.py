"""Faults of documents that dohyo reads: one line, at the place of the fault, in words."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError

from dohyo.evaluation.freeway.morning import MorningRecord
from dohyo.evaluation.parking.record import parse_record
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.signature import read_signature, signature_path
from dohyo.evaluation.running.manifest import Manifest, parse_manifest
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.networks.entries import ENTRY, network_entry, user_catalog


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (b"{", "expected JSON, but EOF while parsing an object at line 1 column 1"),
        (b"[]", "expected a table, got []"),
        (b'{"agnet": {}}', "agnet: unknown key; did you mean 'agent'? (there is agent, "),
        (b'{"agent": 3}', "agent: expected a table, got 3"),
    ],
)
def test_of_manifests_and_records(content: bytes, told: str) -> None:
    with pytest.raises(InvalidInputError) as error:
        parse_manifest(content, "folder/evaluation.json", Manifest)
    assert str(error.value).startswith(f"folder/evaluation.json: {told}")
    for parse in (parse_record, MorningRecord.parse):
        with pytest.raises(InvalidInputError, match=r"^here: expected (a|the) record of .*: \S") as error:
            parse(content, "here")
        assert "\n" not in str(error.value)


def test_of_signatures(tmp_path: Path) -> None:
    record = tmp_path / "one.json"
    signature_path(record).write_text('{"key": 3}')
    with pytest.raises(InvalidInputError, match=r"expected a signature: \w+: expected .*, "):
        read_signature(record)


def test_of_a_network_of_ones_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path))
    folder = user_catalog() / "mine"
    folder.mkdir(parents=True)
    (folder / ENTRY).write_text('titel = "Mine"\n')
    with pytest.raises(InvalidInputError) as error:
        network_entry("mine")
    assert str(error.value).startswith(f"{folder / ENTRY}: titel: unknown key; did you mean 'title'? (there is ")


def test_of_a_place_that_the_document_has() -> None:
    with pytest.raises(ValidationError) as error:
        EpisodeRecord.model_validate({"scenario": {"network": 3}})
    assert describe_fault(error.value, EpisodeRecord) == "scenario.network: expected text, got 3"
