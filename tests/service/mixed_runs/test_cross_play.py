"""The cross-play of a benchmark, from hand-made records: who scored what beside whom, and who may read it."""

from __future__ import annotations

from typing import Any

import pytest

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.service.accounts.model import Role
from dohyo.service.evaluations.model import Episode, EpisodeStatus, Evaluation, EvaluationEgo, EvaluationStatus
from dohyo.service.mixed_runs import routes
from dohyo.service.storage.deletion import delete_evaluation
from tests.evaluation.builders import ego, episode, infraction
from tests.service.harness import assert_problem
from tests.service.shop import Shop

PLACES = {"start": {"lane": "E_0"}, "goal": {"lane": "E_0"}}
EGOS = ("north", "south", "west")


def together(shop: Shop) -> str:
    """A benchmark of three egos that drive at once."""
    cell = {"name": "junction", "network": "ingolstadt", "missions": "three", "together": True}
    missions = {"three": [PLACES | {"name": name} for name in EGOS]}
    return shop.benchmark(cells=[cell], missions=missions, network=None)


def drives(*scores: float, seed: int = 0, hits: str | None = None) -> EpisodeRecord:
    """An episode of the three egos with these driving scores; `hits`: the other ego that the first one hits."""
    hit = [infraction(InfractionKind.COLLISION_VEHICLE, actor=hits)] if hits else []
    egos = [
        ego(*(hit if n == 0 else []), name=name, progress_m=10.0 * score)
        for n, (name, score) in enumerate(zip(EGOS, scores, strict=True))
    ]
    return episode(*egos, name="junction", cell="junction", seed=seed)


def gridlocked(seed: int) -> EpisodeRecord:
    """An episode that is lost for all of its egos, since the traffic around one was gridlocked."""
    egos = [ego(name=name, status=Status.GRIDLOCK if name == "west" else Status.COMPLETED) for name in EGOS]
    return episode(*egos, name="junction", cell="junction", seed=seed)


def others(**submissions: str) -> list[EvaluationEgo]:
    return [EvaluationEgo(ego=ego, submission_id=submission) for ego, submission in submissions.items()]


def matrix(shop: Shop, **headers: Any) -> dict[str, Any]:
    answer = shop.client.get("/v1/benchmarks/made/cross-play", headers=headers)
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


def cells(document: dict[str, Any]) -> dict[tuple[str, str], tuple[float, int, int]]:
    names = {one["submission"]: one["agent"] for one in document["agents"]}
    return {
        (names[one["submission"]], names[one["other"]]): (one["score"]["mean"], one["drives"], one["episodes"])
        for one in document["cells"]
    }


@pytest.fixture
def filled(shop: Shop) -> Shop:
    """Two mixed runs of a with b, one of a, b and c, runs of a and of b alone, and what must not count."""
    benchmark = together(shop)
    a, b, c, d = (shop.submission(name) for name in "abcd")
    make = {"benchmark": benchmark, "ranked": False}
    shop.evaluation(a, [drives(10, 20, 60), drives(20, 40, 70, seed=1)], egos=others(west=b), **make)
    shop.evaluation(a, [drives(10, 20, 60)], egos=others(west=b), **make)  # the same drives again
    shop.evaluation(a, [drives(90, 50, 30, seed=2)], egos=others(south=b, west=c), **make)
    shop.evaluation(a, [drives(50, 60, 70)], benchmark=benchmark)
    shop.evaluation(b, [drives(1, 2, 3)], **make)
    shop.evaluation(d, [drives(9, 9, 9)], **make)  # met nobody
    shop.evaluation(b, [drives(0, 0, 0, seed=3)], egos=others(west=a), status=EvaluationStatus.CANCELLED, **make)
    return shop


def test_each_agent_is_scored_beside_each_other_one_and_beside_itself(filled: Shop) -> None:
    document = matrix(filled)
    assert (document["benchmark"], document["metric"], document["runs"]) == ("made", "driving_score", 3)
    assert cells(document) == {
        ("b", "b"): (2.0, 3, 1),
        ("b", "a"): (60.0, 3, 3),
        ("b", "c"): (50.0, 1, 1),
        ("a", "b"): (36.0, 5, 3),
        ("a", "a"): (60.0, 3, 1),
        ("a", "c"): (90.0, 1, 1),
        ("c", "a"): (30.0, 1, 1),
        ("c", "b"): (30.0, 1, 1),
    }
    assert [(one["agent"], one["score"]["mean"], one["drives"]) for one in document["agents"]] == [
        ("b", 60.0, 3),
        ("a", 36.0, 5),
        ("c", 30.0, 1),
    ]


