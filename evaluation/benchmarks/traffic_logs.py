"""Traffic logs: each is made once, from a drive of the reference agent in live traffic, and kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import as_completed
from dataclasses import dataclass

import numpy as np

from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.processes import worker_pool
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation.traffic_log import Log, LogRecorder, log_path, write_log


@dataclass(frozen=True, slots=True)
class Reference:
    """The drive of the reference agent in a scenario.

    Attributes:
        log: Motion of all other actors.
        trajectory: Trajectory of the ego and of the actors in its sight.
        progress_m: Largest progress along the route, m.
        goal: Whether it reached the goal; the log then ends early.
    """

    log: Log
    trajectory: Trajectory
    progress_m: float
    goal: bool


def drive_reference(scenario: Scenario, entry: str) -> Reference:
    """Drives the reference agent through a scenario in live traffic.

    Args:
        scenario: Scenario with a duration and one mission; if it names a log, the log is not read.
        entry: "module:Class" of the reference agent.

    Raises:
        InvalidInputError: The scenario has no duration, or cannot be driven.
        SimulationError: SUMO failed.
    """
    if scenario.duration_s is None or len(scenario.missions) != 1:
        raise InvalidInputError(f"scenario '{scenario.name}': expected a duration and one mission for a log")
    agent = make_agent(entry)
    env = DrivingEnv(scenario.model_copy(update={"log": None}), agent.spec.sensors, agent.spec.control, reward=None)
    recorder, trajectory, ended = LogRecorder(), TrajectoryRecorder(), False
    name = scenario.missions[0].name
    try:
        observations, _ = env.reset()
        agent.reset(scenario.missions[0], scenario.seed)
        env.record(recorder)
        trajectory.append(env.world)
        goal = False
        while not ended:
            observations, _, reached, late, _ = env.step({name: agent.act(observations[name])})
            goal, ended = reached[name], reached[name] or late[name]
            env.record(recorder)
            trajectory.append(env.world)
    finally:
        env.close()
        agent.close()
    driven = trajectory.finish()
    progress = float(np.max(driven.progress[driven.key == -1]))
    return Reference(recorder.finish(), driven, round(progress, 2), goal)


def missing_logs(scenarios: Iterable[Scenario]) -> list[Scenario]:
    """The scenarios whose logs are missing on this machine."""
    return [one for one in scenarios if one.log is not None and not log_path(one.log).exists()]


def prepare_logs(
    scenarios: Iterable[Scenario],
    reference_agent: str | None,
    workers: int = 1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Makes missing logs; after an interruption, the same call makes the rest.

    Args:
        scenarios: Scenarios; those that name no log are ignored.
        reference_agent: "module:Class" of the agent that drives; None if the scenarios name no logs.
        workers: Number of processes; each makes one log after the other.
        progress: Function called with the number done and the total, at the start and after each log.

    Returns:
        The number of logs made.

    Raises:
        InvalidInputError: A log is missing without a reference agent, or that agent no longer gives the same log.
    """
    todo = missing_logs(scenarios)
    progress(0, len(todo))
    if not todo:
        return 0
    if reference_agent is None:
        raise InvalidInputError(f"scenario '{todo[0].name}': its log is missing, and no reference_agent makes it")
    with worker_pool(min(workers, len(todo)), _make_log) as pool:
        futures = [pool.submit(_make_log, scenario, reference_agent) for scenario in todo]
        try:
            for done, future in enumerate(as_completed(futures), start=1):
                future.result()
                progress(done, len(todo))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return len(todo)


def _make_log(scenario: Scenario, reference_agent: str) -> None:
    log = drive_reference(scenario, reference_agent).log
    if log.sha256() != scenario.log:
        raise InvalidInputError(
            f"scenario '{scenario.name}': expected log {(scenario.log or '')[:12]}, {reference_agent} now gives "
            f"{log.sha256()[:12]}: the agent, SUMO or the network has changed since the benchmark was drawn "
            f"(python -m dohyo.evaluation.authoring.draw_val14 NAME --reference {reference_agent} --pin)"
        )
    write_log(log)
