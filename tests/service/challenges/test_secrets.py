"""What a secret phase tells to whom: every endpoint that reads an evaluation, asked by every kind of caller."""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import cycle, product
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import select, update

from dohyo.service.accounts.model import Role
from dohyo.service.boards.model import Audience, Ranking
from dohyo.service.database.base import now
from dohyo.service.evaluations.model import Attempt, AttemptOutcome, Episode, Evaluation, EvaluationStatus
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.attempts import AttemptEnd
from dohyo.service.webhooks.model import Delivery
from dohyo.service.webhooks.queries import announce
from tests.service.challenges.driving import FACTS, admit, complete, end, enter, make_challenge
from tests.service.harness import Caller, Harness, running
from tests.service.served import wait_until

READINGS = {
    "run": ("/v1/evaluations/{ev}", "/v1/evaluations/{ev}/episodes", "/v1/episodes/{ep}", "/v1/evaluations",
            "/v1/episodes/{ep}/attempts"),
    "replays": ("/v1/evaluations/{ev}/infractions", "/v1/episodes/{ep}/events", "/v1/episodes/{ep}/replay",
                "/v1/episodes/{ep}/explanation?tick=0"),
    "records": ("/v1/evaluations/{ev}/manifest", "/v1/evaluations/{ev}/metrics", "/v1/evaluations/{ev}/metrics.csv",
                "/v1/episodes/{ep}/record", "/v1/episodes/{ep}/trajectory",
                "/v1/comparison?evaluation={ev}&evaluation={ev2}"),
}  # fmt: skip


@dataclass
class Stage:
    """A secret phase with two complete runs of Ann, and every kind of caller."""

    service: Harness
    ranking: str
    seeds: list[int]
    scenarios: list[str]
    names: dict[str, str]
    callers: dict[str, Any]

    def get(self, who: str, path: str) -> Any:
        return self.callers[who].get(path.format(**self.names))

    def restart(self, secret: bool, **audiences: Audience) -> None:
        """Gives the phase other conditions, as if it had begun with them."""
        values = {"secret": secret, "ends": None, "closes": None, **audiences}
        with self.service.services.database.session() as session:
            session.execute(update(Ranking).where(Ranking.id == self.ranking).values(values))