def test_lost_drives_are_counted_beside_the_scores(shop: Shop) -> None:
    make = {"benchmark": together(shop), "ranked": False}
    a, b, c = (shop.submission(name) for name in "abc")
    shop.evaluation(a, [drives(10, 20, 60), gridlocked(seed=1)], egos=others(west=b), **make)
    shop.evaluation(a, [gridlocked(seed=1)], egos=others(west=b), **make)  # the same drives again
    shop.evaluation(a, [gridlocked(seed=2)], egos=others(north=c), **make)
    shop.evaluation(a, [drives(50, 60, 70), gridlocked(seed=3)], **make)
    document = matrix(shop)
    assert [(one["agent"], one["score"]["mean"], one["drives"], one["lost"]) for one in document["agents"]] == [
        ("b", 60.0, 1, 1),
        ("a", 15.0, 2, 4),
        ("c", None, 0, 1),
    ]
    names = {one["submission"]: one["agent"] for one in document["agents"]}
    assert {
        (names[one["submission"]], names[one["other"]]): (one["drives"], one["lost"]) for one in document["cells"]
    } == {
        ("b", "a"): (1, 1),
        ("a", "b"): (2, 2),
        ("a", "a"): (3, 3),
        ("a", "c"): (0, 2),
        ("c", "a"): (0, 1),
    }


def test_runs_of_the_newest_version_of_dohyo_count(shop: Shop) -> None:
    """Another version may drive and judge otherwise: its scores belong into no mean with those of this one."""
    benchmark = together(shop)
    a, b = shop.submission("a"), shop.submission("b")
    make = {"benchmark": benchmark, "ranked": False}
    shop.evaluation(a, [by("0.2.0", drives(90, 90, 90))], egos=others(west=b), **make)
    shop.evaluation(a, [by("0.10.0", drives(10, 20, 60))], egos=others(west=b), **make)
    both = [by("0.2.0", drives(80, 80, 80)), by("0.10.0", drives(80, 80, 80, seed=1))]
    shop.evaluation(a, both, egos=others(west=b), **make)
    shop.evaluation(a, [by("0.2.0", drives(70, 70, 70))], **make)
    document = matrix(shop)
    assert (document["dohyo_version"], document["runs"], document["other_versions"]) == ("0.10.0", 1, 2)
    assert cells(document) == {("a", "b"): (15.0, 2, 1), ("b", "a"): (60.0, 1, 1)}
    shop.evaluation(a, [by("0.10.0", drives(50, 50, 50))], **make)
    assert cells(matrix(shop))["a", "a"] == (50.0, 3, 1)


def by(dohyo: str, record: EpisodeRecord) -> EpisodeRecord:
    return record.model_copy(update={"versions": record.versions.model_copy(update={"dohyo": dohyo})})


def test_only_runs_that_the_reader_may_see_count(private_shop: Shop) -> None:
    benchmark = together(private_shop)
    a, b = private_shop.submission("a"), private_shop.submission("b")
    private_shop.evaluation(a, [drives(10, 20, 60)], egos=others(west=b), benchmark=benchmark, ranked=False)
    for owner, role, runs in (("ann", Role.READER, 1), ("bob", Role.SUBMITTER, 0), ("root", Role.ADMIN, 1)):
        document = matrix(private_shop, **private_shop.token(owner, role))
        assert (document["runs"], len(document["agents"]), len(document["cells"])) == (runs, 2 * runs, 2 * runs)
    assert private_shop.client.get("/v1/benchmarks/made/cross-play").status_code == 401


def test_many_runs_of_one_owner_leave_room_for_those_of_others(shop: Shop, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "MOST_RUNS", 3)
    make = {"benchmark": together(shop), "ranked": False}
    a, b = shop.submission("a"), shop.submission("b")
    shop.evaluation(a, [drives(10, 20, 60)], egos=others(west=b), **make)
    x, y = (shop.submission(name, owner="bob") for name in "xy")
    for seed in range(1, 5):
        shop.evaluation(x, [drives(90, 90, 90, seed=seed)], egos=others(west=y), owner="bob", **make)
    assert ("a", "b") in cells(matrix(shop))


