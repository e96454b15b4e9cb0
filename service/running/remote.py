"""RemoteAgent: an agent whose decisions come from a policy worker at the other end of a channel."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from typing import Literal

import numpy as np

from dohyo.evaluation.agent import Agent, AgentSpec, Mission, Observation
from dohyo.evaluation.episode.runner import Watch, drive_episode
from dohyo.evaluation.records.store import write_record
from dohyo.service.running.channel import FORMATS, SEEN, Channel, Fault, Kind
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.wire.actions import checked_action
from dohyo.service.wire.messages import decode, encode_observations
from dohyo.sumo_networks.ego.control import InvalidActionError, make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import AgentError, AgentTimeoutError, DohyoError, InvalidInputError
from dohyo.sumo_networks.sensors import Track, make_sensors
from dohyo.sumo_networks.units import TICK_S

NO_LIMIT_S = 86_400.0


FAULTS: dict[Fault, type[AgentError]] = {
    Fault.RAISED: AgentError,
    Fault.INVALID_ACTION: InvalidActionError,
    Fault.TIMEOUT: AgentTimeoutError,
}


class Bridge:
    """Lockstep with one worker, which decides for all egos of the episode.

    The server owns the deadlines: it knows whether a silent worker still lives. Here, `wait` waits for as long as it
    takes, and `realtime` for at most one tick.

    Attributes:
        missed: Ticks without a decision.
        clipped: Actions with a value out of range, which was moved to the nearest bound.
    """

    def __init__(
        self,
        channel: Channel,
        names: Mapping[str, str],
        shape: tuple[int, ...],
        check: Callable[[np.ndarray], np.ndarray],
        slow_policy: Literal["wait", "realtime"],
    ) -> None:
        """Creates the lockstep before a worker holds the episode.

        Args:
            channel: Channel to the server.
            names: Name of each ego on the wire.
            shape: Shape of an action.
            check: Returns an action within its bounds, or raises an error for an invalid one.
            slow_policy: Whether to wait for a slow worker or to repeat its last decision.
        """
        self._channel, self._realtime, self._check = channel, slow_policy == "realtime", check
        self._names, self._shape, self._granted = names, shape, False
        self._fault: AgentError | None = None
        self._deciding: tuple[str, ...] = ()
        self._actions: dict[str, np.ndarray] = {}
        self._shown, self._decided = 0.0, True
        self.missed = self.clipped = 0

    def show(self, tick: int, observations: dict[str, Observation], time_s: float | None = None) -> None:
        """Sends a tick to the worker; the first tick waits until a worker holds the episode.

        Args:
            tick: Number of the tick, from 0.
            observations: Observations by ego.
            time_s: Simulated time of the tick; None: 0.1 s per tick.
        """
        time_s = round(tick * TICK_S, 3) if time_s is None else time_s
        seen = {self._names[ego]: observation for ego, observation in observations.items()}
        head = SEEN.pack(tick, time_s, self.missed, self.clipped)
        self._channel.send(Kind.SEEN, head + encode_observations(seen))
        self._deciding, self._decided = tuple(seen), False
        while not self._granted:
            frame = self._channel.receive()
            self._granted = frame is not None and frame[0] is Kind.GRANT
        self._shown = time.monotonic()

    def decision(self, ego: str) -> np.ndarray:
        """The worker's action for an ego in the tick last sent.

        Raises:
            AgentError: The worker's agent has failed.
        """
        if not self._decided:
            self._decide()
        if self._fault is not None:
            raise self._fault
        return self._actions[self._names[ego]]

    def _decide(self) -> None:
        self._decided = True
        waits = not self._realtime or not self._actions
        while self._fault is None:
            left = None if waits else self._shown + TICK_S - time.monotonic()
            frame = self._channel.receive(left)
            if frame is None:
                self.missed += 1
                return
            if self._take(*frame):
                return

    def _take(self, kind: Kind, payload: bytes) -> bool:
        """Whether a frame holds the decision for the tick."""
        if kind is Kind.FAULT:
            fault, text = json.loads(payload)
            self._fault = FAULTS[Fault(fault)](text)
            return True
        if kind is not Kind.ACTIONS:
            return False
        try:
            self._actions = self._checked(decode(payload[1:], FORMATS[payload[0]]))
        except DohyoError as error:
            return self._refuse(str(error))
        except Exception as error:  # no bytes of a worker may look like a fault of the simulation, which costs nothing
            return self._refuse(f"expected actions, got what cannot be read: {type(error).__name__}: {error}")
        return True

    def _refuse(self, why: str) -> Literal[False]:
        self._channel.send(Kind.REFUSED, why[:1000].encode(errors="replace"))
        return False

    def _checked(self, actions: object) -> dict[str, np.ndarray]:
        if not isinstance(actions, dict) or not all(ego in actions for ego in self._deciding):
            given = sorted(map(str, actions))[:10] if isinstance(actions, dict) else type(actions).__name__
            raise InvalidInputError(f"expected an action for each of {list(self._deciding)}, got {given}")
        if unknown := sorted(set(map(str, actions)) - set(self._names.values())):
            raise InvalidInputError(f"expected actions of {list(self._deciding)} only, got {unknown[:10]} too")
        decided = {ego: checked_action(ego, actions[ego], self._shape, self._check) for ego in self._deciding}
        self.clipped += sum(clipped for _, clipped in decided.values())
        return {ego: action for ego, (action, _) in decided.items()}


class RemoteAgent(Agent):
    """One ego that a worker drives."""

    def __init__(self, bridge: Bridge, spec: AgentSpec, ego: str) -> None:
        self.spec, self._bridge, self._ego = spec, bridge, ego

    def reset(self, mission: Mission, seed: int) -> None:
        """Does nothing: the worker knows mission and seed from its lease."""

    def act(self, observation: Observation) -> np.ndarray:
        """The worker's action for the observation that it has already received."""
        return self._bridge.decision(self._ego)

    def close(self) -> None:
        """Does nothing: the agent holds no resources."""


def drive_remotely(order: EpisodeOrder, channel: Channel, watch: Watch) -> bytes:
    """Drives an order in lockstep with a worker and writes its record.

    Args:
        order: Order to drive.
        channel: Channel to the server.
        watch: Called before and after every decision; see `Gauge.watch_worker`.

    Returns:
        The last tick, as `SEEN`.

    Raises:
        InvalidInputError: The order cannot be driven.
    """
    info, scenario = order.info, order.job.scenario
    spec = AgentSpec(name=info.name, track=info.track, sensors=info.sensors, control=info.control)
    make_sensors(spec.sensors, Track[spec.track.upper()])
    control = make_control(spec.control, VehicleParameters(), TICK_S)
    bridge = Bridge(channel, order.wire_names, tuple(control.space.shape), control.checked, order.slow_policy)
    agents = {mission.name: RemoteAgent(bridge, spec, mission.name) for mission in order.missions}
    record, trajectory = drive_episode(
        scenario,
        agents,
        infos=dict.fromkeys(agents, info),
        benchmark=order.benchmark,
        act_deadline_s=NO_LIMIT_S,
        watch=watch,
        show=bridge.show,
    )
    if order.slow_policy == "realtime" and record.timing is not None:
        timing = record.timing.model_copy(update={"realtime": True, "missed": bridge.missed})
        record = record.model_copy(update={"timing": timing})
    write_record(order.directory, order.stem, record, trajectory)
    return SEEN.pack(record.ticks, round(record.ticks * TICK_S, 3), bridge.missed, bridge.clipped)
