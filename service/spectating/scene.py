"""Scenes: what spectators see of a world, made in the world's process while somebody watches."""

from __future__ import annotations

import time
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from dohyo.service.running.channel import Channel, Kind
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import ActorKind, World

SCENE_S: Final = 0.1
MARGIN_M: Final = 40.0
_KINDS: Final = tuple(kind.name.lower() for kind in ActorKind)


class SceneFeed:
    """Sends the stage once and then scenes, at most one in each tenth of a second of the wall clock.

    A tick that comes too early is sent later, if the world still stands at it.
    """

    def __init__(self, channel: Channel) -> None:
        """Sends nothing until somebody watches."""
        self._channel = channel
        self._env: DrivingEnv | None = None
        self._watched = self._pending = self._staged = False
        self._next_s = 0.0
        self._lamps: NDArray[np.int64] = np.zeros(0, dtype=np.int64)

    def begin(self, env: DrivingEnv) -> None:
        """Sends the scenes of another environment from its next tick on."""
        self._env, self._pending, self._staged = env, False, False

    def watch(self, watched: bool) -> None:
        """Begins or ends to send; the stage comes first."""
        self._watched = self._pending = watched
        self._staged, self._next_s = False, 0.0

    def tick(self) -> None:
        """Notes that there is a new tick, and sends it if it is time."""
        self._pending = self._watched
        if self.due_in_s() == 0.0:
            self.send()

    def due_in_s(self) -> float | None:
        """Time until a scene has to be sent, s; None: none has to."""
        return max(0.0, self._next_s - time.monotonic()) if self._pending else None

    def send(self) -> None:
        """Sends the present tick."""
        assert self._env is not None
        world = self._env.world
        if not self._staged:
            stage, self._lamps = stage_of(world)
            self._channel.send(Kind.STAGE, msgspec.json.encode(stage))
            self._staged = True
        self._pending, self._next_s = False, time.monotonic() + SCENE_S
        self._channel.send(Kind.SCENE, msgspec.json.encode(scene_of(world, self._lamps)))


def stage_of(world: World) -> tuple[dict[str, Any], NDArray[np.int64]]:
    """What does not change in a world, in its network's frame, m.

    Returns:
        Bounds, egos with their routes, and stop lines with a light; and the signal of each of these stop lines.
    """
    routes = [route.position for route in world.routes]
    points = np.concatenate([world.egos.position, *routes])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    lines, signals = _lamps(world.network, low, high)
    egos = [
        {"name": name, "length": size[0], "width": size[1], "route": _rounded(route)}
        for name, size, route in zip(
            world.egos.names, _rounded(np.column_stack([world.egos.length, world.egos.width])), routes, strict=True
        )
    ]
    stage = {
        "dt_s": TICK_S,
        "bounds": _rounded(np.concatenate([low, high])),
        "egos": egos,
        "signals": [{"line": line} for line in _rounded(lines)],
    }
    return stage, signals


def scene_of(world: World, lamps: NDArray[np.int64]) -> dict[str, Any]:
    """What is seen in a tick.

    Args:
        world: World after the tick.
        lamps: (L,) signals of the stop lines of the stage.

    Returns:
        Egos as x, y [m], heading [rad], speed [m/s] and whether they drive; actors as key, kind, length, width, x, y,
        heading; lights as one `LightState` digit for each stop line.
    """
    egos, actors = world.egos, world.actors
    motion = _rounded(np.column_stack([egos.position, egos.heading, egos.speed]))
    boxes = _rounded(np.column_stack([actors.length, actors.width, actors.position, actors.heading]))
    return {
        "tick": world.tick,
        "time_s": round(world.time, 3),
        "egos": [[*one, active] for one, active in zip(motion, egos.active.tolist(), strict=True)],
        "actors": [
            [key, _KINDS[kind], *box]
            for key, kind, box in zip(actors.key.tolist(), actors.kind.tolist(), boxes, strict=True)
        ],
        "lights": "".join(map(str, world.signals[lamps].tolist())),
    }


def _lamps(network: RoadNetwork, low: FloatArray, high: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """(L, 4) stop lines with a light within a box, one for each signal of theirs; and the (L,) signals."""
    stop_lines = network.stop_lines
    start = stop_lines.segment[:, :2]
    near = stop_lines.lit & (start >= low).all(axis=1) & (start <= high).all(axis=1)
    found = [
        (row, signal)
        for row in np.flatnonzero(near).tolist()
        for signal in dict.fromkeys(
            network.connections.signal[
                np.array(network.connections_from(int(stop_lines.lane[row])), dtype=np.int64)
            ].tolist()
        )
        if signal >= 0
    ]
    rows, signals = np.array(found, dtype=np.int64).reshape(-1, 2).T
    return stop_lines.segment[rows], signals


def _rounded(values: FloatArray) -> Any:
    """Values to two decimals, as lists."""
    return np.round(values.astype(np.float64), 2).tolist()
