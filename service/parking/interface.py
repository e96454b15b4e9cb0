"""The interface of an agent that parks: what a policy or a worker sees and decides, one for each kart."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from gymnasium.spaces import Box

from dohyo.evaluation.families import PARKING_CONTROL
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.errors import InvalidInputError

if TYPE_CHECKING:
    from dohyo.sumo_networks.parking.observation import State  # loads numba

TRACK: Final = "sensors"
_STATES: Final[Mapping[str, State]] = {"parking-v1": "v1", "parking-v2": "v2", "parking-oriented": "oriented"}
SENSORS: Final = tuple(_STATES)
"""An agent that parks has exactly one of these; see `dohyo.sumo_networks.parking.observation`."""
POLICY: Final = "dohyo.service.parking.policy:OnnxParker"
"""Entry of an uploaded policy that parks."""
INPUT: Final = "observation"
"""Input of an ONNX policy, as `dohyo train parking` exports it."""
ACTION_SHAPE: Final = (3,)
_ROW: Final = re.compile(r"^\| (\d+)(?:-(\d+))? \| (.+) \|$", re.MULTILINE)
"""A row of the table of columns in `dohyo.sumo_networks.parking.observation`."""


def check_parker(track: str, sensors: Sequence[str]) -> None:
    """Checks the declaration of an agent that parks; a policy or a worker cannot be shown the whole lot.

    Raises:
        InvalidInputError: It has another track, or other sensors.
    """
    if track != TRACK or len(sensors) != 1 or sensors[0] not in SENSORS:
        raise InvalidInputError(
            f"control '{PARKING_CONTROL}' is that of an agent that parks: expected track '{TRACK}' and one of the "
            f"sensors {list(SENSORS)}, got track '{track}' and {list(sensors)}"
        )


def check_action(action: np.ndarray) -> np.ndarray:
    """An action, each value moved into [-1, 1].

    Raises:
        InvalidActionError: A wrong shape, or a value that is not finite.
    """
    if np.shape(action) != ACTION_SHAPE or not np.isfinite(action).all():
        raise InvalidActionError(f"expected 3 finite numbers, got {np.asarray(action).tolist()!r:.80}")
    return np.asarray(np.clip(action, -1.0, 1.0))


def observation_shape(sensor: str) -> tuple[int, ...]:
    """Shape of a sensor of `SENSORS`."""
    return tuple(_observation(sensor).shape)


def sensor_documents() -> dict[str, dict[str, Any]]:
    """Every sensor of parking, as plain JSON."""
    from dohyo.sumo_networks.parking import observation

    return {
        name: {
            "name": name,
            "track": TRACK,
            "shape": list(observation_shape(name)),
            "dtype": "float32",
            "low": -float(observation.HIGHEST),
            "high": float(observation.HIGHEST),
            "description": _columns_of(name),
        }
        for name in SENSORS
    }


def _columns_of(sensor: str) -> str:
    """The table of the observation's columns with the numbers that they have in a sensor, in Markdown."""
    from dohyo.sumo_networks.parking import observation

    kept = observation.columns(state_of(sensor)).tolist()
    rows = []
    for first, last, rest in _ROW.findall(observation.__doc__ or ""):
        numbers = [own for own, column in enumerate(kept) if int(first) <= column <= int(last or first)]
        if numbers:
            rows.append(f"| {numbers[0]}{f'-{numbers[-1]}' * (len(numbers) > 1)} | {rest} |")
    head = "| columns | meaning | scale |\n|---|---|---|"
    return "\n".join((f"Observation of a kart, one float32 per column ({len(kept)}).\n\n{head}", *rows))


def control_document() -> dict[str, Any]:
    """The control of parking, as plain JSON."""
    from dohyo.sumo_networks.parking.observation import action_space

    return {
        "control": PARKING_CONTROL,
        "shape": list(ACTION_SHAPE),
        "dtype": "float32",
        "low": -1.0,
        "high": 1.0,
        "description": action_space.__doc__ or "",
    }


def state_of(sensor: str) -> State:
    """State of a sensor of `SENSORS`."""
    return _STATES[sensor]


def _observation(sensor: str) -> Box:
    from dohyo.sumo_networks.parking.observation import observation_space  # loads numba

    return observation_space(state_of(sensor))
