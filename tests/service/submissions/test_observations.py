"""The published interface of agents has a description for programs, and says how long a step is."""

from __future__ import annotations

from typing import Any

import pytest
from jsonschema import Draft202012Validator  # type: ignore[import-untyped]

from tests.service.harness import Harness


@pytest.mark.parametrize(
    ("query", "keys"),
    [
        ({}, {"rules", "sensors", "controls", "enumerations"}),
        (
            {"track": "map", "sensors": "speedometer,route", "control": "target_speed_steering"},
            {"track", "rules", "inputs", "outputs", "enumerations"},
        ),
    ],
    ids=["all", "chosen"],
)
def test_answers_fit_their_description(service: Harness, query: dict[str, str], keys: set[str]) -> None:
    document = service.client.get("/openapi.json").json()
    content = document["paths"]["/v1/observations"]["get"]["responses"]["200"]["content"]["application/json"]
    described = Draft202012Validator({**content["schema"], "components": document["components"]})
    answer: dict[str, Any] = service.client.get("/v1/observations", params=query).json()
    assert answer.keys() == keys
    assert [error.message for error in described.iter_errors(answer)] == []
    some = "inputs" if query else "sensors"
    assert not described.is_valid(answer | {some: 3})


def test_a_step_is_as_long_as_its_lease_says(service: Harness) -> None:
    step = service.client.get("/openapi.json").json()["paths"]["/v1/leases/{lease}/step"]["post"]
    assert "`dt_s`" in step["description"]
    assert "60 s" in step["description"]
