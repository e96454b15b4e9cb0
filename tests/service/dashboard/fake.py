"""A service that serves real episodes of two agents from files: what the dashboard reads, and no more.

Its numbers are made by the same pure functions as the real ones; only database, queue and drives are missing.
"""

from __future__ import annotations

import asyncio
import gzip
import json
from collections import Counter
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from fastapi import FastAPI, HTTPException, Request
from starlette.responses import JSONResponse, Response, StreamingResponse

from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.service.accounts.views import MeView
from dohyo.service.benchmarks.views import BenchmarkView
from dohyo.service.boards.board import compare_places
from dohyo.service.boards.comparison import compare_entries
from dohyo.service.boards.leaderboard import Contender, Entry, Ranks, places_of
from dohyo.service.boards.results import facts_of
from dohyo.service.boards.views import ComparedView, LeaderboardView
from dohyo.service.dashboard import challenge_pages, pages
from dohyo.service.dashboard.session import SessionCookie, show_errors_as_pages
from dohyo.service.episodes.reading_views import EpisodeDetail, InfractionsView
from dohyo.service.episodes.views import AttemptView, EpisodeView
from dohyo.service.evaluations.metrics import as_document as metrics_document
from dohyo.service.evaluations.metrics_views import MetricsView
from dohyo.service.evaluations.scoring import Drive, summary_of
from dohyo.service.evaluations.views import EvaluationView
from dohyo.service.league.routes import league
from dohyo.service.league.views import LeagueView
from dohyo.service.submissions.views import AgentView, SubmissionView
from dohyo.service.web.views import Page

DATA = Path(__file__).parent / "data"
CSP = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; connect-src 'self'; "
    "form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
SEARCH = {
    "plan": [1, 3],
    "nodes": [
        {"node": 1, "n": 5, "failed": False, "trajectory": [[0.0, 0.0], [4.0, 0.0]]},
        {"node": 2, "n": 2, "failed": True, "trajectory": [[0.0, 0.0], [4.0, 2.0]]},
        {"node": 3, "n": 1, "failed": False, "trajectory": [[4.0, 0.0], [8.0, 1.0]]},
    ],
}
VERSION = "3f9c" + "0" * 60
BENCHMARKS = [
    BenchmarkView(
        name=name, version=VERSION, description=description, kind="driving", headline=Headline.DRIVING_SCORE,
        metric="driving score: RC times IP", rules="2.0",
        networks=["ingolstadt"], cells=["all"], egos=[], scenarios=6, seeds=[0, 1, 2],
    )
    for name, description in (("quickstart", "Six drives through a signalised junction"), ("nocrash", "Two towns"))
]  # fmt: skip
WHEN = datetime(2026, 3, 1, 14, 5, tzinfo=UTC)
TOKEN = "a-token-that-is-good"


@cache
def stored(name: str) -> Any:
    """The content of a file of data/."""
    return json.loads(gzip.decompress((DATA / f"{name}.json.gz").read_bytes()))


