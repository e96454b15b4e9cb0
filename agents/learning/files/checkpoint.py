"""Checkpoints: the complete state of a run, written atomically."""

from __future__ import annotations

import io
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

logger = logging.getLogger(__name__)

KEPT = 2
_NAME = re.compile(r"checkpoint-(\d{12})\.pt")


def save_checkpoint(folder: Path, steps: int, state: dict[str, Any]) -> Path:
    """Writes a checkpoint, and keeps the newest two.

    Args:
        folder: Of the run.
        steps: Environment steps so far.
        state: Tensors and plain values, nested.

    Raises:
        OSError: The disk refuses; earlier checkpoints are untouched.
        UnpicklingError: The state holds something else, such as an enum's member, which no run could read again.
    """
    buffer = io.BytesIO()
    torch.save(state, buffer)
    buffer.seek(0)
    torch.load(buffer, map_location="cpu", weights_only=True)
    path = folder / f"checkpoint-{steps:012d}.pt"
    write_atomically(path, buffer.getvalue())
    for old in _checkpoints(folder)[KEPT:]:
        old.unlink(missing_ok=True)
    return path


def load_checkpoint(folder: Path) -> dict[str, Any] | None:
    """Newest complete checkpoint of a run; None without any.

    Raises:
        InvalidInputError: There are checkpoints, and all are damaged.
    """
    paths = _checkpoints(folder)
    for path in paths:
        try:
            # weights_only: a checkpoint is data, and must not be able to run code.
            state = torch.load(path, map_location="cpu", weights_only=True)
        except Exception as error:  # a damaged archive may raise anything
            logger.warning("checkpoint '%s' is damaged (%s); going back to the one before", path, type(error).__name__)
        else:
            return dict(state)
    if paths:
        raise InvalidInputError(f"every checkpoint in '{folder}' is damaged ({', '.join(path.name for path in paths)})")
    return None


def newest_step(folder: Path) -> int:
    """Steps of the newest checkpoint, by its name; 0 without any."""
    newest = [_NAME.fullmatch(path.name) for path in _checkpoints(folder)[:1]]
    return int(newest[0][1]) if newest and newest[0] else 0


def random_state() -> dict[str, Any]:
    """State of torch's generators; numpy's global one is not used."""
    state: dict[str, Any] = {"torch": torch.get_rng_state()}
    if torch.cuda.is_available():
        state["cuda"] = torch.cuda.get_rng_state_all()
    return state


def restore_random_state(state: dict[str, Any]) -> None:
    """Restores torch's generators."""
    torch.set_rng_state(state["torch"])
    if torch.cuda.is_available() and "cuda" in state:
        torch.cuda.set_rng_state_all(state["cuda"])


def generator_state(generator: np.random.Generator) -> dict[str, Any]:
    """State of a numpy generator."""
    return dict(generator.bit_generator.state)


def generator_of(state: dict[str, Any]) -> np.random.Generator:
    """Numpy generator restored from a state."""
    generator = np.random.default_rng()
    generator.bit_generator.state = state
    return generator


def _checkpoints(folder: Path) -> list[Path]:
    """Checkpoints of a folder, newest first."""
    return sorted((path for path in folder.iterdir() if _NAME.fullmatch(path.name)), reverse=True)
