"""Trainings that are killed: at a random moment, and compared to the bit with one that was not.

    whole = killed_and_resumed("gymnasium", ["algorithm=sac", ...], tmp_path)

A run's folder is what is compared: the checkpoints, and with them weights, optimisers, labels and generators; the
memory map of a replay, its frames included; demonstrations, tables and policies. Times and commands may differ.
"""

from __future__ import annotations

import json
import random
import shutil
import signal
import struct
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import torch
from safetensors import safe_open

from dohyo.agents.learning.files.card import CARDS
from dohyo.agents.learning.files.checkpoint import newest_step
from dohyo.agents.learning.files.report import Report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.trainers import trainer_named
from tests.agents.learning.exporting import WITHOUT_ONNX, without_onnx
from tests.forked import MAIN, Python

OF_THE_SESSION = {"run.json", "timing.csv", CARDS, ".lock"}
"""Files that name hosts, times and commands."""
TIME = "wall_s"
TRIES = 5


def killed_and_resumed(
    name: str, settings: Sequence[str], folder: Path, seed: int | None = None, *, onnx: bool = True
) -> Path:
    """Trains in two folders, of which one is killed and resumed, and compares them; returns the other one.

    What is killed is a process of its own. The others train here, where they need not load anything.

    Args:
        name: Of the trainer, as `dohyo train` has it.
        settings: Each "key=value"; for at least two checkpoints.
        folder: An empty one.
        seed: Of the moment, which comes after the first checkpoint; None: a new one.
        onnx: Whether policies are also exported as ONNX models; else their weights alone are compared.
    """
    with nullcontext() if onnx else without_onnx():
        return _killed_and_resumed(name, settings, folder, seed, MAIN if onnx else WITHOUT_ONNX + MAIN)


def _killed_and_resumed(name: str, settings: Sequence[str], folder: Path, seed: int | None, program: str) -> Path:
    whole, out = folder / "whole", folder / "killed"
    left_s = _trained(name, settings, whole, resume=False)
    seed = random.randrange(2**31) if seed is None else seed
    share = random.Random(seed).random()
    for _ in range(TRIES):
        process = Python(program, "train", name, "--out", str(out), *(f"--set={setting}" for setting in settings))
        process.wait_for(lambda: saved(out))
        time.sleep(share * left_s)
        if process.end(signal.SIGKILL) == -signal.SIGKILL and newest_step(out) < newest_step(whole):
            break
        shutil.rmtree(out)  # it was faster than the other one, and had nothing left to do
        share /= 2.0
    else:
        raise AssertionError(f"{name} ended before it was killed, {TRIES} times")
    print(f"{name}: killed {share * left_s:.3f} s after its first checkpoint, by the seed {seed}")
    _trained(name, settings, out, resume=True)
    found = different(whole, out)
    assert not found, f"{name} ended otherwise, in {len(found)} places: {', '.join(found[:10])}"
    return whole


def _trained(name: str, settings: Sequence[str], folder: Path, *, resume: bool) -> float:
    """Trains in this process; returns what it took after the first checkpoint, s."""
    seen: list[float] = []

    def report(_: Report) -> None:
        if not seen and saved(folder):
            seen.append(time.monotonic())

    trainer = trainer_named(name)
    trainer.train(read_settings(trainer.config, None, settings), TrainRequest(name, folder, resume, report))
    ended = time.monotonic()
    return ended - (seen[0] if seen else ended)


def saved(folder: Path) -> bool:
    """Whether a run has a checkpoint."""
    return folder.exists() and newest_step(folder) > 0


def different(one: Path, other: Path) -> list[str]:
    """What of two runs' folders is not the same to the bit: files, and parts of checkpoints, weights and results."""
    files = [
        {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} - OF_THE_SESSION
        for folder in (one, other)
    ]
    return sorted(files[0] ^ files[1]) + [
        f"{name}{place}" for name in sorted(files[0] & files[1]) for place in _different(one / name, other / name)
    ]


def _different(one: Path, other: Path) -> list[str]:
    if one.suffix not in (".pt", ".safetensors") and one.name != "result.json":
        return [] if one.read_bytes() == other.read_bytes() else [""]
    mine, others = (dict(_bits(_content(path))) for path in (one, other))
    return [f": {place}" for place in sorted(mine.keys() | others.keys()) if mine.get(place) != others.get(place)]


def _content(path: Path) -> Mapping[str, Any]:
    """What a file holds, without its time."""
    if path.suffix == ".json":
        found = json.loads(path.read_text())
    elif path.suffix == ".pt":
        found = torch.load(path, weights_only=True)
    else:
        with safe_open(path, "pt") as file:
            found = {"facts": file.metadata(), **{name: file.get_tensor(name) for name in file.keys()}}  # noqa: SIM118
    return {name: value for name, value in found.items() if name != TIME}


def _bits(value: Any, place: str = "") -> Iterator[tuple[str, bytes | str]]:
    """Every tensor and plain value, by its place."""
    if isinstance(value, Mapping):
        for name, part in value.items():
            yield from _bits(part, f"{place}.{name}" if place else str(name))
    elif isinstance(value, list | tuple):
        for number, part in enumerate(value):
            yield from _bits(part, f"{place}[{number}]")
    elif isinstance(value, torch.Tensor):
        yield place, f"{value.dtype} {tuple(value.shape)} ".encode() + value.contiguous().numpy().tobytes()
    else:
        yield place, struct.pack("d", value) if isinstance(value, float) else repr(value)
