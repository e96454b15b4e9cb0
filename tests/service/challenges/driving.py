"""Made-up ends of runs, where nothing drives: every episode done, with a score."""

from __future__ import annotations

from datetime import datetime, timedelta
from importlib.metadata import version
from typing import Any

from sqlalchemy import select, update

from dohyo.service.boards.model import Ranking
from dohyo.service.database.base import now
from dohyo.service.database.engine import Database
from dohyo.service.evaluations.model import Episode, EpisodeStatus, Evaluation, EvaluationStatus
from tests.service.harness import Caller, Harness

VERSION = version("dohyo")
FACTS = {"name": "ego", "status": "completed", "success": True, "nocrash": True, "rc": 100.0, "road": 100.0}
FACTS |= {
    "infractions": {"red_light": 1},
    "marks": [{"kind": "red_light", "time_s": 1, "x_m": 0, "y_m": 0, "route_m": 1}],
}
FACTS |= {"km": 1.0, "route_m": 1000.0, "driven_m": 1000.0, "duration_s": 100.0, "drove": False}


def complete(
    database: Database,
    evaluation_id: str,
    score: float,
    *,
    finished: datetime | None = None,
    dohyo: tuple[str, ...] = (VERSION,),
) -> None:
    """Ends an evaluation with the same driving score in all its episodes, driven with these versions of dohyo."""
    facts: dict[str, Any] = FACTS | {"ds": score, "ip": score / 100.0, "irs": score}
    with database.session() as session:
        for one in session.scalars(select(Episode).where(Episode.evaluation_id == evaluation_id)):
            one.status, one.record_hash = EpisodeStatus.DONE, f"{one.position:064x}"
            one.summary = {"egos": [facts], "decision_ms": None, "wall_s": 1.0}
        values = {"status": EvaluationStatus.DONE, "finished": finished or now(), "dohyo_versions": list(dohyo)}
        session.execute(update(Evaluation).where(Evaluation.id == evaluation_id).values(values))


def end(database: Database, ranking_id: str, *, ago: timedelta = timedelta()) -> None:
    """Lets a phase end: its closing was now, or so long ago."""
    with database.session() as session:
        times = {"closes": now() - ago, "ends": now() - ago}
        session.execute(update(Ranking).where(Ranking.id == ranking_id).values(times))


def in_days(days: float) -> str:
    """A moment, as the interface takes it."""
    return (now() + timedelta(days=days)).isoformat()


def make_challenge(organiser: Caller, name: str = "cup", **phase: Any) -> str:
    """A challenge with one phase; the phase's ranking."""
    made = organiser.post("/v1/challenges", {"name": name, "title": "A cup", "rules": "# Rules\n<b>Drive.</b>"})
    assert made.status_code == 201, made.text
    order = {"name": "final", "benchmark": "quickstart", "draw_seeds": 1, "closes": in_days(1)} | phase
    answer = organiser.post(f"/v1/challenges/{name}/phases", order)
    assert answer.status_code == 201, answer.text
    identifier: str = answer.json()["id"]
    return identifier


def admit(service: Harness, organiser: Caller, owner: str, challenge: str = "cup", **invitation: Any) -> Caller:
    """A stranger who redeems an invitation, as a caller with the token of the answer."""
    code = organiser.post(f"/v1/challenges/{challenge}/invitations", invitation).json()["code"]
    answer = service.client.post("/v1/invitations/redeem", json={"code": code, "owner": owner})
    assert answer.status_code == 201, answer.text
    return Caller(service.client, answer.json()["token"])


def enter(caller: Caller, agent: str, ranking: str, status: int = 201) -> Any:
    """The answer to the order of a ranked run."""
    order = {"agent": agent, "benchmark": "quickstart", "ranked": True, "ranking": ranking}
    answer = caller.post("/v1/evaluations", order)
    assert answer.status_code == status, answer.text
    return answer.json()
