"""`dohyo train`: trains what learns."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from service.cli.output import console

train = typer.Typer(help="Trains what learns.", no_args_is_help=True)


@train.callback()
def _group() -> None:
    """Keeps `dohyo train` a group while it has one command."""


@train.command("predictor")
def predictor(
    config: Annotated[Path, typer.Option(help="A TOML file with the fields of TrainConfig.")],
    resume: Annotated[bool, typer.Option("--resume", help="Go on from the last checkpoint.")] = False,
) -> None:
    """Trains the motion predictor, and exports it to ONNX."""
    from agents.mcts.predictors import export, train  # torch takes seconds to import

    settings = train.load_config(config)
    columns = (TextColumn("step"), BarColumn(), MofNCompleteColumn(), TextColumn("loss {task.fields[loss]:.3f} m"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task("predictor", total=settings.steps, loss=0.0)
        trained = train.train(settings, resume, lambda step, loss: progress.update(bar, completed=step, loss=loss))
    export.export(export.load_network(trained), trained.with_suffix(".onnx"))
    console.print(f"predictor: {trained.resolve()}, {trained.with_suffix('.onnx').name}", soft_wrap=True)
