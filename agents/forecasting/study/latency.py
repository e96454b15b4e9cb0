"""Latency of one forecast: batch 1, one core, mean of 50,000 after 1,000 to warm up."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
from torch import nn

from dohyo.agents.forecasting.data.scale import InMetres, Scale
from dohyo.agents.forecasting.data.windows import HISTORY
from dohyo.agents.forecasting.exported import Exported
from dohyo.agents.forecasting.learned import write_onnx
from dohyo.agents.forecasting.networks.looking_ahead import SpeedNetwork
from dohyo.agents.forecasting.networks.registry import make_network

RUNS, WARM_UPS = 50_000, 1_000


@dataclass(frozen=True, slots=True)
class Latency:
    """Milliseconds of one call.

    Attributes:
        wall_ms: Wall-clock time, including other load of the machine.
        core_ms: Processor time.
    """

    wall_ms: float
    core_ms: float


class Ahead(nn.Module):
    """The first rows ahead of a network.

    Attributes:
        network: The network.
        rows: Number of rows.
    """

    def __init__(self, network: SpeedNetwork, rows: int) -> None:
        super().__init__()
        self.network, self.rows = network, rows

    def forward(self, history: torch.Tensor) -> torch.Tensor:
        """(B, rows, N)."""
        return self.network.ahead(history, self.rows)


def measure(call: Callable[[], object], runs: int = RUNS, warm_ups: int = WARM_UPS) -> Latency:
    """Mean of many calls."""
    for _ in range(warm_ups):
        call()
    wall, core = time.perf_counter(), time.thread_time()
    for _ in range(runs):
        call()
    return Latency(1e3 * (time.perf_counter() - wall) / runs, 1e3 * (time.thread_time() - core) / runs)


def of_network(name: str, segments: int, rows: int, runs: int = RUNS, warm_ups: int = WARM_UPS) -> dict[str, Latency]:
    """Latency of a network of `networks.registry` by rows ahead: in torch, and exported to ONNX Runtime.

    Weights are random, since they do not change the time.
    """
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    module = Ahead(make_network(name, segments).eval(), rows)
    history = torch.randn(1, HISTORY, segments)
    try:
        with torch.inference_mode():
            eager = measure(lambda: module(history), runs, warm_ups)
        with TemporaryDirectory() as folder:
            path = Path(folder) / "network.onnx"
            write_onnx(InMetres(module, Scale(25.0, 7.0)), segments, path)
            session = Exported(path).session
        speeds = {"history": np.full((HISTORY, segments), 25.0, dtype=np.float32)}
        return {"torch": eager, "onnx": measure(lambda: session.run(None, speeds), runs, warm_ups)}
    finally:
        torch.set_num_threads(threads)
