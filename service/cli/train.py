"""`dohyo train`: trains a model."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from dohyo.service.cli.output import console
from dohyo.service.cli.own_modules import find_own_modules

if TYPE_CHECKING:
    from dohyo.agents.learning.report import Report

INTERRUPTED = 130
RUNS = Path("runs")


def train(
    name: Annotated[str, typer.Argument(help="What to train, such as 'predictor', or module:ATTRIBUTE of a trainer.")],
    config: Annotated[Path | None, typer.Option(help="TOML file with settings; default: the trainer's own.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="Setting as key=value, such as ppo.clip=0.1; repeatable.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the last checkpoint.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder of the run; by default runs/NAME.")] = None,
) -> None:
    """Trains a model: checkpoints, learning curves, held-out evaluations, and the actor as safetensors and ONNX."""
    from dohyo.agents.learning.registry import TrainRequest, trainer_named
    from dohyo.agents.learning.run import RunStoppedError, stored_config  # torch takes seconds to import
    from dohyo.agents.learning.settings import read_settings

    find_own_modules()
    trainer, given = trainer_named(name), list(settings or [])
    chooses_out = "out" in trainer.config.model_fields
    if chooses_out and out is not None:
        given.append(f"out='{out}'")
    folder = out or RUNS / name.rpartition(":")[2].lower()
    if resume and config is None:
        config = stored_config(folder, name)
    resolved = read_settings(trainer.config, config, given)
    folder = resolved.out if chooses_out else folder
    try:
        with _progress(name) as report:
            trained = trainer.train(resolved, TrainRequest(name, folder, resume, report))
    except RunStoppedError as error:
        print(f"dohyo: {error}; continue with: dohyo train {name} --resume --out {folder}", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from error
    console.print(f"{name}: {trained.resolve()}", soft_wrap=True)


@contextmanager
def _progress(name: str) -> Iterator[Callable[[Report], None]]:
    """Progress bar with steps, steps per second and the trained value."""
    told = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[told]}"))
    columns = (*told, TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task(name, total=None, told="")
        first: list[tuple[float, int]] = []

        def report(done: Report) -> None:
            now = time.monotonic()
            if not first:
                first.append((now, done.steps))
            rate = (done.steps - first[0][1]) / max(now - first[0][0], 1e-9)
            value = "" if done.value is None else f", {done.unit} {done.value:.3f}"
            progress.update(bar, total=done.total, completed=done.steps, told=f"{rate:.0f} steps/s{value}")

        yield report
