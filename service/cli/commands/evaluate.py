"""`dohyo evaluate`: one agent, or one for each ego, on one benchmark."""

from __future__ import annotations

import ast
import re
from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from dohyo.agents.registry import kind_of, resolve_with
from dohyo.evaluation.benchmarks.documents import find_family
from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running.executors import Executor, ProcessPool
from dohyo.evaluation.running.ray_executor import RayExecutor
from dohyo.evaluation.running.run import REST, Result, run_benchmark
from dohyo.evaluation.scores.nuplan.summary import (
    ScoredDrive,
    by_type,
    lost_drives,
    score_records,
    summarise_closed_loop,
)
from dohyo.evaluation.scores.nuplan.summary import as_document as closed_loop_document
from dohyo.evaluation.summary import as_document, summarise, summarise_cells
from dohyo.service.cli.by_agent import evaluations_of
from dohyo.service.cli.closed_loop import print_closed_loop, print_legend
from dohyo.service.cli.commands.freeway import evaluate_on_freeway
from dohyo.service.cli.commands.parking import evaluate_on_parking
from dohyo.service.cli.failures import end_driving
from dohyo.service.cli.mixed import describe_agents, parse_agents, print_meetings, scores_document
from dohyo.service.cli.output import Json, console, print_cells, print_comparison, print_error, print_json, print_part
from dohyo.service.cli.own_modules import find_own_modules
from dohyo.service.cli.progress import ProgressBar
from dohyo.service.cli.seeds import parse_seeds
from dohyo.service.policies.agent import ENTRY as POLICY
from dohyo.service.policies.agent import NAME as ONNX
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.processes import usable_processors

_WORDS: Final[Mapping[str, bool | None]] = {"true": True, "false": False, "null": None}


class Engine(StrEnum):
    """Executor of the episodes."""

    PROCESSES = "processes"
    RAY = "ray"


def evaluate(
    agent: Annotated[
        list[str],
        typer.Option(
            help="Registered name, your own module:Class, or onnx with --set path=FILE. MISSION=AGENT, given for "
            "several missions, lets each ego have its own agent; one without MISSION drives the others."
        ),
    ],
    benchmark: Annotated[str, typer.Option(help="Name, or path of a .toml file.")],
    seeds: Annotated[str | None, typer.Option(help="Such as 0,1,2 or 0-4; default: the benchmark's own.")] = None,
    only: Annotated[
        str | None, typer.Option(help="Cells or missions to drive, such as town-test.*,left-to-south; default: all.")
    ] = None,
    sample: Annotated[int | None, typer.Option(min=1, help="Number of missions to draw; always the same ones.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Processes; default: one per CPU.")] = None,
    out: Annotated[Path | None, typer.Option(help="Result folder; default: out/BENCHMARK/AGENT.")] = None,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value for the agent; repeatable.")] = None,
    deadline: Annotated[float, typer.Option(min=0.1, help="Seconds an agent may take to decide.")] = ACT_DEADLINE_S,
    reverse: Annotated[bool, typer.Option(help="Drive in reverse order; the records are the same.")] = False,
    executor: Annotated[Engine, typer.Option(help="Processes on this machine, or a Ray cluster.")] = Engine.PROCESSES,
    address: Annotated[str | None, typer.Option(help="Address of the Ray cluster; default: this machine.")] = None,
    json: Json = False,
) -> None:
    """Evaluates agents on a benchmark. Run again, it continues where it stopped.

    Exit code 1 if an agent failed as a program, or a drive was lost; a bad drive is none of these.
    """
    find_own_modules()
    family = find_family(benchmark)
    chosen = parse_seeds(seeds) if seeds is not None else None
    called = " ".join(agent)
    folder = out or Path("out") / Path(benchmark).stem / re.sub(r"[^\w.-]", "_", called)
    agents = parse_agents(agent)
    if family is not Family.DRIVING:
        given = {
            "only": only is not None,
            "sample": sample is not None,
            "deadline": deadline != ACT_DEADLINE_S and family is not Family.PARKING,
            "reverse": reverse,
            "executor": executor is Engine.RAY,
            "address": address is not None,
            "agent MISSION=AGENT": list(agents) != [REST],
        }
        _refuse_driving_options(benchmark, given)
        processes = workers or usable_processors()
        order = (called, benchmark, parse_settings(settings or []), chosen, folder, processes, json)
        if family is Family.PARKING:
            evaluate_on_parking(*order, deadline)
        else:
            evaluate_on_freeway(*order)
        return
    drivers = _drivers(agents, parse_settings(settings or []))
    with ProgressBar(f"{called} on {benchmark}", hidden=json) as bar:
        result = run_benchmark(
            benchmark,
            **drivers,
            seeds=chosen,
            only=parse_names(only) if only is not None else (),
            sample=sample,
            out=folder,
            executor=_executor(executor, workers, address),
            act_deadline_s=deadline,
            progress=lambda record, done, total: bar(done, total, _note(record)),
            preparing=lambda done, total: bar(done, total, "logs of the recorded runs"),
            reverse=reverse,
            note=print_error,
        )
    (_print_document if json else _print_tables)(result)
    end_driving(result)