def test_a_new_run_counts_at_the_next_read_and_a_deleted_one_no_more(shop: Shop) -> None:
    make = {"benchmark": together(shop), "ranked": False}
    a, b, c = (shop.submission(name) for name in "abc")
    shop.evaluation(a, [drives(10, 20, 60)], egos=others(west=b), **make)
    before = cells(matrix(shop))
    new, _ = shop.evaluation(a, [drives(30, 40, 80, seed=1)], egos=others(west=c), **make)
    assert cells(matrix(shop)) == before | {("a", "c"): (35.0, 2, 1), ("c", "a"): (80.0, 1, 1)}
    with shop.services.database.session() as session:
        delete_evaluation(session, session.get_one(Evaluation, new))
    assert cells(matrix(shop)) == before


def test_a_run_that_somebody_else_ordered_counts_for_the_same_agent(shop: Shop) -> None:
    make = {"benchmark": together(shop), "ranked": False}
    a, b = shop.submission("a"), shop.submission("b")
    shop.evaluation(a, [drives(10, 20, 60)], egos=others(west=b), **make)
    shop.evaluation(a, [drives(30, 40, 80, seed=1)], egos=others(west=b), owner="root", **make)
    document = matrix(shop)
    assert [(one["agent"], one["owner"], one["drives"]) for one in document["agents"]] == [
        ("b", "ann", 2),
        ("a", "ann", 4),
    ]


def test_a_benchmark_without_cross_play_says_so(shop: Shop) -> None:
    shop.benchmark()
    assert_problem(shop.client.get("/v1/benchmarks/made/cross-play"), 404, "each of its egos drives alone")
    assert_problem(shop.client.get("/v1/benchmarks/none/cross-play"), 404, "benchmark")
    assert_problem(shop.client.get("/v1/benchmarks/made/cross-play?version=00000000"), 404)
    assert_problem(shop.client.get("/v1/benchmarks/made/cross-play?version=x"), 422, "query.version")


def test_the_metrics_of_a_mixed_run_are_by_agent_with_who_met_whom(shop: Shop) -> None:
    benchmark = together(shop)
    a, b = shop.submission("a"), shop.submission("b")
    records = [drives(50, 20, 60, hits="west"), drives(20, 40, 80, seed=1)]
    mixed, _ = shop.evaluation(a, records, egos=others(west=b), benchmark=benchmark, ranked=False)
    metrics = shop.client.get(f"/v1/evaluations/{mixed}/metrics").json()
    assert [(one["agent"], one["egos"], one["drives"]) for one in metrics["agents"]] == [
        ("a", ["north", "south"], 4),
        ("b", ["west"], 2),
    ]
    means = [one["scores"]["driving_score"]["mean"] for one in metrics["agents"]]
    assert means == pytest.approx([(50 * 0.6 + 20 + 20 + 40) / 4, 70.0])
    pair = [{"agent": "a", "version": 1}, {"agent": "b", "version": 1}]
    assert metrics["meetings"] == [{"agents": pair, "episodes": 2, "collisions": 1}]
    assert [(one["name"], one["agent"]) for one in metrics["drives"][:3]] == [
        ("north", "a"),
        ("south", "a"),
        ("west", "b"),
    ]
    table = shop.client.get(f"/v1/evaluations/{mixed}/metrics.csv").text.splitlines()
    assert [line.split(",")[0] for line in table] == ["row", *["drive"] * 6, "cell", "agent", "agent", "all"]
    alone, _ = shop.evaluation(a, records[:1], benchmark=benchmark)
    metrics = shop.client.get(f"/v1/evaluations/{alone}/metrics").json()
    assert (metrics["agents"], metrics["meetings"]) == ([], [])


def test_lost_drives_of_a_mixed_run_are_counted_by_agent(shop: Shop) -> None:
    benchmark = together(shop)
    a, b = shop.submission("a"), shop.submission("b")
    records = [drives(50, 20, 60), drives(20, 40, 80, seed=1)]
    mixed, (_, second) = shop.evaluation(a, records, egos=others(west=b), benchmark=benchmark, ranked=False)
    with shop.services.database.session() as session:
        session.get_one(Episode, second).status = EpisodeStatus.LOST
    metrics = shop.client.get(f"/v1/evaluations/{mixed}/metrics").json()
    assert [(one["drives"], one["lost"]) for one in (metrics["all"], *metrics["agents"])] == [(3, 3), (2, 2), (1, 1)]