@pytest.fixture(scope="module", params=[True, False], ids=["public", "private"])
def stage(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    folder: Path = tmp_path_factory.mktemp("data")
    with running(folder / "data", public=request.param) as service:
        organiser = service.caller("lab", Role.ORGANISER)
        ranking = make_challenge(organiser, secret=True, runs_per_period=9)
        ann, mate = admit(service, organiser, "ann", team="blue"), admit(service, organiser, "mate", team="blue")
        callers = {"anonymous": service.client, "stranger": service.caller("stranger"), "ann": ann, "mate": mate}
        callers |= {"rival": admit(service, organiser, "rival"), "worker": service.caller("ann", Role.WORKER)}
        callers |= {"other organiser": service.caller("other", Role.ORGANISER), "submitter": service.caller("lab")}
        callers |= {"organiser": organiser, "admin": service.caller("root", Role.ADMIN)}
        ann.agent("a")
        ann.post("/v1/webhooks", {"url": "https://example.org/hook"})
        runs = [enter(ann, "a", ranking)["id"] for _ in range(2)]
        for run in runs:
            complete(service.services.database, run, 50.0)
        with service.services.database.reading() as session:
            seeds = session.get_one(Ranking, ranking).seeds
            found = session.scalars(select(Episode).where(Episode.evaluation_id == runs[0])).all()
        with service.services.database.session() as session:
            why = f"seed {found[0].seed}: the agent raised"
            facts = {"outcome": AttemptOutcome.AGENT_FAILED, "why": why, "processor_s": 7.5, "ended": now()}
            session.add(Attempt(id="at-1", episode_id=found[0].id, number=1, **facts))
        names = {"ev": runs[0], "ev2": runs[1], "ep": found[0].id, "rk": ranking}
        yield Stage(service, ranking, list(seeds), [one.scenario for one in found], names, callers)


def tells(stage: Stage, text: str) -> bool:
    """Whether a text tells a seed or a scenario of the phase."""
    return any(str(seed) in text for seed in stage.seeds) or any(f'"{name}"' in text for name in stage.scenarios)


INSIDERS = ("organiser", "admin")
OUTSIDERS = ("anonymous", "stranger", "ann", "mate", "rival", "worker", "other organiser", "submitter")


@pytest.mark.parametrize("who", OUTSIDERS)
def test_a_secret_phase_tells_nothing_of_its_drives_until_it_ends(stage: Stage, who: str) -> None:
    stage.restart(secret=True)
    for aspect, paths in READINGS.items():
        for path in (*paths, "/v1/rankings/{rk}", "/v1/challenges/cup", "/v1/leaderboard?ranking={rk}"):
            answer = stage.get(who, path)
            assert not tells(stage, answer.text), (who, path)
            if aspect != "run" and path in paths:
                assert answer.status_code in (401, 403, 404), (who, path, answer.text)
    verify = f"/v1/episodes/{stage.names['ep']}/verify"
    for path, body in (("/v1/rescore", {"evaluation": stage.names["ev"]}), (verify, None)):
        assert stage.callers[who].post(path, json=body).status_code in (401, 403, 404)


@pytest.mark.parametrize("who", ["ann", "mate", "worker"])
def test_the_runner_still_sees_status_and_progress(stage: Stage, who: str) -> None:
    stage.restart(secret=True)
    seen = stage.get(who, "/v1/evaluations/{ev}").json()
    assert (seen["status"], seen["progress"]["done"], seen["withheld"], seen["seeds"]) == ("done", 6, True, None)
    items = stage.get(who, "/v1/evaluations/{ev}/episodes").json()["items"]
    assert len(items) == 6
    assert {(one["scenario"], one["seed"], one["summary"], one["record_hash"]) for one in items} == {(None,) * 4}


def test_attempts_tell_why_to_insiders_only(stage: Stage) -> None:
    stage.restart(secret=True)
    path = "/v1/episodes/{ep}/attempts"
    (seen,) = stage.get("ann", path).json()["items"]
    assert (seen["number"], seen["outcome"], seen["why"], seen["processor_s"]) == (1, "done", None, None)
    (seen,) = stage.get("organiser", path).json()["items"]
    assert (seen["outcome"], seen["processor_s"]) == ("agent_failed", 7.5)
    assert str(stage.seeds[0]) in seen["why"]


@pytest.mark.parametrize("who", ["ann", "mate", "rival"])
def test_times_of_single_drives_are_withheld_since_they_tell_how_long_each_was(stage: Stage, who: str) -> None:
    stage.restart(secret=True)
    with stage.service.services.database.session() as session:
        times = {"started": now(), "finished": now()}
        session.execute(update(Episode).where(Episode.id == stage.names["ep"]).values(times))

    def times_seen_by(caller: str) -> set[str | None]:
        listed = stage.get(caller, "/v1/evaluations/{ev}/episodes").json()["items"]
        drives = [one for one in listed if one["id"] == stage.names["ep"]]
        drives.append(stage.get(caller, "/v1/episodes/{ep}").json())
        attempts = stage.get(caller, "/v1/episodes/{ep}/attempts").json()["items"]
        return {one[end] for one in drives for end in times} | {
            one[e] for one in attempts for e in ("started", "ended")
        }

    assert times_seen_by(who) == {None}
    assert None not in times_seen_by("organiser")


def test_while_a_secret_run_lasts_its_runner_sees_how_many_episodes_are_done_and_not_which(service: Harness) -> None:
    ann, organiser, run, episode = half_done(service)
    assert ann.get(f"/v1/evaluations/{run}").json()["progress"]["done"] == 1

    def statuses(caller: Caller, which: str = "") -> list[str]:
        return [one["status"] for one in caller.get(f"/v1/evaluations/{run}/episodes{which}").json()["items"]]

    assert statuses(ann) == statuses(ann, "?status=queued") == ["queued"] * 6
    assert statuses(ann, "?status=done") == statuses(ann, "?status=running") == []
    assert ann.get(f"/v1/episodes/{episode}").json()["status"] == "queued"
    assert ann.get(f"/v1/episodes/{episode}/attempts").json()["items"] == []
    assert statuses(organiser, "?status=done") == ["done"]
    complete(service.services.database, run, 50.0)
    assert statuses(ann) == ["done"] * 6


def test_events_of_a_secret_run_name_no_episode_except_to_insiders(service: Harness) -> None:
    ann, organiser, run, episode = half_done(service)
    topic, events = f"evaluation:{run}", service.services.events
    with ThreadPoolExecutor() as pool:
        told = [pool.submit(caller.get, f"/v1/evaluations/{run}/progress") for caller in (ann, organiser)]
        wait_until(lambda: len(events._subscriptions.get(topic, ())) == 2, "they do not both listen")
        assert service.client.portal is not None
        service.client.portal.call(events.publish, topic, {"episode": episode, "status": "done"})
        wait_until(lambda: not any(one._waiting for one in tuple(events._subscriptions[topic])), "they do not read")
        complete(service.services.database, run, 50.0)
        events.publish(topic, {"evaluation": run, "status": "done"})
        outside, inside = (one.result().text for one in told)
    assert episode not in outside
    assert "event: state" in outside
    assert "event: end" in outside
    assert episode in inside


def half_done(service: Harness) -> tuple[Caller, Caller, str, str]:
    """A participant and the organiser of a secret phase, a run of it that lasts, and its episode that is done."""
    organiser = service.caller("lab", Role.ORGANISER)
    ranking = make_challenge(organiser, secret=True)
    ann = admit(service, organiser, "ann")
    ann.agent("a")
    run = enter(ann, "a", ranking)["id"]
    with service.services.database.session() as session:
        ticket = queue.take(session, queue.waiting(session)[0])
    assert ticket is not None
    with service.services.database.session() as session:
        assert queue.finish(session, ticket, "0" * 64, {"egos": [FACTS]}, AttemptEnd(AttemptOutcome.DONE))
    return ann, organiser, run, ticket.episode_id


@pytest.mark.parametrize("who", INSIDERS)
def test_the_organiser_and_administrators_see_all(stage: Stage, who: str) -> None:
    stage.restart(secret=True)
    assert tells(stage, stage.get(who, "/v1/evaluations/{ev}").text)
    assert stage.get(who, "/v1/evaluations/{ev}/metrics").status_code == 200
    assert stage.get(who, "/v1/rankings/{rk}").json()["seeds"] == stage.seeds


def test_after_the_end_the_runner_reads_its_records(stage: Stage) -> None:
    stage.restart(secret=True)
    end(stage.service.services.database, stage.ranking)
    assert stage.get("ann", "/v1/evaluations/{ev}/metrics").status_code == 200
    assert stage.get("ann", "/v1/evaluations/{ev}").json()["seeds"] == stage.seeds
    assert stage.get("mate", "/v1/episodes/{ep}").json()["scenario"] == stage.scenarios[0]


def test_messages_to_webhooks_tell_no_failure_of_a_secret_phase(stage: Stage) -> None:
    stage.restart(secret=True)
    reason = f"scenario {stage.scenarios[0]} with seed {stage.seeds[0]} was lost"
    with stage.service.services.database.session() as session:
        run = update(Evaluation).where(Evaluation.id == stage.names["ev2"])
        session.execute(run.values(failure=reason, announced=None, status=EvaluationStatus.DONE, finished=now()))
        announce(session)
        bodies = [json.dumps(one.body) for one in session.scalars(select(Delivery))]
    assert bodies
    assert not any(tells(stage, body) or reason in body for body in bodies)


MEMBERS = ("ann", "mate", "rival", "worker")


@pytest.mark.parametrize("aspect", READINGS)
def test_an_aspect_is_shown_to_its_audience_alone(stage: Stage, aspect: str) -> None:
    paths = cycle(READINGS[aspect][:3])
    for secret, board, audience in product((True, False), Audience, Audience):
        stage.restart(secret, **{"board": board} | ({} if aspect == "run" else {aspect: audience}))
        for who in (*OUTSIDERS, *INSIDERS):
            path = next(paths)
            status = stage.get(who, path).status_code
            expected = _expected(stage, who, aspect, secret, audience, board)
            assert (status not in (401, 403, 404, 500)) == expected, (who, path, status, secret, board, audience)


def _expected(stage: Stage, who: str, aspect: str, secret: bool, audience: Audience, board: Audience) -> bool:
    own = who in ("ann", "mate", "worker")
    if who in INSIDERS:
        return True
    if not own and not _in(stage, who, board):
        return False
    if aspect == "run":
        return True
    return not secret and (own or _in(stage, who, audience))


def _in(stage: Stage, who: str, audience: Audience) -> bool:
    if audience is Audience.PUBLIC:
        return stage.service.services.settings.public or who in MEMBERS
    return audience is Audience.PARTICIPANTS and who in MEMBERS
