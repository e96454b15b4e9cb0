"""The freeway as an environment of agents: a forecaster, a planner, and every connected vehicle (PettingZoo, parallel).

Any of them may be a custom policy, and this folder's parts can be the others. One step is a tick of the freeway.
The planner's action counts once a minute, when a plan is published; in between it is ignored. The forecaster's counts
at once, and since all act in the same step, the planner sees it a step later. A vehicle is an agent from its departure
until it leaves the road.
"""

from __future__ import annotations

from functools import cache
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from pettingzoo import ParallelEnv

from dohyo.agents.speed_planning.acc import SEEN_M
from dohyo.agents.speed_planning.fleet import Cars
from dohyo.agents.speed_planning.planner import LOOK_AHEAD_M, PUBLISHED_EVERY_S, SpeedPlan, open_gap
from dohyo.agents.speed_planning.study.dissipation import Morning
from dohyo.agents.speed_planning.traffic_state import LaneGrid, fuse
from dohyo.sumo_networks.arrays import Float32Array, FloatArray
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.envs.env_rows import checked_actions
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.freeway.demand import draw_demand
from dohyo.sumo_networks.freeway.drivers import CONNECTED, KINDS
from dohyo.sumo_networks.freeway.measure import PingLog, SegmentFeed
from dohyo.sumo_networks.freeway.road import load_freeway
from dohyo.sumo_networks.freeway.simulation import FreewaySimulation
from dohyo.sumo_networks.freeway.world import FreewayWorld
from dohyo.sumo_networks.seeds import episode_seed

FORECASTER, PLANNER = "forecaster", "planner"
HISTORY_MINUTES = 8
FASTEST_MPS = 45.0
UNKNOWN_MPS = -1.0
"""Value in observations without a report."""
Observations = dict[str, Float32Array]


