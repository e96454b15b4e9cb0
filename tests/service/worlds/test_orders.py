"""Orders of worlds: missions that the service draws."""

from __future__ import annotations

import pytest

from dohyo.service.worlds.bodies import WorldRequest
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
