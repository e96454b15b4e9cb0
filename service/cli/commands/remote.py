"""`dohyo submit`, `dohyo evaluations`, `dohyo leaderboard`: a service from the command line."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from json import dumps
from pathlib import Path
from sys import maxsize
from typing import Annotated, Any, Final, Literal

import typer
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from dohyo.evaluation.families import Family, family_for
from dohyo.evaluation.freeway.day import METRICS, DaysManifest
from dohyo.evaluation.freeway.morning import MorningsManifest
from dohyo.evaluation.parking.lot_files import LotsManifest
from dohyo.evaluation.parking.result import MEASURES
from dohyo.evaluation.records.foreign_files import check_file_name
from dohyo.evaluation.records.record import AgentInfo
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, Manifest, parse_manifest
from dohyo.evaluation.statistics import Estimate
from dohyo.service.cli.commands.evaluate import parse_settings
from dohyo.service.cli.output import DASH, SCORES, Json, console, interval, number, plain, print_json, print_rows
from dohyo.service.cli.seeds import parse_seeds
from dohyo.service.client.answers import EstimateView, EvaluationView, LeaderboardView, MetricsView, RowView
from dohyo.service.client.calls import Document
from dohyo.service.client.client import Client
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

Server = Annotated[str, typer.Option(envvar="DOHYO_SERVER", help="Address of the service.")]
Token = Annotated[str | None, typer.Option(envvar="DOHYO_TOKEN", help="Access token.")]
Which = Annotated[str, typer.Argument(help="Identifier, from `dohyo evaluations list`.", metavar="EVALUATION")]
LOCAL = "http://127.0.0.1:8000"
TITLES = (
    {one.key: f"{one.title} {one.unit}" for one in MEASURES}
    | SCORES
    | {"closed_loop": "closed loop %"}
    | {one.key: f"{one.title}, {one.unit}" for one in METRICS}
)
NOT_DONE = 1
UNRANKED: Final[Mapping[str, str]] = {
    "lost_too_many": "a run that lost more than a tenth of its drives",
    "low_throughput": "a run with fewer vehicles past the bottleneck than its benchmark asks for",
    "other_version": "a run by another version of dohyo than the others, or by several,",
    "baseline": "a baseline of the organiser",
}
PAGE = 500  # places in one answer: the most that a service gives
FIRST_BENCHMARK: Final[Mapping[Family, str]] = {
    Family.DRIVING: "quickstart",
    Family.PARKING: "parking-simple",
    Family.FREEWAY: "dissipation",
    Family.FORECASTING: "forecast-easy",
}
"""What a new submission may be tried on."""


def submit(
    agent: Annotated[str, typer.Argument(help="Its name at the service; a new name is registered.")],
    builtin: Annotated[str | None, typer.Option(help="Name of a built-in agent of the service.")] = None,
    onnx: Annotated[Path | None, typer.Option(help="ONNX file to upload.")] = None,
    remote: Annotated[bool, typer.Option("--remote", help="An agent that your own workers drive.")] = False,
    settings: Annotated[list[str] | None, typer.Option("--set", help="key=value for --builtin; repeatable.")] = None,
    track: Annotated[
        Literal["sensors", "map", "privileged"], typer.Option(help="For --onnx and --remote: sensors that it may use.")
    ] = "map",
    sensors: Annotated[str, typer.Option(help="For --onnx and --remote: its sensors, such as route,objects.")] = (
        "speedometer,route"
    ),
    control: Annotated[str, typer.Option(help="For --onnx and --remote: its control.")] = "target_speed_steering",
    description: Annotated[str, typer.Option(help="Description of a new agent.")] = "",
    server: Server = LOCAL,
    token: Token = None,
    json: Json = False,
) -> None:
    """Submits a version of an agent: built-in, an ONNX policy, or remote (driven by workers)."""
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
            made = client.submit_remote(agent, AgentInfo(name=agent, kind="remote", entry="remote", **spec))
    if json:
        print_json(made)
        return
    console.print(f"{agent}, version {made['version']}: {made['kind']}, track {made['track']}", highlight=False)
    if remote:
        console.print(f"its worker: dohyo worker --server {server} --agent {agent} --entry ...", highlight=False)
    first = FIRST_BENCHMARK[family_for(made["control"])]
    console.print(f"next: dohyo evaluations start {agent} {first} --watch", highlight=False)


def start(
    agent: Annotated[str, typer.Argument(help="Name of a submitted agent.")],
    benchmark: Annotated[str, typer.Argument(help="Name, from `dohyo benchmarks list`.")],
    version: Annotated[int | None, typer.Option(min=1, help="Version of the agent; default: the latest.")] = None,
    seeds: Annotated[str | None, typer.Option(help="Such as 0,1,2 or 0-4; default: the benchmark's own.")] = None,
    ranked: Annotated[bool, typer.Option("--ranked", help="Enter the leaderboard; a practice run never does.")] = False,
    ranking: Annotated[str | None, typer.Option(help="Enter this phase of a challenge, such as rk-9f86d081.")] = None,
    ego: Annotated[
        list[str] | None,
        typer.Option(
            metavar="MISSION=AGENT",
            help="A mixed run: another agent for the ego of this mission, such as west-1=mbappe or west-1=mbappe@2 for "
            "a version; repeatable.",
        ),
    ] = None,
    watch: Annotated[bool, typer.Option("--watch", help="Wait for the end, and print the scores.")] = False,
    server: Server = LOCAL,
    token: Token = None,
    json: Json = False,
) -> None:
    """Queues an evaluation: a practice run, which may be mixed, or a ranked one."""
    wanted = parse_seeds(seeds) if seeds is not None else None
    entered, egos = ranked or ranking is not None, parse_egos(ego or [])
    with Client(server, token) as client:
        queued = client.evaluate(
            agent, benchmark, version=version, seeds=wanted, ranked=entered, ranking=ranking, egos=egos
        )
        if watch:
            _watch(client, queued["id"], json)
        else:
            _print(queued, json)


def parse_egos(options: list[str]) -> dict[str, dict[str, Any]]:
    """Agents of single egos from options such as "west-1=mbappe" and "west-1=mbappe@2".

    Raises:
        InvalidInputError: An option has another form, or an ego has two agents.
    """
    egos: dict[str, dict[str, Any]] = {}
    for option in options:
        ego, _, name = option.partition("=")
        agent, at, version = name.partition("@")
        if not ego or not agent or (at and not version.isdecimal()):
            raise InvalidInputError(f"--ego '{option}': expected MISSION=AGENT or MISSION=AGENT@VERSION")
        if ego in egos:
            raise InvalidInputError(f"--ego '{option}': expected one agent for mission '{ego}', got two")
        egos[ego] = {"agent": agent, "version": int(version)} if at else {"agent": agent}
    return egos


def show_all(
    agent: Annotated[str | None, typer.Option(help="Only evaluations of this agent.")] = None,
    benchmark: Annotated[str | None, typer.Option(help="Only evaluations on this benchmark.")] = None,
    most: Annotated[int, typer.Option(min=1, max=200, help="Largest number of rows.")] = 20,
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
    rows = [(one["id"], _agents(one), one["benchmark"], one["status"], _done(one)) for one in found]
    print_rows(("evaluation", "agent", "benchmark", "status", "done"), rows)


def watch(evaluation: Which, server: Server = LOCAL, token: Token = None, json: Json = False) -> None:
    """Waits for an evaluation's end and prints its scores. Exit code 1 if it was not completed."""
    with Client(server, token) as client:
        _watch(client, evaluation, json)


