"""`dohyo submit`, `dohyo evaluations`, `dohyo leaderboard`: a service from the command line."""

from __future__ import annotations

import time
from collections.abc import Mapping
from json import dumps
from pathlib import Path
from typing import Annotated, Any, Literal

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.running.run import MANIFEST, RECORDS
from dohyo.evaluation.statistics import Estimate
from dohyo.service.calls import Document
from dohyo.service.cli.evaluate import parse_seeds, parse_settings
from dohyo.service.cli.output import DASH, SCORES, Json, console, interval, number, print_json, print_rows
from dohyo.service.client import ENDED, POLL_S, Client
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

Server = Annotated[str, typer.Option(envvar="DOHYO_SERVER", help="Address of the service.")]
Token = Annotated[str | None, typer.Option(envvar="DOHYO_TOKEN", help="What one may do there.")]
Which = Annotated[str, typer.Argument(help="As `dohyo evaluations list` shows it.", metavar="EVALUATION")]
LOCAL = "http://127.0.0.1:8000"
TITLES = SCORES | {"closed_loop": "closed loop %"}
NOT_DONE = 1


def submit(
    agent: Annotated[str, typer.Argument(help="Its name at the service; registered there where it is new.")],
    builtin: Annotated[str | None, typer.Option(help="An agent that comes with the service.")] = None,
    onnx: Annotated[Path | None, typer.Option(help="A policy to upload.")] = None,
    remote: Annotated[bool, typer.Option("--remote", help="One that workers of yours will drive.")] = False,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value for --builtin; repeatable.")] = None,
    track: Annotated[
        Literal["sensors", "map", "privileged"], typer.Option(help="Of --onnx and --remote: what it may see.")
    ] = "map",
    sensors: Annotated[str, typer.Option(help="Of the same: what it sees, such as route,objects.")] = (
        "speedometer,route"
    ),
    control: Annotated[str, typer.Option(help="Of the same: what its action means.")] = "target_speed_steering",
    description: Annotated[str, typer.Option(help="Of an agent that is new.")] = "",
    server: Server = LOCAL,
    token: Token = None,
    json: Json = False,
) -> None:
    """Submits a version of an agent: a built-in one, an ONNX policy, or one that drives from elsewhere."""
    if (builtin is not None) + (onnx is not None) + remote != 1:
        raise InvalidInputError("submit: expected one of --builtin NAME, --onnx FILE, --remote")
    spec: dict[str, Any] = {"track": track, "sensors": sensors.replace(" ", "").split(","), "control": control}
    with Client(server, token) as client:
        if onnx is not None and not onnx.is_file():
            raise InvalidInputError(f"--onnx: no file '{onnx}'")
        client.ensure_agent(agent, description)
        if builtin is not None:
            made = client.submit_builtin(agent, builtin, parse_settings(settings or []))
        elif onnx is not None:
            made = client.submit_onnx(agent, onnx, spec)
        else:
            made = client.submit_remote(agent, AgentInfo(name=agent, entry="remote", **spec))
    if json:
        print_json(made)
        return
    console.print(f"{agent}, version {made['version']}: {made['kind']}, track {made['track']}", highlight=False)
    if remote:
        console.print(f"its worker: dohyo worker --server {server} --agent {agent} --entry ...", highlight=False)
    console.print(f"next: dohyo evaluations start {agent} quickstart --watch", highlight=False)


def start(
    agent: Annotated[str, typer.Argument(help="A submitted one.")],
    benchmark: Annotated[str, typer.Argument(help="As `dohyo benchmarks list` shows it.")],
    version: Annotated[int | None, typer.Option(min=1, help="Of the agent; default: the latest.")] = None,
    seeds: Annotated[str | None, typer.Option(help="Such as 0,1,2 or 0-4; default: the benchmark's own.")] = None,
    watch: Annotated[bool, typer.Option("--watch", help="Wait for the end, and print the scores.")] = False,
    server: Server = LOCAL,
    token: Token = None,
    json: Json = False,
) -> None:
    """Queues an evaluation."""
    wanted = parse_seeds(seeds) if seeds is not None else None
    with Client(server, token) as client:
        queued = client.evaluate(agent, benchmark, version=version, seeds=wanted)
        if watch:
            _watch(client, queued["id"], json)
        else:
            _print(queued, json)


def show_all(
    agent: Annotated[str | None, typer.Option(help="Only this one's.")] = None,
    benchmark: Annotated[str | None, typer.Option(help="Only on this one.")] = None,
    most: Annotated[int, typer.Option(min=1, max=200, help="How many at most.")] = 20,
    server: Server = LOCAL,
    token: Token = None,
    json: Json = False,
) -> None:
    """Lists evaluations, the newest first."""
    with Client(server, token) as client:
        found = client.get("/v1/evaluations", agent=agent, benchmark=benchmark, limit=most)["items"]
    if json:
        print_json(found)
        return
    rows = [
        (one["id"], f"{one['agent']} v{one['version']}", one["benchmark"], one["status"], _done(one)) for one in found
    ]
    print_rows(("evaluation", "agent", "benchmark", "status", "done"), rows)


