"""PolicyLimits: size and resources of one uploaded policy."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dohyo.sumo_networks.scenario import Config

MEGABYTE = 1_000_000


class PolicyLimits(Config):
    """Size and resources of one policy; the defaults are the service's.

    Attributes:
        file_mb: Size of the .onnx file.
        nodes: Number of operators, including subgraphs and functions.
        state_values: Number of values in all recurrent states.
        memory_mb: Address space of its process, about 250 MB of which are Python, numpy and onnxruntime.
        cpu_s: Processor time of its process; a process serves one episode.
        load_s: Wall-clock limit for loading the model, s.
        decision_s: Wall-clock limit of one decision, s.
    """

    file_mb: Annotated[float, Field(gt=0, le=1000)] = 50.0
    nodes: Annotated[int, Field(gt=0)] = 10_000
    state_values: Annotated[int, Field(gt=0)] = 1_000_000
    memory_mb: Annotated[int, Field(ge=512)] = 2048
    cpu_s: Annotated[int, Field(gt=0)] = 1800
    load_s: Annotated[float, Field(gt=0)] = 20.0
    decision_s: Annotated[float, Field(gt=0)] = 5.0