def fetch(
    evaluation: Which,
    out: Annotated[Path | None, typer.Option(help="Result folder; default: out/BENCHMARK/AGENT.")] = None,
    server: Server = LOCAL,
    token: Token = None,
) -> None:
    """Saves an evaluation's records in a result folder, for `dohyo report`, `score` and `verify`."""
    with Client(server, token) as client:
        state = client.evaluation(evaluation)
        folder = out or _default_folder(state)
        if (folder / MANIFEST).exists():
            raise InvalidInputError(f"'{folder}' holds results already: choose another --out")
        manifest = _manifest(client.manifest(evaluation))
        paths = client.download(evaluation, folder / RECORDS)
        write_atomically(folder / MANIFEST, manifest.model_dump_json(indent=1).encode())
    match manifest:
        case MorningsManifest():
            command = "dohyo verify --signature-only RECORD"
        case DaysManifest():
            command = "dohyo verify RECORD"
        case _:
            command = f"dohyo report {folder}"
    console.print(f"{len(paths)} records in {folder} ({command})", highlight=False)


def cancel(evaluation: Which, server: Server = LOCAL, token: Token = None, json: Json = False) -> None:
    """Cancels an evaluation. Finished episodes are kept."""
    with Client(server, token) as client:
        _print(client.cancel(evaluation), json)


