"""`dohyo train`: trains a model."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

from dohyo.service.cli.output import Json, console, print_listing
from dohyo.service.cli.own_modules import find_own_modules
from dohyo.service.cli.train_progress import progress
from dohyo.sumo_networks.errors import InvalidInputError

INTERRUPTED = 130
RUNS = Path("runs")


def train(
    name: Annotated[
        str | None, typer.Argument(help="What to train, such as 'predictor', or module:ATTRIBUTE of a trainer.")
    ] = None,
    config: Annotated[Path | None, typer.Option(help="TOML file with settings; default: the trainer's own.")] = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", help="Setting as key=value, such as ppo.clip=0.1; repeatable.")
    ] = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from the last checkpoint.")] = False,
    out: Annotated[Path | None, typer.Option(help="Folder of the run; by default runs/NAME.")] = None,
    listed: Annotated[bool, typer.Option("--list", help="List what can be trained, and the files of its run.")] = False,
    json: Json = False,
) -> None:
    """Trains a model: checkpoints, learning curves, held-out evaluations, and the actor as safetensors and ONNX."""
    if listed:
        _list(json)
        return
    if name is None:
        raise InvalidInputError("expected the name of a trainer (dohyo train --list shows them)")
    from dohyo.agents.learning.files.settings import read_settings
    from dohyo.agents.learning.runs.memory import keep_freed_memory
    from dohyo.agents.learning.runs.run import RunStoppedError, stored_config  # torch takes seconds to import
    from dohyo.agents.learning.runs.trainer import TrainRequest
    from dohyo.agents.trainers import trainer_named

    find_own_modules()
    trainer, given = trainer_named(name), list(settings or [])
    folder = out or RUNS / name.rpartition(":")[2].lower()
    if resume and config is None:
        config = stored_config(folder, name)
    resolved = read_settings(trainer.config, config, given)
    keep_freed_memory()
    try:
        with progress(name) as report:
            trained = trainer.train(resolved, TrainRequest(name, folder, resume, report))
    except RunStoppedError as error:
        print(f"dohyo: {error}; continue with: dohyo train {name} --resume --out {folder}", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from error
    console.print(f"{name}: {trained.resolve()}")


def _list(as_json: bool) -> None:
    """Prints the built-in trainers, from their table alone."""
    from dohyo.agents.trainers import TRAINERS

    rows = [{"name": name, "summary": one.summary, "writes": one.writes} for name, one in TRAINERS.items()]
    print_listing(rows, as_json)
    if not as_json:
        console.print("your own: dohyo train module:ATTRIBUTE, a Trainer; results are in runs/NAME", highlight=False)
