"""Driving: one scenario by one agent, as rows of studies need it; excerpts of traffic with their logs and score."""

from __future__ import annotations

from collections.abc import Iterable

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.samples import scenario_of
from dohyo.evaluation.agent import Agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.traffic_logs import prepare_logs
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.record import EgoRecord, EpisodeRecord
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.evaluation.scores.nuplan.score import ClosedLoop, closed_loop
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.networks.catalog import load_network
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


def prepare_excerpts(wanted: Iterable[Cell], workers: int) -> None:
    """Makes the missing logs of recorded traffic; cells of other benchmarks need none."""
    by_benchmark: dict[str, list[Cell]] = {}
    for cell in wanted:
        by_benchmark.setdefault(cell.benchmark, []).append(cell)
    for name, some in by_benchmark.items():
        prepare_logs([scenario_of(cell) for cell in some], load_benchmark(name).reference_agent, workers)


def scored_excerpt(cell: Cell, agent: Agent) -> tuple[EgoRecord, ClosedLoop]:
    """Drives the excerpt of a cell, and closes the agent.

    Raises:
        SimulationError: The simulation failed.
    """
    scenario = scenario_of(cell)
    record, trajectory = driven(scenario, agent)
    assert scenario.reference_m is not None, "an excerpt"
    return record.egos[0], closed_loop(record, trajectory, load_network(scenario.network), scenario.reference_m)
