"""PRIBOOT's network on a device: milliseconds of a batch, and per decision of it.

    python -m tests.performance.priboot cuda        # a GPU
    python -m tests.performance.priboot cpu         # one core, in torch; the shipped file runs in ONNX Runtime

The weights are random, since they change no time. Pictures come from the host's memory and waypoints go back to it.
"""

from __future__ import annotations

import sys
import time
from statistics import median

import torch

from dohyo.agents.priboot.measurements import MEASUREMENTS
from dohyo.agents.priboot.network import Priboot

BATCHES, ROUNDS = (1, 8, 32, 128), 30


def batch_ms(network: Priboot, count: int, device: torch.device) -> float:
    """Median over rounds, after three to warm up, ms."""
    picture = torch.randint(0, 256, (count, *network.trunk.shape), dtype=torch.uint8)
    measurements, rounds = torch.randn(count, MEASUREMENTS), []
    for _ in range(ROUNDS + 3):
        began = time.perf_counter()
        seen = {"picture": picture.to(device), "measurements": measurements.to(device)}
        with torch.inference_mode():
            network(seen).cpu()
        rounds.append(1e3 * (time.perf_counter() - began))
    return median(rounds[3:])


def main(name: str) -> None:
    """Prints a line per size of a batch."""
    torch.set_num_threads(1)
    device = torch.device(name)
    print(torch.cuda.get_device_name(device) if device.type == "cuda" else "one core")
    network = Priboot(weights="random").eval().to(device)
    for count in BATCHES:
        took = batch_ms(network, count, device)
        print(f"batch of {count:>3}: {took:6.2f} ms, {took / count:6.3f} ms per decision")


if __name__ == "__main__":
    main(*sys.argv[1:] or ["cpu"])