def _drivers(agents: Mapping[str, str], settings: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `run_benchmark` that say who drives."""
    if list(agents) != [REST]:
        if settings:
            raise InvalidInputError("--set: expected one --agent without a mission, got agents of missions")
        return {"agents": describe_agents(agents)}
    name = agents[REST]
    entry, made_with = resolve_with(POLICY if name == ONNX else name, settings)
    return {"agents": entry, "settings": made_with, "kind": kind_of(entry, made_with)}


def _print_document(result: Result) -> None:
    """Prints the scores and every drive as one JSON document."""
    rules = result.manifest.benchmark.rules
    evaluations = evaluations_of([result])
    summary = scores_document([summarise(one.records, rules=rules) for one in evaluations], result.records)
    cells = [summarise_cells(one.records, rules=rules) for one in evaluations]
    by_cell = {"cells": {cell: as_document(one) for cell, one in cells[0].items()}} if len(cells) == 1 else {}
    part = {"part": result.part or None, "missions": result.manifest.missions}
    scored = _closed_loop_scores(result)
    closed = {"closed_loop": closed_loop_document(scored, lost_drives(result.records))} if scored else {}
    print_json(summary | part | by_cell | {"drives": _drives(result)} | closed)


def _print_tables(result: Result) -> None:
    """Prints what failed, and the scores by cell or by type of scenario."""
    rules = result.manifest.benchmark.rules
    scored = _closed_loop_scores(result)
    _print_failures(result)
    if scored:
        print_closed_loop(by_type(scored), "type")
        summary = summarise_closed_loop(scored, lost_drives(result.records))
        print_closed_loop({result.manifest.agent.name: summary}, "agent")
        print_legend()
    else:
        evaluations = evaluations_of([result])
        for one in evaluations:
            print_cells(summarise_cells(one.records, rules=rules), of=one.agent if len(evaluations) > 1 else "")
        summaries = [summarise(one.records, rules=rules) for one in evaluations]
        print_comparison(
            [replace(summary, agent=one.agent) for one, summary in zip(evaluations, summaries, strict=True)]
        )
        print_meetings(result.records)
    print_part(result.part)
    console.print(f"records in {result.paths[0].parent}")


def _refuse_driving_options(benchmark: str, given: Mapping[str, bool]) -> None:
    """Raises InvalidInputError for the first option given that only benchmarks of driving agents have."""
    for name, is_given in given.items():
        if is_given:
            raise InvalidInputError(f"--{name}: expected a benchmark of driving agents, got '{benchmark}'")


def _executor(engine: Engine, workers: int | None, address: str | None) -> Executor:
    if engine is Engine.RAY:
        return RayExecutor(address, workers)
    if address is not None:
        raise InvalidInputError("--address: only with --executor ray")
    return ProcessPool(workers or usable_processors())


def _note(record: EpisodeRecord | None) -> str:
    if record is None:
        return ""
    statuses = ", ".join(sorted({ego.status.value for ego in record.egos}))
    return f"{record.scenario.name} s{record.scenario.seed}: {statuses}"


def _closed_loop_scores(result: Result) -> list[ScoredDrive]:
    """Closed-loop scores of the drives; none of a mixed run, or where the benchmark has other ones."""
    if not result.manifest.benchmark.closed_loop or result.manifest.others:
        return []
    return score_records(zip(result.records, result.paths, strict=True))


def _print_failures(result: Result) -> None:
    """Prints one line per failed drive: record, status, reason, last infraction."""
    for record, path in zip(result.records, result.paths, strict=True):
        for ego in record.egos:
            if ego.status.completed or ego.status is Status.FINISHED:
                continue
            parts = [f"  {path.stem}: {ego.status.value}"]
            if ego.failure:
                parts.append(ego.failure)
            parts += [f"last infraction {one.kind} at {one.time_s:.1f} s" for one in ego.infractions[-1:]]
            console.print("; ".join(parts))


def _drives(result: Result) -> list[dict[str, Any]]:
    """One entry per ego of every episode."""
    return [
        {
            "scenario": record.scenario.name,
            "seed": record.scenario.seed,
            "ego": ego.name,
            "agent": ego.agent.name,
            "status": ego.status.value,
            "failure": ego.failure,
            "infractions": [infraction.model_dump(mode="json") for infraction in ego.infractions],
            "record_hash": record.record_hash,
            "record": str(path),
        }
        for record, path in zip(result.records, result.paths, strict=True)
        for ego in record.egos
    ]


def parse_names(text: str) -> list[str]:
    """Names of cells and missions from text such as "town-test.*,left-to-south"."""
    names = [name.strip() for name in text.split(",")]
    if not all(names):
        raise InvalidInputError(f"--only '{text}': expected names of cells or missions, separated by commas")
    return names


def parse_settings(pairs: list[str]) -> dict[str, Any]:
    """Settings from key=value pairs: true, false and null as in JSON, Python literals, and text otherwise."""
    settings: dict[str, Any] = {}
    for pair in pairs:
        key, equals, value = pair.partition("=")
        if not equals or not key.isidentifier():
            raise InvalidInputError(f"--set '{pair}': expected key=value")
        try:
            settings[key] = _WORDS[value] if value in _WORDS else ast.literal_eval(value)
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):  # whatever a literal's parser raises
            settings[key] = value
    return settings
