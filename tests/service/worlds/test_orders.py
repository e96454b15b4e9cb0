"""Orders of worlds: missions that the service draws, and what is refused."""

from __future__ import annotations

import pytest
from pydantic import ValidationError

from dohyo.service.wire.messages import Format, decode_as, encode
from dohyo.service.worlds.bodies import WorldRequest, WorldStep
from dohyo.service.worlds.orders import scenario_of
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.simulation.plan import plan_scenario


@pytest.mark.parametrize("network", ["ingolstadt", "district"])
def test_drawn_missions_start_apart(network: str) -> None:
    for seed in range(8):
        scenario = scenario_of(WorldRequest.model_validate({"network": network, "missions": 8, "seed": seed}))
        assert [one.name for one in scenario.missions] == [f"m{number:02d}" for number in range(1, 9)]
        plan_scenario(load_network(network), scenario)


def test_more_missions_than_a_network_has_starts_are_refused() -> None:
    request = WorldRequest.model_validate({"network": "ingolstadt", "missions": 64})
    with pytest.raises(InvalidInputError, match="missions"):
        scenario_of(request)


@pytest.mark.parametrize(
    ("order", "told"),
    [
        (
            {"network": "ingolstadt", "traffic": {"vehicels": 3}},
            "traffic.vehicels: unknown key; did you mean 'vehicles'",
        ),
        ({"network": "ingolstadt", "traffic": {"vehicles": -1}}, "traffic.vehicles: expected at least 0, got -1"),
        ({"network": "ingolstadt", "events": [{"x": 1}]}, "events.0: expected a table with 'kind'"),
        ({"scenario": {"network": "ingolstadt"}}, "scenario.missions: expected a value, and there is none"),
    ],
)
def test_faults_are_told_in_words_where_they_are(order: dict[str, object], told: str) -> None:
    with pytest.raises(InvalidInputError) as refused:
        scenario_of(WorldRequest.model_validate(order))
    assert str(refused.value).startswith(told)


@pytest.mark.parametrize(("key", "value"), [("missions", True), ("record", "yes"), ("stays", 1), ("seed", "7")])
def test_numbers_and_truths_are_what_they_are(key: str, value: object) -> None:
    with pytest.raises(ValidationError, match=key):
        WorldRequest.model_validate({"network": "ingolstadt", key: value})


def test_misspelt_keys_of_steps_and_actors_are_refused() -> None:
    row = {"name": "truck", "kind": "truck", "x_m": 0.0, "y_m": 0.0}
    for body, key in (
        ({"tick": 0, "actions": {}, "reset": 1}, "reset"),
        ({"tick": 0, "actions": {}, "actors": {"puts": [row]}}, "puts"),
        ({"tick": 0, "actions": {}, "actors": {"put": [row | {"heading": 1.0}]}}, "heading"),
    ):
        for fmt in Format:
            with pytest.raises(InvalidInputError, match=f"unknown field `{key}`"):
                decode_as(encode(body, fmt), fmt, WorldStep, "{tick, actions}")
    shown = {"tick": 0, "actions": {}, "actors": {"put": [row | {"role": "ego"}]}}  # as a world shows it
    assert decode_as(encode(shown, Format.JSON), Format.JSON, WorldStep, "{tick, actions}").actors is not None