def watch(evaluation: Which, server: Server = LOCAL, token: Token = None, json: Json = False) -> None:
    """Waits until an evaluation has ended, and prints its scores; exit code 1 where it was not completed."""
    with Client(server, token) as client:
        _watch(client, evaluation, json)


def fetch(
    evaluation: Which,
    out: Annotated[Path | None, typer.Option(help="Result folder; default: out/BENCHMARK/AGENT.")] = None,
    server: Server = LOCAL,
    token: Token = None,
) -> None:
    """Saves its records as `dohyo evaluate` would have: for `dohyo report`, `score` and `verify`."""
    with Client(server, token) as client:
        state = client.evaluation(evaluation)
        folder = out or Path("out") / state["benchmark"] / f"{state['agent']}-v{state['version']}"
        if (folder / MANIFEST).exists():
            raise InvalidInputError(f"'{folder}' holds results already; choose another --out")
        paths = client.download(evaluation, folder / RECORDS)
        write_atomically(folder / MANIFEST, dumps(client.manifest(evaluation), indent=1).encode())
    console.print(f"{len(paths)} records in {folder} (dohyo report {folder})", highlight=False, soft_wrap=True)


def cancel(evaluation: Which, server: Server = LOCAL, token: Token = None, json: Json = False) -> None:
    """Ends an evaluation; its finished episodes stay."""
    with Client(server, token) as client:
        _print(client.cancel(evaluation), json)


def resume(evaluation: Which, server: Server = LOCAL, token: Token = None, json: Json = False) -> None:
    """Drives again what was lost or cancelled."""
    with Client(server, token) as client:
        _print(client.resume(evaluation), json)


def leaderboard(
    benchmark: Annotated[str, typer.Argument(help="As `dohyo benchmarks list` shows it.")],
    track: Annotated[str | None, typer.Option(help="Only this one: sensors, map or privileged.")] = None,
    server: Server = LOCAL,
    token: Token = None,
    json: Json = False,
) -> None:
    """Shows who drives best at a service."""
    with Client(server, token) as client:
        board = client.leaderboard(benchmark, track=track)
    if json:
        print_json(board)
        return
    metric = board["metric"]
    rows = [
        (
            str(row["rank"]),
            f"{row['agent']} v{row['version']}",
            row["track"],
            _estimate(row["scores"][metric]),
            str(row["above"]["verdict"]) if row["above"] else DASH,
            str(row["drives"]),
        )
        for row in board["rows"]
    ]
    print_rows(("#", "agent", "track", TITLES.get(metric) or str(metric), "vs above", "drives"), rows)
    console.print(f"ranked by {board['description']}", highlight=False, markup=False)


def _watch(client: Client, evaluation: str, json: bool) -> None:
    state = client.evaluation(evaluation)  # not before there is one shall a bar be seen
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, TextColumn("{task.fields[status]}"), console=console, disable=json) as bar:
        task = bar.add_task(f"{state['agent']} v{state['version']} on {state['benchmark']}", total=None, status="")
        while True:
            progress = state["progress"]
            bar.update(task, completed=progress["done"], total=progress["total"], status=state["status"])
            if state["status"] in ENDED:
                break
            time.sleep(POLL_S)
            state = client.evaluation(evaluation)
    metrics = client.metrics(evaluation)
    if json:
        print_json({"evaluation": state, "metrics": metrics})
    else:
        _print_scores(state, metrics)
    if state["status"] != "done":
        raise typer.Exit(NOT_DONE)


def _print_scores(state: Document, metrics: Document) -> None:
    whole = metrics["all"]
    scores = {name: title for name, title in TITLES.items() if name in whole["scores"]}
    print_rows(("score", "mean [95 %]"), [(title, _estimate(whole["scores"][name])) for name, title in scores.items()])
    console.print(f"{whole['drives']} drives, {number(whole['km'])} km; {state['id']}", highlight=False)
    if state["failure"]:
        console.print(state["failure"], markup=False)


def _print(state: Document, json: bool) -> None:
    if json:
        print_json(state)
    else:
        console.print(
            f"{state['id']}: {state['agent']} v{state['version']} on {state['benchmark']}, {state['status']},"
            f" {_done(state)}",
            highlight=False,
        )


def _done(state: Document) -> str:
    return f"{state['progress']['done']}/{state['progress']['total']}"


def _estimate(values: Mapping[str, Any]) -> str:
    return interval(Estimate(**values))