class DissipationEnv(ParallelEnv):  # type: ignore[misc]
    """A morning on the freeway.

    Agents, their observations and actions, speeds in m/s:

    * `forecaster`: (8, S) last reports of the segments, -1 for missing ones -> (S,) their present speeds.
    * `planner`: (L, X) the forecaster's last answer, or without one the last reports, fused with the pings -> (L, X)
      target speeds.
    * a vehicle, by its name: (7,) own speed, gap up to 80 m, leader's speed, the plan at 0, 200, 500 and 1000 m; then
      whether to open a gap -> (1,) desired speed; SUMO's driver model prevents collisions.

    All agents share the reward: the number of vehicles that passed into the bottleneck in the tick.
    """

    metadata: ClassVar[dict[str, Any]] = {"name": "dissipation_v0", "render_modes": []}

    def __init__(self, morning: Morning | None = None, seed: int = 0) -> None:
        """Makes the environment; `reset` starts SUMO.

        Args:
            morning: Time, and share of connected cars.
            seed: Of the traffic, unless `reset` is given one.
        """
        self.morning = Morning() if morning is None else morning
        self._seed = seed
        self._road = load_freeway("freeway")
        self._grid = LaneGrid.of(self._road)
        self._simulation: FreewaySimulation | None = None
        self.agents: list[str] = []
        self.possible_agents = self._everybody()

    @cache  # noqa: B019 - PettingZoo asks for the same object each time; an env lives as long as its spaces
    def observation_space(self, agent: str) -> spaces.Box:
        """See the class."""
        shapes = {FORECASTER: (HISTORY_MINUTES, self._road.segments), PLANNER: (self._grid.lanes, self._grid.cells)}
        if agent in shapes:
            return spaces.Box(UNKNOWN_MPS, FASTEST_MPS, shapes[agent], np.float32)
        high = np.array([FASTEST_MPS, SEEN_M, FASTEST_MPS, *[FASTEST_MPS] * len(LOOK_AHEAD_M), 1.0], dtype=np.float32)
        return spaces.Box(np.zeros_like(high), high, dtype=np.float32)

    @cache  # noqa: B019 - as above
    def action_space(self, agent: str) -> spaces.Box:
        """See the class."""
        shapes = {FORECASTER: (self._road.segments,), PLANNER: (self._grid.lanes, self._grid.cells)}
        return spaces.Box(0.0, FASTEST_MPS, shapes.get(agent, (1,)), np.float32)

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, dict[str, Any]]]:
        """Starts the morning, and runs the feed until control begins.

        Raises:
            InvalidInputError: The seed is no whole number from 0 to 2^31 - 1; nothing has changed then.
        """
        seed = self._seed if seed is None else episode_seed(seed)
        self.close()
        self._seed = seed
        self.possible_agents = self._everybody()
        self._simulation = FreewaySimulation(self.morning.scenario(self._seed), fuel=False)
        world = self._simulation.start()
        self._feed, self._pings = SegmentFeed(self._road, self._seed), PingLog()
        self._plan: SpeedPlan | None = None
        self._forecast: FloatArray | None = None
        self._gone: set[str] = set()
        while world.time_s < self.morning.start_s:
            self._notice(world)
            world = self._simulation.tick()
        self._notice(world)
        self._due_s, self._world = world.time_s, world
        self.agents = [FORECASTER, PLANNER, *self._driving(world)]
        return self._observations(), {agent: {} for agent in self.agents}

    def step(
        self, actions: dict[str, Float32Array]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """One tick.

        Raises:
            InvalidInputError: Without `reset`, or for an action of another shape or that is not finite.
        """
        if self._simulation is None or not self.agents:
            raise InvalidInputError("the environment is over: expected reset before step")
        told = {agent: self._checked(agent, action) for agent, action in actions.items() if agent in self.agents}
        self._publish(told)
        now, before = self._world, self._driving(self._world)
        world = self._simulation.tick({name: float(told[name][0]) for name in before if name in told})
        self._notice(world)
        self._world = world
        there, over = set(self._driving(world)), world.time_s >= self.morning.start_s + self.morning.duration_s
        terminated = {agent: agent not in there and agent not in (FORECASTER, PLANNER) for agent in self.agents}
        self._gone |= {agent for agent, ended in terminated.items() if ended}
        new = [name for name in self._driving(world) if name not in terminated]
        everybody = [*self.agents, *new]
        reward = float(_passed(now, world))
        observations = self._observations()
        # An agent that left still gets a last, empty observation.
        gone = [agent for agent in everybody if agent not in observations]
        nothing = {agent: np.asarray(self.observation_space(agent).low, dtype=np.float32) for agent in gone}
        self.agents = [] if over else [agent for agent in everybody if not terminated.get(agent, False)]
        return (
            {**observations, **nothing},
            dict.fromkeys(everybody, reward),
            {agent: terminated.get(agent, False) for agent in everybody},
            dict.fromkeys(everybody, over),
            {agent: {} for agent in everybody},
        )

    @property
    def world(self) -> FreewayWorld:
        """True state; there is none before `reset`."""
        return self._world

    def close(self) -> None:
        """Ends SUMO."""
        if self._simulation is not None:
            self._simulation.close()
            self._simulation = None

    def _everybody(self) -> list[str]:
        """The forecaster, the planner, and all connected vehicles that this seed's demand will bring."""
        demand = draw_demand(self._road, self.morning.scenario(self._seed))
        linked = np.flatnonzero(demand.kind == KINDS.index(CONNECTED))
        return [FORECASTER, PLANNER, *(f"v{row}" for row in linked.tolist())]

    def _driving(self, world: FreewayWorld) -> list[str]:
        """Connected vehicles that are agents: from their first moment on the mainline to their last."""
        rows = np.flatnonzero(world.connected & (world.lane >= 0))
        return [world.names[row] for row in rows.tolist() if world.names[row] not in self._gone]

    def _notice(self, world: FreewayWorld) -> None:
        self._feed.observe(world)
        self._pings.observe(world)

    def _checked(self, agent: str, action: Float32Array) -> Float32Array:
        try:
            given = checked_actions(action, self.action_space(agent).shape or (), np.float32)
        except InvalidActionError as error:
            raise InvalidInputError(f"action of '{agent}', speeds in m/s: {error}") from error
        speeds: Float32Array = np.clip(given, 0.0, FASTEST_MPS)
        return speeds

    def _publish(self, told: dict[str, Float32Array]) -> None:
        """Uses the forecaster's action, and the planner's when a plan is due."""
        if FORECASTER in told:
            self._forecast = told[FORECASTER].astype(np.float64)
        if self._world.time_s < self._due_s:
            return
        self._due_s += PUBLISHED_EVERY_S
        if PLANNER in told:
            target = told[PLANNER].astype(np.float64)
            self._plan = SpeedPlan(self._world.time_s, target, self._state(), self._grid.cell_m)

    def state_of(self, segment_mps: FloatArray) -> FloatArray:
        """(lanes, cells) present speeds, m/s: those of (S,) segments, and over them the connected vehicles' own."""
        return fuse(self._grid, self._grid.spread(segment_mps), self._pings.pings(), self._world.time_s)

    def _state(self) -> FloatArray:
        return self.state_of(last_reports(self._history()) if self._forecast is None else self._forecast)

    def _history(self) -> FloatArray:
        """(8, S) last reports, m/s, `UNKNOWN_MPS` for missing ones."""
        _, rows = self._feed.reported(self._world.time_s)
        history = np.full((HISTORY_MINUTES, self._road.segments), UNKNOWN_MPS)
        kept = rows[-HISTORY_MINUTES:]
        if len(kept):
            history[-len(kept) :] = np.nan_to_num(kept, nan=UNKNOWN_MPS)
        return history

    def _observations(self) -> Observations:
        seen: Observations = {
            FORECASTER: self._history().astype(np.float32),
            PLANNER: self._state().astype(np.float32),
        }
        cars = Cars.seen(self._world, self._plan)
        gap = np.minimum(np.maximum(cars.gap, 0.0), SEEN_M)
        leader = np.where(np.isfinite(cars.gap), np.nan_to_num(cars.leader), 0.0)
        columns = np.column_stack([cars.speed, gap, leader, cars.target, open_gap(cars.target)]).astype(np.float32)
        for name, row in zip(cars.names, np.clip(columns, 0.0, None), strict=True):
            if name not in self._gone:
                seen[name] = np.minimum(row, self.observation_space(name).high)
        return {agent: np.clip(one, UNKNOWN_MPS, None) for agent, one in seen.items()}


def last_reports(history: FloatArray | Float32Array) -> FloatArray:
    """(S,) last report of each segment in a history (M, S), m/s; `FASTEST_MPS` where there is none."""
    speeds = np.full(history.shape[1], FASTEST_MPS)
    for row in history:
        speeds = np.where(row >= 0.0, row, speeds)
    return speeds


def _passed(before: FreewayWorld, after: FreewayWorld) -> int:
    """Vehicles that crossed the start of the bottleneck between two worlds."""
    at = before.road.bottleneck_m
    short = {before.names[row] for row in np.flatnonzero((before.position_m < at) & (before.position_m > at - 100))}
    beyond = np.flatnonzero((after.position_m >= at) & (after.position_m < at + 100))
    return sum(after.names[row] in short for row in beyond)
