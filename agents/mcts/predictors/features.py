"""Inputs of the network: arrays in the ego's frame; what is learned from is padded to one size with zeros."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from dohyo.agents.mcts.predictors.dataset import FUTURE_STEP_S, FUTURE_STEPS
from dohyo.agents.mcts.predictors.idm import IdmRollout
from dohyo.agents.planning.prediction import NEAREST, STEP_S
from dohyo.agents.planning.scene import HISTORY, Scene
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.sensors.lanes import POINTS
from dohyo.sumo_networks.world import ActorKind

AGENTS = NEAREST + 1
LANES = 64
KINDS = len(ActorKind)
AGENT_ATTRIBUTES = 3 + KINDS
LANE_ATTRIBUTES = 8
TICKS = round(FUTURE_STEP_S / STEP_S)
SPEED_UNIT, LENGTH_UNIT, WIDTH_UNIT = 10.0, 5.0, 2.0

SHAPES = {
    "history": (AGENTS, HISTORY, 3),
    "history_valid": (AGENTS, HISTORY),
    "agents": (AGENTS, AGENT_ATTRIBUTES),
    "agents_valid": (AGENTS,),
    "rolled": (AGENTS, FUTURE_STEPS, 3),
    "points": (LANES, POINTS, 2),
    "lanes": (LANES, LANE_ATTRIBUTES),
    "lanes_valid": (LANES,),
}
"""The network's inputs: name and largest shape, all float32, flags as 0 and 1.

history: x, y [m], heading [rad] 1.5, 1.0, 0.5 and 0 s ago; row 0 is the ego, then its nearest 30 actors.
agents: speed [10 m/s], length [5 m], width [2 m], then one column per `world.ActorKind`.
rolled: x, y [m], heading [rad] in 0.5, 1.0, ..., 8 s by the IDM roll-out, which the network corrects.
points: the lanes nearest to the ego, pieces of at most 40 m, in driving direction [m].
lanes: width [2 m], limit [10 m/s], road, junction, crossing, the route's lane, beside the route's lane, red.
"""

_BASE = IdmRollout()


def features(scene: Scene) -> dict[str, Float32Array]:
    """The network's inputs for one scene, as long as it needs; actors and lanes beyond the nearest are left out.

    Without lanes there is one that is not valid, since ONNX Runtime does not take an empty axis everywhere.
    """
    ego, actors, lanes = scene.ego, scene.actors, scene.lanes
    seen, known = min(len(actors), NEAREST), min(len(lanes), LANES)
    out = _empty(seen + 1, max(known, 1))
    out["history"][0], out["history"][1:] = ego.history, actors.history[:seen]
    out["history_valid"][0], out["history_valid"][1:] = ego.history_valid, actors.history_valid[:seen]
    table = out["agents"]
    table[0, :3] = ego.speed / SPEED_UNIT, ego.length / LENGTH_UNIT, ego.width / WIDTH_UNIT
    table[1:, 0] = actors.speed[:seen] / SPEED_UNIT
    table[1:, 1] = actors.length[:seen] / LENGTH_UNIT
    table[1:, 2] = actors.width[:seen] / WIDTH_UNIT
    table[0, 3 + ActorKind.EGO] = 1.0
    # Another ego is a car: the network must not know which agent drives it.
    kind = np.where(actors.kind[:seen] == ActorKind.EGO, int(ActorKind.CAR), actors.kind[:seen])
    table[np.arange(1, seen + 1), 3 + kind] = 1.0
    out["agents_valid"][:] = 1.0
    forecast = _BASE.predict(scene)
    if forecast.ego is not None:
        out["rolled"][0] = forecast.ego[TICKS::TICKS]
    out["rolled"][1:] = forecast.actors[:seen, TICKS::TICKS]
    out["points"][:known] = lanes.points[:known]
    about = out["lanes"]
    about[:known, 0] = lanes.width[:known] / WIDTH_UNIT
    about[:known, 1] = lanes.limit[:known] / SPEED_UNIT
    about[np.arange(known), 2 + lanes.kind[:known]] = 1.0
    about[:known, 5] = lanes.on_route[:known] == 2
    about[:known, 6] = lanes.on_route[:known] == 1
    about[:known, 7] = lanes.red[:known]
    out["lanes_valid"][:known] = 1.0
    return out


def padded(inputs: Mapping[str, Float32Array]) -> dict[str, Float32Array]:
    """Inputs at their largest shape, so that those of several scenes can be stacked."""
    out = _empty(AGENTS, LANES)
    for name, array in inputs.items():
        out[name][: len(array)] = array
    return out


def _empty(agents: int, lanes: int) -> dict[str, Float32Array]:
    rows = {AGENTS: agents, LANES: lanes}
    return {name: np.zeros((rows[first], *rest), dtype=np.float32) for name, (first, *rest) in SHAPES.items()}
