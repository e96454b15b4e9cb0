"""Run: the folder of one training, from the first step to the last, over any number of sessions.

config.toml        the resolved configuration
run.json           every session: commit, versions, host, device
metrics.csv        one row per round; evaluations.csv: one per evaluation; timing.csv: wall-clock times
tensorboard/       the same as events
checkpoint-*.pt    the newest two
best.*, policy.*   the actor of the best and of the last evaluation: .safetensors and .onnx
card.json          the origin of both
result.json        the outcome
"""

from __future__ import annotations

import json
import re
import signal
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Generic, TypeVar

import torch

from dohyo.agents.learning.files.card import UNKNOWN, Card, digest, weights_of, write_card
from dohyo.agents.learning.files.checkpoint import load_checkpoint, save_checkpoint
from dohyo.agents.learning.files.command import typed
from dohyo.agents.learning.files.metrics import Board, Number, Table
from dohyo.agents.learning.files.settings import as_toml, differences, read_settings
from dohyo.agents.learning.files.surroundings import surroundings
from dohyo.agents.learning.runs.config import BaseRunConfig, RunConfig
from dohyo.evaluation.running.lock import held
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError
from dohyo.sumo_networks.files import write_atomically

FREE = frozenset({"steps", "checkpoint_s", "tensorboard"})
_SCRAP = re.compile(r"\..+\.\d+\.[0-9a-f]{8}\.tmp")
"""Names of files that `files.staged` has begun."""


class RunStoppedError(DohyoError):
    """A run was stopped, and has written its checkpoint."""


C_co = TypeVar("C_co", bound=BaseRunConfig, covariant=True)


