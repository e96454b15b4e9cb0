"""Value network: features of a state, and three layers that give its value. Numba, no allocation."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file

from dohyo.agents.mcts.config import DT, HORIZON_S, Rules
from dohyo.agents.mcts.kernels import kernel
from dohyo.agents.mcts.simulator import (
    ACCELERATION,
    DEMAND,
    HEADING,
    LATERAL,
    OFF_ROAD,
    SPEED,
    STEERING,
    S,
    at_row,
    leader,
)
from dohyo.agents.planning.motion import Body
from dohyo.agents.planning.situation import Situation
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError

SHIPPED = Path(__file__).parents[1] / "checkpoints" / "value.safetensors"
FEATURES, WIDTH = 24, 32
NEAR_M = 10.0
"""A distance d enters as d / (d + 10 m)."""
FREE_MPS = 13.9
"""Speed used without a leader."""
AHEAD_M = (0.0, 10.0, 25.0, 50.0)
LATER_S = (0.0, 2.0, 4.0)


class Mlp(NamedTuple):
    """Weights, F features and H units wide, and memory for one evaluation.

    Attributes:
        first: (H, F).
        first_bias: (H,).
        second: (H, H).
        second_bias: (H,).
        last: (1, H).
        last_bias: (1,).
        features: (F,) memory.
        hidden: (2, H) memory.
    """

    first: FloatArray
    first_bias: FloatArray
    second: FloatArray
    second_bias: FloatArray
    last: FloatArray
    last_bias: FloatArray
    features: FloatArray
    hidden: FloatArray


SHAPES = {
    "first": (WIDTH, FEATURES),
    "first_bias": (WIDTH,),
    "second": (WIDTH, WIDTH),
    "second_bias": (WIDTH,),
    "last": (1, WIDTH),
    "last_bias": (1,),
}


def no_value() -> Mlp:
    """Network whose output is always 0."""
    return _with_memory({name: np.zeros(shape) for name, shape in SHAPES.items()})


def load_value(path: Path = SHIPPED) -> Mlp:
    """A trained network.

    Raises:
        InvalidInputError: The file is missing, damaged, or of another network.
    """
    return _with_memory(_weights(path))


@lru_cache(maxsize=4)
def _weights(path: Path) -> dict[str, FloatArray]:
    try:
        found = load_file(path)
    except FileNotFoundError as error:
        raise InvalidInputError(f"no value network '{path}' (dohyo train value)") from error
    except (OSError, SafetensorError) as error:
        raise InvalidInputError(f"value network '{path}' is damaged: {error}") from error
    shapes = {name: array.shape for name, array in found.items()}
    if shapes != SHAPES:
        raise InvalidInputError(f"'{path}' is no value network: expected the arrays {SHAPES}, got {shapes}")
    if not all(np.isfinite(array).all() for array in found.values()):
        raise InvalidInputError(f"value network '{path}' holds NaN or infinity")
    return {name: array.astype(np.float64) for name, array in found.items()}


def _with_memory(weights: dict[str, FloatArray]) -> Mlp:
    return Mlp(**weights, features=np.zeros(FEATURES), hidden=np.zeros((2, WIDTH)))


@kernel
def evaluate(mlp: Mlp) -> float:
    """Output of the network for the features in its memory."""
    _layer(mlp.first, mlp.first_bias, mlp.features, mlp.hidden[0])
    _layer(mlp.second, mlp.second_bias, mlp.hidden[0], mlp.hidden[1])
    out = mlp.last_bias[0]
    for i in range(mlp.last.shape[1]):
        out += mlp.last[0, i] * mlp.hidden[1, i]
    return float(out)


@kernel
def _layer(weights: FloatArray, bias: FloatArray, values: FloatArray, out: FloatArray) -> None:
    for i in range(weights.shape[0]):
        total = bias[i]
        for j in range(weights.shape[1]):
            total += weights[i, j] * values[j]
        out[i] = max(total, 0.0)


@kernel
def value_of(mlp: Mlp, road: Situation, car: Body, rules: Rules, state: FloatArray, time: float) -> float:
    """Return from a state to the horizon; bounded by 1 per second.

    Args:
        mlp: The network.
        road: The situation.
        car: The vehicle.
        rules: The numbers.
        state: (10,) see `simulator.STATE`.
        time: From now, s.
    """
    describe(road, car, rules, state, time, mlp.features)
    return min(evaluate(mlp), rules.depth * rules.hold_steps * DT - time)


@kernel
def describe(road: Situation, car: Body, rules: Rules, state: FloatArray, time: float, out: FloatArray) -> None:
    """Writes the features of a state.

    Time left; speed, accelerations, wheel; place on the path; limit, and the speed that is allowed here and farther on;
    the closed line; the leader now and later, if the ego stayed where it is; what stopping needs of the way there.

    Args:
        road: The situation.
        car: The vehicle.
        rules: The numbers.
        state: (10,) see `simulator.STATE`.
        time: From now, s.
        out: (24,) all of them about 1.
    """
    s, speed, side = state[S], state[SPEED], state[LATERAL]
    row = at_row(road, s)
    error = state[HEADING] - math.atan2(road.path[row, 3], road.path[row, 2])
    out[0], out[1], out[2] = 1.0 - time / HORIZON_S, speed / 10.0, state[DEMAND] / 3.0
    out[3], out[4], out[5] = state[ACCELERATION] / 3.0, state[STEERING] / 0.3, math.sin(error)
    out[6], out[7], out[8] = side, abs(side), state[OFF_ROAD]
    out[9], out[10] = road.limit[row] / 10.0, min(road.half_width[row] - 1.6, 1.0)
    for i in range(len(AHEAD_M)):
        out[11 + i] = road.allowed[at_row(road, s + AHEAD_M[i])] / 10.0
    to_line = road.line - s - 0.5 * car.length
    open_m = to_line if to_line > 0.0 else math.inf
    out[15] = _near(open_m)
    least = open_m
    for i in range(len(LATER_S)):
        gap, their = leader(
            road, 0.5 * car.length, 0.5 * car.width + rules.margin_across, s, time + LATER_S[i], side
        )  # fmt: skip
        out[16 + 2 * i] = _near(gap)
        out[17 + 2 * i] = (their if gap < math.inf else FREE_MPS) / 10.0
        if i == 0:
            least = min(least, gap + their * their / (2.0 * rules.braking))
    out[22] = min(speed * speed / (2.0 * rules.braking) / (max(least, 0.0) + 1.0), 3.0)
    out[23] = (rules.depth * rules.hold_steps * DT - time) * min(speed / max(road.limit[row], 1.0), 1.0) / HORIZON_S


@kernel
def _near(distance: float) -> float:
    return 1.0 if distance == math.inf else max(distance, 0.0) / (max(distance, 0.0) + NEAR_M)