def resume(evaluation: Which, server: Server = LOCAL, token: Token = None, json: Json = False) -> None:
    """Queues lost and cancelled episodes again."""
    with Client(server, token) as client:
        _print(client.resume(evaluation), json)


def leaderboard(
    benchmark: Annotated[
        str | None, typer.Argument(help="Name, from `dohyo benchmarks list`; none beside --ranking.")
    ] = None,
    ranking: Annotated[
        str | None, typer.Option(help="The board of this phase of a challenge, such as rk-9f86d081.")
    ] = None,
    track: Annotated[str | None, typer.Option(help="Only agents of this track: sensors, map or privileged.")] = None,
    most: Annotated[int | None, typer.Option(min=1, help="Largest number of places; default: all.")] = None,
    server: Server = LOCAL,
    token: Token = None,
    json: Json = False,
) -> None:
    """Shows a service's leaderboard, of a benchmark or of a phase of a challenge."""
    if (benchmark is None) == (ranking is None):
        raise InvalidInputError("leaderboard: expected one of BENCHMARK, --ranking ID")
    with Client(server, token) as client:
        board = _board(partial(client.leaderboard, benchmark, track=track, ranking=ranking), most or maxsize)
    if json:
        print_json(board)
        return
    if not board["rows"]:
        _print_empty(board)
        return
    metric = board["metric"]
    teams = any(row["team"] for row in board["rows"])
    rows = [
        (
            str(row["rank"] or DASH),
            *([row["team"] or DASH] if teams else []),
            f"{row['agent']} v{row['version']}",
            row["track"],
            "verified" if row["verified"] else "remote",
            _estimate(row["scores"][metric]),
            str(row["above"]["verdict"]) if row["above"] else DASH,
            _counted(row["drives"], row["lost"]),
            str(row["runs"]),
        )
        for row in board["rows"]
    ]
    columns = ("agent", "track", "agent is", TITLES.get(metric) or str(metric), "vs above", "drives", "runs")
    print_rows(("#", *(["team"] if teams else []), *columns), rows)
    if len(rows) < board["total"]:
        console.print(f"{len(rows)} of {board['total']} places", highlight=False)
    console.print(f"ranked by {board['description']}", highlight=False)
    reasons = {row["unranked"] for row in board["rows"]}
    for reason, run in UNRANKED.items():
        if reason in reasons:
            console.print(f"{run} has no rank", highlight=False)


def _print_empty(board: LeaderboardView) -> None:
    """Says on standard error that a board has no place yet, and how to take one."""
    ranking, text = board["ranking"], "no complete ranked run yet"
    if ranking is None or ranking["state"] == "open":
        how = f"--ranking {ranking['id']}" if ranking and ranking["challenge"] else "--ranked"
        text += f": `dohyo evaluations start AGENT {board['benchmark']} {how} --watch`"
    typer.echo(plain(text), err=True)


def _board(page: Callable[..., LeaderboardView], most: int) -> LeaderboardView:
    """The first places of a board, from as many pages as they need."""
    places: list[RowView] = []
    after: str | None = None
    while True:
        board = page(limit=min(PAGE, most - len(places)), after=after)
        places += board["rows"]
        after = board["next"]
        if after is None or len(places) >= most:
            board["rows"] = places
            return board