class Run(Generic[C_co]):
    """A run's folder, held by one process at a time."""

    def __init__(
        self, trainer: str, folder: Path, config: C_co, resume: bool = False, free: frozenset[str] = FREE
    ) -> None:
        """Makes the folder, or resumes it; the first table makes the run exist.

        Args:
            trainer: Name in the registry.
            folder: Of the run.
            config: Resolved.
            resume: Continue from the newest checkpoint, or from the beginning without one.
            free: Settings that may change when the run is resumed, since no step so far depends on them.

        Raises:
            InvalidInputError: The folder holds a run and `resume` is False; or it holds none, or one of another
                trainer or configuration, or another process trains in it.
        """
        self.trainer, self.folder, self.config, self.device = trainer, folder, config, device_of(config.device)
        self._check(resume, free)
        self._held = ExitStack()
        self._held.enter_context(held(folder))
        for scrap in folder.rglob(".*.tmp"):
            if _SCRAP.fullmatch(scrap.name):  # left by a session that was killed during a write
                scrap.unlink()
        self.state = load_checkpoint(folder) if resume else None
        self.steps_before: int = self.state["steps"] if self.state else 0
        self._earlier_s: float = self.state["wall_s"] if self.state else 0.0
        self._began = time.monotonic()
        sessions = json.loads((folder / "run.json").read_text())["sessions"] if resume else []
        session = {"from_steps": self.steps_before, "device": str(self.device), **surroundings()}
        self._sessions: list[dict[str, Any]] = [*sessions, session]
        self._tables: dict[str, Table] = {}
        self._board = Board(None, 0)

    @property
    def wall_s(self) -> float:
        """Time spent so far, over all sessions, s."""
        return self._earlier_s + time.monotonic() - self._began

    def add_table(self, name: str, columns: Sequence[str], known: int | None = None) -> None:
        """Opens NAME.csv.

        Args:
            name: Of the table.
            columns: Beside "steps".
            known: In a resumed run, steps of the last row before its checkpoint; None: the checkpoint's.
        """
        if not self._tables:
            self._begin()
        keep = None
        if self.state is not None:
            keep = self.steps_before if known is None else known
        self._tables[name] = Table(self.folder / f"{name}.csv", columns, keep)

    def log(self, name: str, steps: int, values: Mapping[str, Number]) -> None:
        """Adds a row to a table, and the same values as events."""
        self._tables[name].add(steps, values)
        self._board.add(name, steps, values)

    def save(self, steps: int, state: dict[str, Any]) -> None:
        """Writes a checkpoint; the rows before it are on the disk first."""
        for table in self._tables.values():
            table.sync()
        save_checkpoint(self.folder, steps, state | {"steps": steps, "wall_s": self.wall_s})

    def write_json(self, name: str, document: object) -> None:
        """Writes a JSON file atomically."""
        write_atomically(self.folder / name, (json.dumps(document, indent=1, ensure_ascii=False) + "\n").encode())

    def write_card(
        self, model: str, subject: str, steps: int, metrics: Mapping[str, Number], data: Path | None = None
    ) -> None:
        """Writes the card of MODEL.safetensors and MODEL.onnx in the folder.

        Args:
            model: Name of the files.
            subject: What it was trained for.
            steps: Of its training.
            metrics: Results of its evaluation.
            data: Folder of its data set, if it learned from one.
        """
        commits = tuple(dict.fromkeys(one["commit"] for one in self._sessions if one["commit"]))
        card = Card(
            files=weights_of(self.folder, model),
            subject=subject,
            trainer=self.trainer,
            command=typed(self._sessions[0]["command"]),
            commits=commits or UNKNOWN,
            uncommitted=any(one["uncommitted"] for one in self._sessions) if commits else UNKNOWN,
            config=self.config.model_dump(mode="json"),
            data_sha256=None if data is None else digest(data),
            seed=self.config.seed,
            steps=steps,
            device=str(self.device),
            tier=self.config.tier,
            metrics=dict(metrics),
        )
        write_card(self.folder, model, card)

    def close(self) -> None:
        """Releases the folder."""
        for table in self._tables.values():
            table.close()
        self._board.close()
        self._held.close()

    def _begin(self) -> None:
        """Makes the run exist. What cannot be trained has failed before, so that its folder can be used again."""
        self.write_json("run.json", {"trainer": self.trainer, "seed": self.config.seed, "sessions": self._sessions})
        self._board = Board(self.folder / "tensorboard" if self.config.tensorboard else None, self.steps_before)
        write_atomically(self.folder / "config.toml", as_toml(self.config).encode())

    def _check(self, resume: bool, free: frozenset[str]) -> None:
        stored = stored_config(self.folder, self.trainer)
        if not resume and stored is not None:
            raise InvalidInputError(f"'{self.folder}' holds a run; continue with --resume, or choose another --out")
        if resume and stored is None:
            raise InvalidInputError(f"no run in '{self.folder}' to continue")
        if stored is not None and (changed := differences(read_settings(type(self.config), stored), self.config, free)):
            raise InvalidInputError(f"the run in '{self.folder}' was started with {'; '.join(changed)}")


TaskRun = Run[RunConfig]
"""Run on a task's environments."""


def stored_config(folder: Path, trainer: str) -> Path | None:
    """Configuration of the run in a folder; None without a run.

    Raises:
        InvalidInputError: The run is of another trainer.
    """
    stored = folder / "config.toml"
    if not stored.exists():
        return None
    if (other := json.loads((folder / "run.json").read_text())["trainer"]) != trainer:
        raise InvalidInputError(f"the run in '{folder}' is of '{other}', not of '{trainer}'")
    return stored


class Stop:
    """Whether the process was asked to end.

    Attributes:
        requested: Set by the first SIGINT or SIGTERM; the second one ends the process at once.
    """

    def __init__(self) -> None:
        self.requested = False

    @contextmanager
    def listening(self) -> Iterator[Stop]:
        """Installs signal handlers, which is possible only in the main thread."""
        try:
            before = {name: signal.signal(name, self._hear) for name in (signal.SIGINT, signal.SIGTERM)}
        except ValueError:
            before = {}
        try:
            yield self
        finally:
            for name, handler in before.items():
                signal.signal(name, handler)

    def _hear(self, number: int, frame: FrameType | None) -> None:
        if self.requested:
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)
        self.requested = True


def device_of(name: str) -> torch.device:
    """Available device.

    Raises:
        InvalidInputError: The device is not available.
    """
    if name == "auto":
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        device = torch.device(name)
        torch.zeros(1, device=device)
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise InvalidInputError(f"device '{name}' cannot be used: {str(error).splitlines()[0]}") from error
    return device
