"""Interface: required inputs and outputs of a policy, for the checks, the sandbox and the published document."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from typing import Any

import numpy as np
from gymnasium.spaces import Box

from dohyo.evaluation.agent import AgentSpec
from dohyo.evaluation.families import FORECASTING_CONTROL, PARKING_CONTROL, PLANNING_CONTROL
from dohyo.service.forecasting import interface as forecasting
from dohyo.service.freeway import planner as planning
from dohyo.service.parking.interface import (
    ACTION_SHAPE,
    INPUT,
    check_parker,
    control_document,
    observation_shape,
    sensor_documents,
)
from dohyo.service.parking.interface import SENSORS as PARKING_SENSORS
from dohyo.service.wire.enumerations import enumeration_documents
from dohyo.sumo_networks.ego.control import CONTROLS, make_control
from dohyo.sumo_networks.ego.dynamics import VehicleParameters
from dohyo.sumo_networks.errors import UnknownNameError
from dohyo.sumo_networks.sensors import SENSORS, Track, make_sensors
from dohyo.sumo_networks.units import TICK_S

ACTION = "action"
STATE, NEXT_STATE = "state_", "next_state_"
RULES = (
    "One input per sensor, named like it, of its shape and element type; a leading dimension of 1 is allowed. "
    "One output 'action' of the control's shape, float32, likewise. A policy that remembers has inputs 'state_NAME', "
    "float32, of a fixed shape, each with an output 'next_state_NAME' of the same shape; they are zeros at the start "
    "of every episode. Random operators draw the same numbers in every episode. Operators of the domains ai.onnx and "
    "ai.onnx.ml; all weights inside the file. A policy that parks has one sensor, and its input is named "
    "'observation'. A policy that forecasts has the sensor 'history' alone, whose number of segments may be dynamic, "
    "and its output is named 'forecast'."
)


@dataclass(frozen=True, slots=True)
class Tensor:
    """One input or output.

    Attributes:
        name: Name in the ONNX graph.
        shape: Shape without a leading batch dimension.
        dtype: "float32" or "uint8".
        open_end: Whether a model may leave its last dimension dynamic.
    """

    name: str
    shape: tuple[int, ...]
    dtype: str
    open_end: bool = False


def expected_inputs(spec: AgentSpec) -> tuple[Tensor, ...]:
    """One input per sensor, in the spec's order.

    Raises:
        UnknownNameError: A sensor is unknown.
        InvalidInputError: The track does not permit a sensor.
    """
    if spec.control == PARKING_CONTROL:
        check_parker(spec.track, spec.sensors)
        return (Tensor(INPUT, observation_shape(spec.sensors[0]), "float32"),)
    if spec.control == FORECASTING_CONTROL:
        forecasting.check_forecaster(spec.track, spec.sensors)
        shapes = {forecasting.SENSORS[0]: forecasting.history_shape(), forecasting.SENSORS[1]: (1,)}
        return tuple(Tensor(name, shapes[name], "float32", open_end=True) for name in spec.sensors)
    if spec.control == PLANNING_CONTROL:
        planning.check_planner(spec.track, spec.sensors)
        return (Tensor(planning.STATE, planning.plan_shape(), "float32"),)
    sensors = make_sensors(spec.sensors, Track[spec.track.upper()])
    return tuple(Tensor(sensor.name, tuple(sensor.space.shape), _dtype(sensor.space)) for sensor in sensors)


def expected_action(spec: AgentSpec) -> Tensor:
    """The output that holds the action.

    Raises:
        UnknownNameError: The control is unknown.
    """
    if spec.control == PARKING_CONTROL:
        return Tensor(ACTION, ACTION_SHAPE, "float32")
    if spec.control == FORECASTING_CONTROL:
        return Tensor(forecasting.OUTPUT, forecasting.forecast_shape(), "float32", open_end=True)
    if spec.control == PLANNING_CONTROL:
        return Tensor(ACTION, planning.plan_shape(), "float32")
    return Tensor(ACTION, tuple(_control(spec.control)[0].shape), "float32")


def observation_spec(spec: AgentSpec) -> dict[str, Any]:
    """Inputs and output of a policy of a spec, as plain JSON.

    Raises:
        InvalidInputError: An unknown name, or a sensor above the track.
    """
    expected_inputs(spec)
    return {
        "track": spec.track,
        "rules": RULES,
        "inputs": [_sensor_document(name) for name in spec.sensors],
        "outputs": [_control_document(spec.control) | {"name": expected_action(spec).name}],
        "enumerations": enumeration_documents(),
    }


def published_spec() -> dict[str, Any]:
    """Every sensor and every control interface, as plain JSON."""
    return {
        "rules": RULES,
        "sensors": {name: _sensor_document(name) for name in (*SENSORS, *_OTHER_SENSORS)},
        "controls": {name: _control_document(name) for name in (*CONTROLS, *_OTHER_CONTROLS)},
        "enumerations": enumeration_documents(),
    }


_OTHER_SENSORS = (*PARKING_SENSORS, *forecasting.SENSORS, planning.STATE)
_OTHER_CONTROLS = (PARKING_CONTROL, FORECASTING_CONTROL, PLANNING_CONTROL)
"""Sensors and controls of the families whose agents drive no cars."""


def _sensor_document(name: str) -> dict[str, Any]:
    if name in PARKING_SENSORS:
        return sensor_documents()[name]
    if name in forecasting.SENSORS:
        return forecasting.sensor_documents()[name]
    if name == planning.STATE:
        return planning.sensor_document()
    (sensor,) = make_sensors([name])
    return {
        "name": name,
        "track": sensor.track.name.lower(),
        **_space_document(sensor.space),
        "description": inspect.getdoc(type(sensor)) or "",
    }


def _control_document(name: str) -> dict[str, Any]:
    if name == PARKING_CONTROL:
        return control_document()
    if name == FORECASTING_CONTROL:
        return forecasting.control_document()
    if name == PLANNING_CONTROL:
        return planning.control_document()
    space, description = _control(name)
    return {"control": name, **_space_document(space), "dtype": "float32", "description": description}


def _control(name: str) -> tuple[Box, str]:
    """Space and docstring of a control interface."""
    if name not in CONTROLS:
        raise UnknownNameError("control", name, CONTROLS)
    control = make_control(name, VehicleParameters(), TICK_S)
    return control.space, inspect.getdoc(type(control)) or ""


def _space_document(space: Box) -> dict[str, Any]:
    return {
        "shape": list(space.shape),
        "dtype": _dtype(space),
        "low": _bound(space.low),
        "high": _bound(space.high),
    }


def _bound(values: np.ndarray) -> Any:
    """One number where all are equal, nested lists otherwise; None for an unbounded value."""
    if values.size and (values == values.flat[0]).all():
        values = values.flat[0]
    return np.where(np.isfinite(values), values, np.array(None)).tolist()


def _dtype(space: Box) -> str:
    return "uint8" if space.dtype == np.uint8 else "float32"