def _watch(client: Client, evaluation: str, json: bool) -> None:
    state = client.evaluation(evaluation)  # no progress bar if this request fails
    name, status = (TextColumn(f"{{task.{field}}}", markup=False) for field in ("description", "fields[status]"))
    columns = (name, BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), status)
    with Progress(*columns, console=console, disable=json) as bar:
        title = plain(f"{_agents(state)} on {state['benchmark']}")
        task = bar.add_task(title, total=None, status="")
        for state in client.follow(evaluation):
            progress = state["progress"]
            bar.update(task, completed=progress["done"], total=progress["total"], status=plain(state["status"]))
    metrics = client.metrics(evaluation) if not state["withheld"] else None
    if json:
        print_json({"evaluation": state, "metrics": metrics})
    elif metrics is None:
        secret = "the scores of single drives are secret until the ranking ends; its board:"
        console.print(f"{secret} dohyo leaderboard --ranking {state['ranking']}")
    else:
        _print_scores(state, metrics)
    if state["status"] != "done":
        raise typer.Exit(NOT_DONE)


def _print_scores(state: EvaluationView, metrics: MetricsView) -> None:
    whole = metrics["all"]
    scores = {name: title for name, title in TITLES.items() if name in whole["scores"]}
    columns = {f"{one['agent']} v{one['version']}": one["scores"] for one in metrics["agents"]}
    columns = columns or {"mean [95 %]": whole["scores"]}
    rows = [(title, *(_estimate(one[name]) for one in columns.values())) for name, title in scores.items()]
    print_rows(("score", *columns), rows)
    _print_meetings(metrics)
    driven = f", {number(whole['km'])} km" if whole["km"] else ""  # lots have no routes
    console.print(f"{_counted(whole['drives'], whole['lost'])} drives{driven}; {state['id']}", highlight=False)
    if state["failure"]:
        console.print(state["failure"])


def _print_meetings(metrics: MetricsView) -> None:
    """Prints which agents of a mixed run drove in the same episodes."""
    rows = [
        (*(f"{one['agent']} v{one['version']}" for one in met["agents"]), str(met["episodes"]), str(met["collisions"]))
        for met in metrics["meetings"]
    ]
    if rows:
        print_rows(("agent", "met", "episodes", "collisions with each other"), rows)


def _print(state: EvaluationView, json: bool) -> None:
    if json:
        print_json(state)
    else:
        console.print(
            f"{state['id']}: {_agents(state)} on {state['benchmark']}, {state['status']}, {_done(state)}",
            highlight=False,
        )


def _default_folder(state: EvaluationView) -> Path:
    """Result folder of an evaluation; the server's names must be file names."""
    names = (str(state["benchmark"]), f"{state['agent']}-v{state['version']}")
    return Path("out", *(check_file_name(name, "the server's name of benchmark and agent") for name in names))


def _manifest(document: Document) -> Manifest | MorningsManifest | LotsManifest | DaysManifest:
    """The server's manifest, of drives, parking lots, freeway mornings or forecasts, after its checks."""
    benchmark, content = document.get("benchmark"), dumps(document).encode()
    name = "the server's manifest"
    kind = benchmark.get("kind") if isinstance(benchmark, dict) else None
    if kind == "traffic":
        return parse_manifest(content, name, MorningsManifest)
    if kind == "forecast":
        return parse_manifest(content, name, DaysManifest)
    if kind == "parking":
        return parse_manifest(content, name, LotsManifest)
    return parse_manifest(content, name, Manifest)


def _agents(state: EvaluationView | Document) -> str:
    """The agent of an evaluation, or all agents of a mixed run."""
    drivers = [state, *state["egos"].values()]
    return ", ".join(dict.fromkeys(f"{one['agent']} v{one['version']}" for one in drivers))


def _done(state: EvaluationView | Document) -> str:
    return f"{state['progress']['done']}/{state['progress']['total']}"


def _counted(drives: int, lost: int) -> str:
    """Number of drives that count; where any was lost, with that of lost ones."""
    return f"{drives} (and {lost} lost)" if lost else str(drives)


def _estimate(values: EstimateView) -> str:
    return interval(Estimate(**values))
