"""What the interface says of records fits each kind of them, as it is stored."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from jsonschema import Draft202012Validator  # type: ignore[import-untyped]

from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.records.store import seal, write_record
from tests.evaluation.builders import drive, ego, episode, infraction, lost
from tests.service.harness import Harness
from tests.service.records import day, lot, morning


def stored_drives(folder: Path) -> list[Any]:
    """Documents of records on roads, with an infraction and lost."""
    made = [episode(ego(infraction(InfractionKind.RED_LIGHT))), lost()]
    paths = [write_record(folder, f"r-{number}", seal(one), drive()) for number, one in enumerate(made)]
    return [json.loads(path.read_bytes()) for path in paths]


@pytest.fixture
def described(service: Harness) -> tuple[Any, Draft202012Validator]:
    """The interface's document, and what it says of records."""
    document = service.client.get("/openapi.json").json()
    answer = document["paths"]["/v1/episodes/{identifier}/record"]["get"]["responses"]["200"]
    schema = answer["content"]["application/json"]["schema"]
    return document, Draft202012Validator({**schema, "components": document["components"]})


def test_each_kind_of_record_fits_its_description(described: tuple[Any, Draft202012Validator], tmp_path: Path) -> None:
    others = [day(), day("NaN"), morning(), morning("late"), lot(), lot("late")]
    for record in (*stored_drives(tmp_path), *(json.loads(one.model_dump_json()) for one in others)):
        assert [error.message for error in described[1].iter_errors(record)] == []
        assert not described[1].is_valid(record | {"color": "red"})
        assert not described[1].is_valid(
            {key: value for key, value in record.items() if key != "agent" and key != "egos"}
        )


def test_map_of_infractions_may_be_refused(described: tuple[Any, Draft202012Validator]) -> None:
    """A benchmark without drives on roads has none."""
    assert "409" in described[0]["paths"]["/v1/evaluations/{identifier}/infractions"]["get"]["responses"]
