"""`dohyo dataset`: makes training data."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from dohyo.agents.gri.vision.recording import AffordanceRequest, record_affordances
from dohyo.agents.hierarchical.vision.recording import PictureRequest, record_pictures
from dohyo.agents.mcts.predictors.recording import TRAINING, MotionRequest, record_motion
from dohyo.agents.priboot.recording.record import record_moments
from dohyo.agents.priboot.recording.scenarios import MomentRequest
from dohyo.service.cli.output import console
from dohyo.service.cli.progress import ended_by_sigterm
from dohyo.sumo_networks.freeway.dataset import DatasetRequest, make_dataset


def motion(
    out: Annotated[Path, typer.Option(help="Folder; existing files are kept.")],
    networks: Annotated[str, typer.Option(help="Names, separated by commas.")] = ",".join(TRAINING),
    hours: Annotated[float, typer.Option(min=0.01, help="Hours of driving, summed over all egos.")] = 2.0,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    every: Annotated[float, typer.Option(min=0.1, help="Seconds between two samples of one ego.")] = 0.5,
) -> None:
    """Records the autopilot's traffic scenes and their outcomes. Same arguments, same bytes."""
    order = MotionRequest(tuple(name.strip() for name in networks.split(",") if name.strip()), hours, seed, every)
    columns = (TextColumn("recorded"), BarColumn(), TextColumn("{task.completed:.2f} of {task.total:g} h"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task("motion", total=hours)
        samples = record_motion(order, out, lambda done: progress.update(bar, completed=done))
    console.print(f"{samples} samples: {out.resolve()}")


def semantic(
    out: Annotated[Path, typer.Option(help="Folder; existing files are kept.")],
    images: Annotated[
        int, typer.Option(min=1, help="Least number of training pictures; held-out ones are added.")
    ] = 14_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
) -> None:
    """Records semantic pictures on the autopilot's disturbed drives. Same arguments, same bytes."""
    columns = (TextColumn("driven"), BarColumn(), TextColumn("{task.percentage:.0f} %"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task("semantic", total=1.0)
        order = PictureRequest(images=images, seed=seed)
        pictures = record_pictures(order, out, lambda done: progress.update(bar, completed=done))
    console.print(f"{pictures} pictures: {out.resolve()}")


def affordances(
    out: Annotated[Path, typer.Option(help="Folder; existing episodes are kept.")],
    moments: Annotated[
        int, typer.Option(min=1, help="Number of training moments if no car arrives early; held-out ones are added.")
    ] = 4000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
) -> None:
    """Records three cameras whose pose is drawn, on the autopilot's drives. Same arguments, same bytes."""
    columns = (TextColumn("driven"), BarColumn(), TextColumn("{task.percentage:.0f} %"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task("affordances", total=1.0)
        order = AffordanceRequest(moments=moments, seed=seed)
        there = record_affordances(order, out, lambda done: progress.update(bar, completed=done))
    console.print(f"{there} moments: {out.resolve()}")


def priboot(
    out: Annotated[Path, typer.Option(help="Folder; existing episodes are kept.")],
    samples: Annotated[int, typer.Option(min=1, help="Least number of moments.")] = 30_000,
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    demonstrator: Annotated[str, typer.Option(help="Agent that drives.")] = "autopilot",
    learner: Annotated[str, typer.Option(help="ONNX policy from which it takes over, instead of noise.")] = "",
    obstacles: Annotated[
        str, typer.Option(metavar="lanes|doors", help="Obstacles of a kind on all routes, and nothing else.")
    ] = "",
) -> None:
    """Records PRIBOOT's demonstrations on disturbed drives. Same arguments, same bytes."""
    columns = (TextColumn("recorded"), BarColumn(), TextColumn("{task.completed} of {task.total} moments"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task("priboot", total=samples)
        order = MomentRequest(
            samples=samples, seed=seed, demonstrator=demonstrator, learner=learner, obstacles=obstacles
        )
        moments = record_moments(order, out, lambda done: progress.update(bar, completed=done))
    console.print(f"{moments} moments: {out.resolve()}")


def freeway(
    days: Annotated[int, typer.Option(min=0, help="Training days, simulated mesoscopically.")],
    out: Annotated[Path, typer.Option(help="Folder; existing days are kept.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of everything random.")] = 0,
    easy: Annotated[int | None, typer.Option(min=0, help="Whole test days; default: 60 for 350 training days.")] = None,
    hard: Annotated[int, typer.Option(min=0, help="Congested test mornings, simulated microscopically.")] = 4,
    mornings: Annotated[int, typer.Option(min=0, help="Congested mornings like these to learn from.")] = 0,
    probes: Annotated[float, typer.Option(min=0.001, max=1, help="Share of the vehicles that report speeds.")] = 0.15,
    workers: Annotated[int, typer.Option(min=1, help="Processes; each simulates one day at a time.")] = 1,
) -> None:
    """Simulates days of segment speeds on the freeway. Each day is written when it is complete."""
    order = DatasetRequest(days=days, easy=easy, hard=hard, mornings=mornings, seed=seed, probes=probes)
    columns = (TextColumn("driven"), BarColumn(), TextColumn("{task.completed:.2f} of {task.total} days"))
    with Progress(*columns, TimeElapsedColumn(), TimeRemainingColumn(), console=console, transient=True) as progress:
        bar = progress.add_task("freeway", total=None)

        def tell(done: int, of: int, share: float) -> None:
            progress.update(bar, completed=done + share, total=of)

        with ended_by_sigterm():
            made = make_dataset(order, out, tell, workers)
    console.print(f"{made} days made: {out.resolve()}")
