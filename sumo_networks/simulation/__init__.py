"""The simulation of one scenario, in SUMO or against a log. Only this package and freeway/ import libsumo."""

from __future__ import annotations

from dohyo.sumo_networks.simulation.plan import ScenarioPlan, plan_scenario
from dohyo.sumo_networks.simulation.process import sumo_version
from dohyo.sumo_networks.simulation.replay import Replay
from dohyo.sumo_networks.simulation.simulation import START_CLEARANCE_M, Simulation

__all__ = [
    "START_CLEARANCE_M",
    "Replay",
    "ScenarioPlan",
    "Simulation",
    "plan_scenario",
    "start_simulation",
    "sumo_version",
]


def start_simulation(plan: ScenarioPlan) -> Simulation | Replay:
    """Starts a scenario: against its log if the scenario names one, otherwise in SUMO.

    Raises:
        InvalidInputError: The network cannot carry the traffic, or the log is missing or damaged.
        SimulationError: SUMO failed, or another simulation of this process is open.
    """
    return Simulation(plan) if plan.scenario.log is None else Replay(plan)
