"""Driving: one scenario by one agent, as rows of studies need it."""

from __future__ import annotations

from dohyo.evaluation.agent import Agent
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.scenario import Scenario


def driven(scenario: Scenario, agent: Agent) -> tuple[EpisodeRecord, Trajectory]:
    """Drives a scenario of one ego, and closes the agent.

    Raises:
        SimulationError: The simulation failed.
    """
    try:
        record, trajectory = drive_episode(scenario, {scenario.missions[0].name: agent})
    finally:
        agent.close()
    ego = record.egos[0]
    if ego.status.worth_another_try:
        raise SimulationError(ego.failure or ego.status.value)
    return record, trajectory
