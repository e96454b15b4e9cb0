"""Trial of a scenario's traffic: whether it jams the network by itself, before any ego drives."""

from __future__ import annotations

import libsumo

from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation.plan import plan_scenario
from dohyo.sumo_networks.simulation.simulation import Simulation

TRIAL_S = 300.0
STUCK_S = 100.0
"""A standstill that is longer than the red of usual traffic lights, s."""


def stuck_share(network: RoadNetwork, scenario: Scenario) -> float:
    """Share of the vehicles that have stood for 100 s after 300 s of the scenario's traffic, in [0, 1].

    Raises:
        InvalidInputError: The network cannot carry this traffic at all.
        SimulationError: SUMO failed, or another simulation of this process is open.
    """
    traffic = scenario.traffic.model_copy(update={"warm_up_s": TRIAL_S})
    simulation = Simulation(plan_scenario(network, scenario.model_copy(update={"traffic": traffic})))
    try:
        waits = [float(libsumo.vehicle.getWaitingTime(name)) for name in libsumo.vehicle.getIDList()]
    finally:
        simulation.close()
    return sum(wait > STUCK_S for wait in waits) / max(len(waits), 1)