@dataclass
class Fake:
    """What the service knows.

    Attributes:
        records: Episodes by id, such as "reckless-right-to-south-s0".
        queued: Ids of episodes of evaluation "ev-live" that are not done.
        lost: Number of lost drives of every evaluation, by cell.
        attempts: Those of the episodes that were started more than once, by the episode's id.
        empty: Whether to know nothing at all.
        second: Whether the reckless agent has a second version.
        explained: Whether the reasons of an episode have been found out.
        events: Server-sent events of "ev-live", in their order.
    """

    records: dict[str, EpisodeRecord] = field(default_factory=dict)
    queued: list[str] = field(default_factory=list)
    lost: dict[str, int] = field(default_factory=dict)
    attempts: dict[str, list[AttemptView]] = field(default_factory=dict)
    empty: bool = False
    second: bool = False
    explained: bool = False
    events: list[dict[str, Any]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for document in stored("records"):
            record = EpisodeRecord.model_validate(document)
            agent, scenario = record.egos[0].agent.name, record.scenario
            self.records[f"{agent}-{scenario.name}-s{scenario.seed}"] = record
        self.queued = [name for name in self.records if name.startswith("autopilot")][4:]

    def agents(self) -> list[str]:
        return [] if self.empty else ["autopilot", "reckless"]

    def drives(self, agent: str, *, lost: bool = False) -> tuple[Drive, ...]:
        """Drives that count, or those of gridlocked episodes."""
        return tuple(
            Drive(name, record.scenario.name, record.scenario.cell, record.scenario.seed, facts)
            for name, record in self.records.items()
            if name.startswith(agent) and record.lost == lost
            for facts in summary_of(record, "2.0")["egos"]
        )

    def entry(self, name: str) -> Entry:
        """Of an agent, or of a version of it, such as "reckless@2"."""
        agent, _, version = name.partition("@")
        gridlocked = self.drives(agent, lost=True)
        return Entry(
            f"ev-{name}", f"su-{name}", agent, int(version or 1), "lab", "builtin",
            "map" if agent == "autopilot" else "privileged", "quickstart", VERSION, (0, 1), WHEN, self.drives(agent),
            Counter(self.lost) + Counter(drive.cell for drive in gridlocked), gridlocked=gridlocked,
            dohyo_versions=("0.2.0",),
        )  # fmt: skip

    def evaluation(self, name: str) -> EvaluationView:
        live = name == "ev-live"
        agent, _, version = ("autopilot" if live else name.removeprefix("ev-")).partition("@")
        if agent not in self.agents():
            raise HTTPException(404, f"no evaluation '{name}'")
        rows, entry = self.episodes(name), self.entry(agent)
        return EvaluationView(
            id=name, owner="lab", agent=agent, version=int(version or 1), kind=entry.kind, track=entry.track,
            benchmark="quickstart", benchmark_version=VERSION, seeds=[0, 1], slow_policy="wait", act_deadline_s=10.0,
            ranking="rk-0", withheld=False, egos={}, dohyo_versions=["0.2.0"],
            status="running" if live and self.queued else "done", failure=None,
            progress={"total": len(rows)} | Counter(row.status.value for row in rows),
            created=WHEN, started=WHEN, finished=None if live else WHEN + timedelta(minutes=3),
        )  # fmt: skip

    def episodes(self, name: str) -> list[EpisodeView]:
        agent = "autopilot" if name == "ev-live" else name.removeprefix("ev-").partition("@")[0]
        return [self.episode(one, name) for one in self.records if one.startswith(agent)]

    def episode(self, name: str, evaluation: str) -> EpisodeDetail:
        record = self.records[name]
        waits = evaluation == "ev-live" and name in self.queued
        return EpisodeDetail(
            id=name, evaluation=evaluation, position=list(self.records).index(name), scenario=record.scenario.name,
            cell=record.scenario.cell, seed=record.scenario.seed, attempts=len(self.attempts.get(name, "1")),
            failure=None, started=WHEN, finished=WHEN,
            status="done" if not waits else "running" if name == self.queued[0] else "queued",
            record_hash=None if waits else record.record_hash, summary=None if waits else summary_of(record, "2.0"),
            agent=record.egos[0].agent.name, agent_version=1, egos={},
            benchmark="quickstart", benchmark_version=VERSION, rules="2.0", network=record.scenario.network,
        )  # fmt: skip

    def infractions(self, name: str) -> InfractionsView:
        found = [
            {"episode": one.id, "scenario": one.scenario, "seed": one.seed, "cell": one.cell, "network": "ingolstadt",
             "ego": ego["name"]} | mark
            for one in self.episodes(name) for ego in (one.summary or {"egos": []})["egos"] for mark in ego["marks"]
        ]  # fmt: skip
        return InfractionsView(evaluation=name, networks=["ingolstadt"], infractions=found)


def board_rows(entries: list[Entry], metric: str = "driving_score") -> list[dict[str, Any]]:
    """Rows of a board, as the service makes them from its tables."""
    facts = {one.evaluation: facts_of(one, metric) for one in entries}
    contenders = [
        Contender(
            evaluation=one.evaluation, entrant=one.submission, baseline=False, track=one.track, number=1,
            dohyo_versions=one.dohyo_versions,
            score=one.scores[metric].mean or 0.0,
            values=np.array(facts[one.evaluation]["values"], dtype=np.float64),
        ) for one in entries
    ]  # fmt: skip
    places = Ranks().rank(places_of(contenders))
    by_id = {one.evaluation: one for one in entries}
    rows: list[dict[str, Any]] = []
    for index, place in enumerate(places):
        one = by_id[place.contender.evaluation]
        same = ("agent", "version", "submission", "evaluation", "owner", "kind", "track", "finished", "dohyo_versions")
        rows.append(
            {name: getattr(one, name) for name in same}
            | {name: facts[one.evaluation][name] for name in ("scores", "per_km", "episodes", "drives", "lost")}
            | {"rank": place.rank, "baseline": False, "team": None, "verified": True, "runs": 1, "thrown_away": 0}
            | {"seeds": len(one.seeds), "lost_too_many": place.contender.lost_too_many, "unranked": place.unranked}
            | {"above": compare_places(place.contender, places[index - 1].contender) if index else None}
        )
    return rows


def create() -> FastAPI:
    """An app with the pages over the fake; the fake is `app.state.fake`."""
    app = FastAPI()
    fake = app.state.fake = Fake()

    @app.middleware("http")
    async def secure(request: Request, call_next: Any) -> Response:
        response: Response = await call_next(request)
        response.headers["content-security-policy"] = CSP
        return response

    @app.get("/v1/me")
    def me(request: Request) -> MeView:
        if request.headers.get("authorization") != f"Bearer {TOKEN}":
            raise HTTPException(401, "expected a valid bearer token in the Authorization header")
        return MeView(owner="lab", role="submitter", token="tok-1")

    @app.get("/v1/benchmarks")
    def benchmarks() -> list[BenchmarkView]:
        return BENCHMARKS

    @app.get("/v1/league")
    def standings() -> LeagueView:
        return league()

    @app.get("/v1/leaderboard")
    def leaderboard(benchmark: str, track: str | None = None) -> LeaderboardView:
        entries = [one for one in map(fake.entry, fake.agents()) if track in (None, one.track)]
        rows = board_rows(entries if benchmark == "quickstart" else [])
        return LeaderboardView(
            benchmark=benchmark, version=VERSION, versions=[VERSION], ranking=None, final=False, track=track,
            metric="driving_score", description=BENCHMARKS[0].metric, total=len(rows), rows=rows, next=None,
        )  # fmt: skip

    @app.get("/v1/comparison")
    def comparison(request: Request) -> ComparedView:
        names = [name.removeprefix("ev-") for name in request.query_params.getlist("evaluation")]
        if "other" in names:
            raise HTTPException(422, "expected evaluations of one benchmark version, got quickstart 3f9c, nocrash 77aa")
        document = compare_entries([fake.entry(name) for name in names], "driving_score")
        return ComparedView.model_validate(document)

    @app.get("/v1/agents/{name}")
    def agent(name: str) -> AgentView:
        if name not in fake.agents():
            raise HTTPException(404, f"no agent '{name}'")
        return AgentView(
            name=name, owner="lab", description="Drives by rules.", created=WHEN, version=1, kind="builtin", track="map"
        )

    @app.get("/v1/agents/{name}/submissions")
    def submissions(name: str) -> Page[SubmissionView]:
        info = fake.records[f"{name}-through-east-s0"].egos[0].agent.model_dump()
        about = {key: info[key] for key in SubmissionView.model_fields.keys() & info.keys()}
        one = {"id": "su-1", "agent": name, "version": 1, "kind": "builtin", "policy_sha256": None, "created": WHEN}
        return Page(items=[SubmissionView(**about | one)])

    @app.get("/v1/evaluations")
    def evaluations(agent: str | None = None, status: str | None = None) -> Page[EvaluationView]:
        names = ["ev-live", "ev-autopilot", "ev-reckless", *(["ev-reckless@2"] if fake.second else [])]
        rows = [fake.evaluation(name) for name in names if not fake.empty]
        return Page(items=[row for row in rows if agent in (None, row.agent) and status in (None, row.status.value)])

    @app.get("/v1/evaluations/{name}")
    def evaluation(name: str) -> EvaluationView:
        return fake.evaluation(name)

    @app.get("/v1/evaluations/{name}/episodes")
    def episodes(name: str) -> Page[EpisodeView]:
        return Page(items=fake.episodes(name))

    @app.get("/v1/evaluations/{name}/infractions")
    def infractions(name: str) -> InfractionsView:
        return fake.infractions(name)

    @app.get("/v1/evaluations/{name}/metrics")
    def metrics(name: str) -> MetricsView:
        agent = "autopilot" if name == "ev-live" else name.removeprefix("ev-").partition("@")[0]
        return MetricsView.model_validate(metrics_document(fake.entry(agent)))

    @app.get("/v1/evaluations/{name}/progress")
    async def progress(name: str) -> Response:
        async def stream() -> AsyncIterator[str]:
            yield f"event: state\ndata: {fake.evaluation(name).model_dump_json()}\n\n"
            sent = 0
            while fake.queued:
                await asyncio.sleep(0.05)
                for event in fake.events[sent:]:
                    yield f"event: episode\ndata: {json.dumps(event)}\n\n"
                sent = len(fake.events)
            yield f"event: end\ndata: {fake.evaluation(name).model_dump_json()}\n\n"

        return StreamingResponse(stream(), media_type="text/event-stream")

    @app.get("/v1/episodes/{name}")
    def episode(name: str) -> EpisodeDetail:
        if name == "waiting":
            return fake.episode(fake.queued[-1], "ev-live")
        if name.startswith("crowd"):
            return fake.episode("reckless-right-to-south-s0", "ev-reckless")
        if name not in fake.records:
            raise HTTPException(404, f"no episode '{name}'")
        return fake.episode(name, "ev-" + name.split("-")[0])

    @app.get("/v1/episodes/{name}/attempts")
    def attempts(name: str) -> Page[AttemptView]:
        return Page(items=fake.attempts.get(name, []))

    @app.get("/v1/episodes/{name}/replay")
    def replay(name: str) -> Any:
        return crowded(200) if name == "crowd" else stored("replay-" + name.split("-")[0])

    @app.get("/v1/episodes/{name}/explanation")
    def explanation(name: str, tick: int) -> Any:
        if name.startswith("autopilot"):
            raise HTTPException(409, "agent 'autopilot' has changed since; no replay")
        if not fake.explained:
            fake.explained = True
            return JSONResponse({"status": "being found out"}, 202, {"retry-after": "0"})
        why = None if tick > 100 else {"rule": "free road", "target_speed": 10 + tick, "root": {"n": 7}} | SEARCH
        return {"episode": name, "tick": tick, "ticks": 197, "explanations": {"ego": why}}

    @app.get("/v1/networks/{name}/map")
    def geometry(name: str) -> Any:
        return stored("map")

    @app.api_route("/v1/echo", methods=["GET", "POST", "DELETE"])
    def echo(request: Request) -> str | None:
        return request.headers.get("authorization")

    @app.get("/broken")
    def broken() -> Any:
        raise RuntimeError("secret of the machine")

    app.dependency_overrides[pages.token_check] = lambda: lambda token: token == TOKEN
    app.include_router(pages.router)
    app.include_router(challenge_pages.router)
    app.mount("/static", pages.static)
    app.add_middleware(SessionCookie)
    show_errors_as_pages(app, pages.render)
    return app


@cache
def crowded(actors: int) -> Any:
    """The replay of the reckless agent among many more, for 60 s: cars and people that drive in circles."""
    import math

    replay = json.loads(json.dumps(stored("replay-reckless")))
    ego = replay["egos"][0]["route"]
    ticks = 600
    found = [one for one in replay["actors"] if one["kind"] == "ego"]
    for i in range(actors):
        x0, y0 = ego[i * len(ego) // actors]
        radius, turn = 6 + 2 * (i % 12), (0.02 + 0.002 * (i % 7)) * (-1) ** i
        angles = [i + turn * tick for tick in range(ticks)]
        found.append(
            {"key": i, "name": f"actor-{i}", "kind": "pedestrian" if i % 4 == 0 else "car", "first": 0,
             "length": 0.5 if i % 4 == 0 else 4.6, "width": 0.5 if i % 4 == 0 else 1.8,
             "x": [round(x0 + radius * math.cos(a), 2) for a in angles],
             "y": [round(y0 + radius * math.sin(a), 2) for a in angles],
             "heading": [round(math.remainder(a + math.copysign(math.pi / 2, turn), 2 * math.pi), 2) for a in angles],
             "speed": [round(abs(radius * turn) * 10, 2)] * ticks}
        )  # fmt: skip
    return {**replay, "actors": found, "ticks": ticks}
