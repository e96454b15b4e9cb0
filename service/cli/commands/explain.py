"""`dohyo explain`: drives a recorded episode again up to one moment, and shows the agent's explanation."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from dohyo.agents.mcts.figure import draw_search
from dohyo.evaluation.agent import Agent, Explanation, Observation
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.output_file import check_output, write_output
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.store import read_trajectory, read_whole_record
from dohyo.evaluation.records.trajectory import Trajectory
from dohyo.evaluation.report.road_map import drivable_lanes
from dohyo.service.cli.output import console
from dohyo.service.cli.trust import Policy, Trust, trusted_agents
from dohyo.service.episodes.explanations import encoded
from dohyo.service.episodes.recorded_agents import close_all
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import AgentError, InvalidInputError
from dohyo.sumo_networks.scenario import Mission
from dohyo.sumo_networks.units import TICK_S


class _EnoughError(AgentError):
    """Ends a drive at the tick to explain."""


class _UpTo(Agent):
    """Wraps an agent: keeps its explanation at one tick, and ends the drive there."""

    def __init__(self, agent: Agent, tick: int) -> None:
        self.agent, self.spec, self.tick = agent, agent.spec, tick
        self.why: Explanation | None = None
        self._now = 0

    def warm_up(self) -> None:
        self.agent.warm_up()

    def reset(self, mission: Mission, seed: int) -> None:
        self.agent.reset(mission, seed)

    def act(self, observation: Observation) -> np.ndarray:
        action = self.agent.act(observation)
        if self._now == self.tick:
            self.why = self.agent.explain()
            raise _EnoughError("the moment to explain has come")
        self._now += 1
        return action

    def close(self) -> None:
        self.agent.close()


def explain(
    record: Annotated[Path, typer.Argument(help="A record, NAME.json.")],
    time: Annotated[float, typer.Option(help="Seconds since the egos started.", min=0.0)],
    out: Annotated[Path | None, typer.Option(help="Page with the picture (.html); default: JSON to stdout.")] = None,
    ego: Annotated[str | None, typer.Option(help="Name of the ego, if the record has several.")] = None,
    policy: Policy = None,
    trust: Trust = False,
) -> None:
    """Explains an agent's decision at one moment of a record, as JSON or as a picture of the search."""
    if out is not None:
        check_output(out)
    old, tick = read_whole_record(record), round(time / TICK_S)
    name = _which(old, ego)
    why, trajectory = _redriven(old, name, tick, record, trusted_agents(old, record, trust, policy))
    if why is None:
        raise InvalidInputError(f"'{record}': the agent of '{name}' has no explanation at {time:g} s")
    if out is None:
        print(json.dumps(json.loads(encoded(why)), indent=1))
        return
    agent = next(one.agent.name for one in old.egos if one.name == name)
    if "nodes" not in why:
        raise InvalidInputError(f"'{record}': agent '{agent}' has no search to draw; leave out --out")
    index = [one.name for one in old.egos].index(name)
    boxes = _boxes(trajectory, tick, index)
    title = f"{agent} on {old.scenario.name}, seed {old.scenario.seed}, at {tick * TICK_S:.1f} s"
    figure = draw_search(why, boxes[0, :3].tolist(), drivable_lanes(old.scenario.network), boxes, title)
    write_output(out, figure.to_html(include_plotlyjs=True, full_html=True).encode())
    console.print(f"explanation: {out.resolve()}")


def _which(record: EpisodeRecord, ego: str | None) -> str:
    names = [one.name for one in record.egos]
    if ego is None and len(names) == 1:
        return names[0]
    if ego not in names:
        raise InvalidInputError(f"expected --ego to be one of {', '.join(names)}, got {ego}")
    return ego


def _redriven(
    old: EpisodeRecord, name: str, tick: int, path: Path, agents: Mapping[str, Agent]
) -> tuple[Explanation | None, Trajectory]:
    """Explanation at a tick, and the trajectories until then, checked against the record."""
    wrapped = {other: _UpTo(agent, tick) for other, agent in agents.items()}
    try:
        _, trajectory = drive_episode(old.scenario, wrapped, infos={one.name: one.agent for one in old.egos})
    finally:
        close_all(agents.values())
    last = int(trajectory.tick.max())
    if last < tick:
        raise InvalidInputError(f"'{path}' ends at {last * TICK_S:.1f} s, before {tick * TICK_S:g} s")
    _must_agree(trajectory, path, tick)
    return wrapped[name].why, trajectory


def _must_agree(trajectory: Trajectory, path: Path, tick: int) -> None:
    recorded = read_trajectory(path)
    here, there = trajectory.tick == tick, recorded.tick == tick
    same = here.sum() == there.sum() and all(
        np.array_equal(getattr(trajectory, column)[here], getattr(recorded, column)[there])
        for column in ("key", "x", "y", "heading")
    )
    if not same:
        raise InvalidInputError(f"'{path}': at {tick * TICK_S:g} s the new drive differs from the recorded one")


def _boxes(trajectory: Trajectory, tick: int, ego: int) -> FloatArray:
    """(N, 5) boxes of all vehicles and pedestrians at a tick, the ego first."""
    rows = np.flatnonzero(trajectory.tick == tick)
    first = rows[trajectory.key[rows] == -1 - ego]
    rows = np.concatenate([first, rows[trajectory.key[rows] != -1 - ego]])
    columns = ("x", "y", "heading", "length", "width")
    return np.column_stack([getattr(trajectory, column)[rows] for column in columns]).astype(np.float64)
