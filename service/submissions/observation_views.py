"""Answers of the route of observations and actions."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from dohyo.service.web.views import View

Bound = Annotated[
    Any, Field(description="Bound of all values, or nested lists of the array's shape; null where there is none.")
]
Enumerations = Annotated[
    dict[str, dict[str, int]], Field(description="Numbers by name, for each enumeration that sensors give as numbers.")
]
Rules = Annotated[str, Field(description="What an ONNX policy must be.")]


class ArrayView(View):
    """Shape, type and bounds of an array."""

    shape: Annotated[list[int], Field(description="Shape.", examples=[[80, 7]])]
    dtype: Annotated[str, Field(description="Type of the values.", examples=["float32"])]
    low: Bound
    high: Bound
    description: Annotated[str, Field(description="Columns, units and frames.")]


class SensorView(ArrayView):
    """An input of an agent."""

    name: Annotated[str, Field(description="Name of the sensor.", examples=["speedometer"])]
    track: Annotated[str, Field(description="Lowest track that may use it.", examples=["sensors"])]


class ControlView(ArrayView):
    """An action of an agent."""

    control: Annotated[str, Field(description="Name of the control.", examples=["target_speed_steering"])]


class OutputView(ControlView):
    """The output of a policy."""

    name: Annotated[str, Field(description="Name of the output in the ONNX graph.", examples=["action"])]


class InterfaceView(View):
    """Every sensor and every control."""

    rules: Rules
    sensors: Annotated[dict[str, SensorView], Field(description="Sensors by name.")]
    controls: Annotated[dict[str, ControlView], Field(description="Controls by name.")]
    enumerations: Enumerations


class ChosenInterfaceView(View):
    """Inputs and outputs of one agent."""

    track: Annotated[str, Field(description="Track of the agent.", examples=["map"])]
    rules: Rules
    inputs: Annotated[list[SensorView], Field(description="The agent's sensors, in the order asked for.")]
    outputs: Annotated[list[OutputView], Field(description="The agent's one output.")]
    enumerations: Enumerations
