from __future__ import annotations

import csv
import gzip
import io
import json
from pathlib import Path

import polars as pl
import pytest
from typer.testing import CliRunner

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.records.record import EpisodeRecord, Versions
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.records.store import read_record
from dohyo.service.accounts.model import Role
from dohyo.service.boards.views import ComparedView, LeaderboardView
from dohyo.service.cli.main import app as cli
from dohyo.service.evaluations.metrics_views import MetricsView, RescoredView
from dohyo.service.evaluations.model import BenchmarkVersion, Episode, EpisodeStatus, EvaluationStatus
from dohyo.service.submissions.model import AgentKind
from dohyo.sumo_networks.networks.catalog import load_network
from tests.evaluation.builders import drive, ego, episode, infraction
from tests.service.shop import Shop

HIT = infraction(InfractionKind.COLLISION_VEHICLE, time_s=2.0, route_m=50.0)
RED = infraction(InfractionKind.RED_LIGHT, time_s=3.0, route_m=70.0)
SLOW = infraction(InfractionKind.MINIMUM_SPEED, time_s=4.0, route_m=90.0, magnitude=50.0)


def records(*scores: float) -> list[EpisodeRecord]:
    return [episode(ego(progress_m=10.0 * score), name=f"scenario{n}") for n, score in enumerate(scores)]


def on_a_network() -> EpisodeRecord:
    scenario = load_benchmark("quickstart").scenarios([0])[0]
    versions = Versions(dohyo="0.1.0", sumo="1.28.0", network_sha256=load_network("ingolstadt").sha256)
    return episode(ego(HIT)).model_copy(update={"scenario": scenario, "versions": versions})


# Leaderboard


def test_the_leaderboard_ranks_complete_ranked_runs_the_first_of_each_submission(shop: Shop) -> None:
    good, bad = shop.submission("good"), shop.submission("bad")
    first, _ = shop.evaluation(bad, records(*[20.0] * 6))
    shop.evaluation(good, records(*[80.0] * 6))
    shop.evaluation(bad, records(*[99.0] * 6))  # a later one of the same submission, luckier
    shop.evaluation(shop.submission("running"), records(99.0), status=EvaluationStatus.RUNNING)
    shop.evaluation(shop.submission("cancelled"), records(99.0), status=EvaluationStatus.CANCELLED)
    shop.evaluation(shop.submission("practice"), records(99.0), ranked=False)
    board = shop.client.get("/v1/leaderboard", params={"benchmark": "made"}).json()
    assert [(row["rank"], row["agent"], row["runs"]) for row in board["rows"]] == [(1, "good", 1), (2, "bad", 2)]
    assert board["rows"][1]["evaluation"] == first
    assert board["rows"][1]["scores"]["driving_score"]["mean"] == pytest.approx(20.0)
    assert board["rows"][1]["above"]["verdict"] == "<"
    assert (board["metric"], board["version"], board["total"]) == ("driving_score", shop.benchmark(), 2)


def test_tracks_and_versions_are_apart(shop: Shop) -> None:
    shop.evaluation(shop.submission("mapper"), records(50.0))
    shop.evaluation(shop.submission("seer", track="privileged"), records(60.0))
    other = shop.benchmark(stop_on_collision=True)
    shop.evaluation(shop.submission("newer"), records(70.0), benchmark=other)

    def agents(**params: str) -> list[str]:
        answer = shop.client.get("/v1/leaderboard", params={"benchmark": "made", **params})
        return [row["agent"] for row in answer.json()["rows"]]

    assert agents(version=shop.benchmark(), track="map") == ["mapper"]
    assert agents(version=shop.benchmark(), track="privileged") == ["seer"]
    assert agents(version=shop.benchmark()) == ["seer", "mapper"]
    assert agents(version=other[:8]) == ["newer"]
    assert agents() == ["newer"]  # the newest version
    assert agents(version=shop.benchmark(), track="sensors") == []
    assert len(shop.client.get("/v1/leaderboard", params={"benchmark": "made"}).json()["versions"]) == 2


def test_a_new_evaluation_shows_at_once(shop: Shop) -> None:
    shop.evaluation(shop.submission("first"), records(50.0))
    ask = {"benchmark": "made"}
    assert len(shop.client.get("/v1/leaderboard", params=ask).json()["rows"]) == 1
    shop.evaluation(shop.submission("second"), records(60.0))
    assert [row["agent"] for row in shop.client.get("/v1/leaderboard", params=ask).json()["rows"]] == [
        "second",
        "first",
    ]


def test_a_benchmark_nobody_drove_has_an_empty_leaderboard(shop: Shop) -> None:
    board = shop.client.get("/v1/leaderboard", params={"benchmark": "quickstart"}).json()
    assert (board["rows"], board["versions"]) == ([], [])
    assert board["version"] == load_benchmark("quickstart").sha256


@pytest.mark.parametrize(
    ("params", "status"),
    [
        ({}, 422),
        ({"benchmark": "quickstat"}, 404),
        ({"benchmark": "../secret.toml"}, 422),
        ({"benchmark": "quickstart.toml"}, 404),
        ({"benchmark": "quickstart", "version": "0" * 64}, 404),
        ({"benchmark": "quickstart", "version": "xyz"}, 422),
        ({"benchmark": "quickstart", "track": "none"}, 422),
    ],
)
def test_a_wrong_question_gets_a_problem(shop: Shop, params: dict[str, str], status: int) -> None:
    for path in ("/v1/leaderboard", "/v1/leaderboard.csv"):
        answer = shop.client.get(path, params=params)
        assert (answer.status_code, answer.headers["content-type"]) == (status, "application/problem+json")


def test_the_leaderboards_csv(shop: Shop) -> None:
    shop.evaluation(shop.submission("one"), records(50.0, 60.0))
    answer = shop.client.get("/v1/leaderboard.csv", params={"benchmark": "made"})
    (line,) = csv.DictReader(io.StringIO(answer.text))
    assert (line["agent"], float(line["driving_score"]), line["seeds"]) == ("one", pytest.approx(55.0), "1")
    assert answer.headers["content-type"].startswith("text/csv")


# Who may see what


def test_others_evaluations_do_not_exist_where_the_service_is_private(private_shop: Shop) -> None:
    shop = private_shop
    evaluation, (one,) = shop.evaluation(shop.submission("mine"), records(50.0), owner="ann")
    theirs, _ = shop.evaluation(shop.submission("theirs", owner="bob"), records(60.0), owner="bob")
    ann, bob, admin = shop.token("ann"), shop.token("bob"), shop.token("root", Role.ADMIN)
    paths = [f"/v1/evaluations/{evaluation}/{what}" for what in ("metrics", "metrics.csv", "infractions")] + [
        f"/v1/episodes/{one}{what}" for what in ("", "/record", "/trajectory", "/events")
    ]
    for path in paths:
        assert shop.client.get(path).status_code == 401, path
        assert shop.client.get(path, headers=bob).status_code == 404, path
        assert shop.client.get(path, headers=ann).status_code == 200, path
        assert shop.client.get(path, headers=admin).status_code == 200, path
    for path in (f"/v1/episodes/{one}/replay", f"/v1/episodes/{one}/explanation?tick=0"):
        assert shop.client.get(path, headers=bob).status_code == 404, path
    assert shop.client.post(f"/v1/episodes/{one}/verify", headers=bob).status_code == 404
    assert shop.client.post("/v1/rescore", json={"evaluation": evaluation}, headers=bob).status_code == 404
    both = {"evaluation": [evaluation, theirs]}
    assert shop.client.get("/v1/comparison", params=both, headers=bob).status_code == 404
    assert shop.client.get("/v1/comparison", params=both, headers=admin).status_code == 200


def test_a_private_leaderboard_shows_ones_own(private_shop: Shop) -> None:
    shop = private_shop
    shop.evaluation(shop.submission("mine"), records(50.0), owner="ann")
    shop.evaluation(shop.submission("theirs", owner="bob"), records(60.0), owner="bob")

    def agents(headers: dict[str, str]) -> list[str]:
        answer = shop.client.get("/v1/leaderboard", params={"benchmark": "made"}, headers=headers)
        return [row["agent"] for row in answer.json()["rows"]]

    assert agents(shop.token("ann")) == ["mine"]
    assert agents(shop.token("bob")) == ["theirs"]
    assert agents(shop.token("root", Role.ADMIN)) == ["theirs", "mine"]


def test_what_a_private_cache_keeps_stays_private(private_shop: Shop) -> None:
    _, (one,) = private_shop.evaluation(private_shop.submission("mine"), records(50.0))
    answer = private_shop.client.get(f"/v1/episodes/{one}/record", headers=private_shop.token("ann"))
    assert answer.headers["cache-control"].startswith("private")


# Episodes


def test_an_episode_and_its_files(shop: Shop, tmp_path: Path) -> None:
    evaluation, (one,) = shop.evaluation(shop.submission("agent"), [episode(ego(HIT, RED))])
    shown = shop.client.get(f"/v1/episodes/{one}").json()
    assert (shown["evaluation"], shown["agent"], shown["agent_version"]) == (evaluation, "agent", 1)
    assert (shown["benchmark"], shown["rules"], shown["status"]) == ("made", "2.0", "done")
    assert shown["summary"]["egos"][0]["ds"] == pytest.approx(80 * 0.42)

    answer = shop.client.get(f"/v1/episodes/{one}/record")
    (tmp_path / "r.json").write_bytes(answer.content)
    assert read_record(tmp_path / "r.json").record_hash == shown["record_hash"]

    table = pl.read_parquet(shop.client.get(f"/v1/episodes/{one}/trajectory").content)
    assert table["x"].to_list() == drive().x.tolist()

    (events,) = shop.client.get(f"/v1/episodes/{one}/events").json()["egos"]
    assert [(event["kind"], event["factor"]) for event in events["infractions"]] == [
        ("collision_vehicle", 0.6),
        ("red_light", 0.7),
    ]


def test_files_that_never_change_are_cached(shop: Shop) -> None:
    _, (one,) = shop.evaluation(shop.submission("agent"), [on_a_network()])
    for what in ("record", "trajectory", "replay"):
        path = f"/v1/episodes/{one}/{what}"
        first = shop.client.get(path)
        assert first.status_code == 200, first.text
        assert "immutable" in first.headers["cache-control"]
        again = shop.client.get(path, headers={"if-none-match": f'"other", {first.headers["etag"]}'})
        assert (again.status_code, again.content) == (304, b"")
        assert shop.client.get(path, headers={"if-none-match": '"other"'}).status_code == 200
    part = shop.client.get(f"/v1/episodes/{one}/trajectory", headers={"range": "bytes=0-3"})
    assert (part.status_code, part.content) == (206, b"PAR1")


def test_a_replay_is_made_once_and_kept(shop: Shop) -> None:
    _, (one,) = shop.evaluation(shop.submission("agent"), [on_a_network()])
    replay = shop.client.get(f"/v1/episodes/{one}/replay")
    assert replay.headers["content-encoding"] == "gzip"
    assert replay.json()["episode"] == one
    assert [actor["name"] for actor in replay.json()["actors"]] == ["ego0", "car0", "car7"]
    (kept,) = shop.path(one).parent.glob("*.replay-*")
    assert json.loads(gzip.decompress(kept.read_bytes())) == replay.json()
    kept.write_bytes(gzip.compress(b'{"kept": true}'))
    plain = shop.client.get(f"/v1/episodes/{one}/replay", headers={"accept-encoding": "identity"})
    assert "content-encoding" not in plain.headers
    assert plain.json() == {"kept": True}


def test_two_episodes_with_the_same_record_have_a_replay_each(shop: Shop) -> None:
    ids = [shop.evaluation(shop.submission("agent"), [on_a_network()])[1][0] for _ in range(2)]
    assert shop.path(ids[0]) == shop.path(ids[1])
    assert [shop.client.get(f"/v1/episodes/{one}/replay").json()["episode"] for one in ids] == ids


@pytest.mark.parametrize("damage", ["missing", "truncated", "changed"])
def test_a_damaged_record_gives_one_clear_error(shop: Shop, damage: str) -> None:
    evaluation, (one,) = shop.evaluation(shop.submission("agent"), [on_a_network()])
    path = shop.path(one)
    if damage == "missing":
        path.unlink()
    else:
        text = path.read_text()
        path.write_text(text[:-20] if damage == "truncated" else text.replace('"duration_s":60', '"duration_s":61'))
    answers = [shop.client.get(f"/v1/episodes/{one}/{what}") for what in ("record", "events", "replay", "trajectory")]
    answers.append(shop.client.get(f"/v1/episodes/{one}/explanation?tick=0"))
    answers.append(shop.client.post(f"/v1/episodes/{one}/verify", headers=shop.token("ann")))
    answers.append(shop.client.post("/v1/rescore", json={"evaluation": evaluation}))
    for answer in answers:
        assert answer.status_code == 410, answer.request.url
        assert answer.json()["detail"] == f"the record of episode '{one}' is missing or damaged on the server"
    # What the database remembers can still be read.
    assert shop.client.get(f"/v1/episodes/{one}").status_code == 200
    assert shop.client.get(f"/v1/evaluations/{evaluation}/metrics").status_code == 200


@pytest.mark.parametrize("damage", ["missing", "truncated"])
def test_damaged_trajectories_too(shop: Shop, damage: str) -> None:
    _, (one,) = shop.evaluation(shop.submission("agent"), [on_a_network()])
    table = shop.path(one).with_suffix(".parquet")
    if damage == "missing":
        table.unlink()
    else:
        table.write_bytes(table.read_bytes()[:-10])
    for what in ("replay", "trajectory"):
        assert shop.client.get(f"/v1/episodes/{one}/{what}").status_code == 410
    assert shop.client.get(f"/v1/episodes/{one}/record").status_code == 200


def test_an_episode_without_a_record_says_so(shop: Shop) -> None:
    _, (one,) = shop.evaluation(shop.submission("agent"), records(50.0), status=EvaluationStatus.RUNNING)
    with shop.services.database.session() as session:
        found = session.get(Episode, one)
        assert found is not None
        found.status, found.record_hash, found.summary = EpisodeStatus.RUNNING, None, None
    answer = shop.client.get(f"/v1/episodes/{one}/record")
    assert (answer.status_code, answer.json()["detail"]) == (409, f"episode '{one}' is running: it has no record")
    assert shop.client.get(f"/v1/episodes/{one}").json()["summary"] is None


def test_a_network_that_has_changed_is_told(shop: Shop) -> None:
    other = on_a_network().model_copy(update={"versions": episode().versions})
    _, (one,) = shop.evaluation(shop.submission("agent"), [other])
    answer = shop.client.get(f"/v1/episodes/{one}/replay")
    assert answer.status_code == 409
    assert "was driven on network 'ingolstadt'" in answer.json()["detail"]


def test_a_remote_or_realtime_drive_cannot_be_repeated(shop: Shop) -> None:
    remote = shop.submission("far", kind=AgentKind.REMOTE)
    _, (one,) = shop.evaluation(remote, records(50.0))
    _, (other,) = shop.evaluation(shop.submission("hasty"), records(50.0), slow_policy="realtime")
    for episode_id, why in ((one, "remote agent"), (other, "real time")):
        verified = shop.client.post(f"/v1/episodes/{episode_id}/verify", headers=shop.token("ann"))
        explained = shop.client.get(f"/v1/episodes/{episode_id}/explanation", params={"tick": 0})
        for answer in (verified, explained):
            assert answer.status_code == 409
            assert why in answer.json()["detail"]


def test_verifying_needs_a_token(shop: Shop) -> None:
    _, (one,) = shop.evaluation(shop.submission("agent"), records(50.0))
    assert shop.client.post(f"/v1/episodes/{one}/verify").status_code == 401


@pytest.mark.parametrize("name", ["ep-0", "%00", "..%2f..%2fetc", "x" * 200])
def test_unknown_and_impossible_episodes(shop: Shop, name: str) -> None:
    for what in ("", "/record", "/trajectory", "/events", "/replay", "/explanation?tick=0"):
        assert shop.client.get(f"/v1/episodes/{name}{what}").status_code in (404, 422)


# Comparison, metrics, rescoring


def test_different_benchmark_versions_are_not_compared(shop: Shop) -> None:
    a, _ = shop.evaluation(shop.submission("a"), records(50.0))
    other = shop.benchmark(stop_on_collision=True)
    b, _ = shop.evaluation(shop.submission("b"), records(50.0), benchmark=other)
    answer = shop.client.get("/v1/comparison", params={"evaluation": [a, b]})
    assert answer.status_code == 422
    assert "one benchmark version" in answer.json()["detail"]
    c, _ = shop.evaluation(shop.submission("c"), records(10.0))
    compared = shop.client.get("/v1/comparison", params={"evaluation": [a, c]}).json()
    assert compared["pairs"][0]["scores"]["driving_score"]["difference"]["mean"] == pytest.approx(40.0)
    assert shop.client.get("/v1/comparison", params={"evaluation": [a]}).status_code == 422
    assert shop.client.get("/v1/comparison", params={"evaluation": [a, "ev-0"]}).status_code == 404


def test_answers_are_what_the_interface_describes(shop: Shop) -> None:
    a, _ = shop.evaluation(shop.submission("a"), [episode(ego(HIT, RED), name="s")])
    b, _ = shop.evaluation(shop.submission("b"), [episode(ego(), name="s")])
    answers = {
        LeaderboardView: shop.client.get("/v1/leaderboard", params={"benchmark": "made"}),
        ComparedView: shop.client.get("/v1/comparison", params={"evaluation": [a, b]}),
        MetricsView: shop.client.get(f"/v1/evaluations/{a}/metrics"),
        RescoredView: shop.client.post("/v1/rescore", json={"evaluation": a}),
    }
    for view, answer in answers.items():
        assert json.loads(view.model_validate(answer.json()).model_dump_json()).keys() == answer.json().keys()


def test_infractions_on_the_map(shop: Shop) -> None:
    hit = HIT.model_copy(update={"x_m": 12.346, "y_m": -6.0})
    made = [episode(ego(hit), name="a", cell="all"), episode(ego(), name="b", cell="all")]
    evaluation, ids = shop.evaluation(shop.submission("agent"), made)
    document = shop.client.get(f"/v1/evaluations/{evaluation}/infractions").json()
    (one,) = document["infractions"]
    assert (one["kind"], one["x_m"], one["y_m"], one["time_s"]) == ("collision_vehicle", 12.35, -6.0, 2.0)
    assert (one["network"], one["episode"], one["scenario"]) == ("ingolstadt", ids[0], "a")
    assert document["networks"] == ["ingolstadt"]


@pytest.mark.parametrize("rules", ["1.0", "2.0", "2.1"])
def test_rescoring_equals_the_command_line(shop: Shop, rules: str) -> None:
    made = [episode(ego(HIT, SLOW), name="a"), episode(ego(RED, HIT), name="b"), episode(ego(), name="c")]
    evaluation, ids = shop.evaluation(shop.submission("agent"), made)
    order = {"evaluation": evaluation, "rules": rules, "irs_length": "route"}
    answer = shop.client.post("/v1/rescore", json=order).json()
    paths = [str(shop.path(one)) for one in ids]
    printed = CliRunner().invoke(cli, ["score", *paths, "--rules", rules, "--irs-length", "route", "--json"])
    expected = json.loads(printed.output)
    for key in ("scores", "per_km", "statuses", "km", "episodes", "rules", "irs_length"):
        assert answer[key] == expected[key], key
    assert [d["driving_score"] for d in answer["drives"]] == [d["driving_score"] for d in expected["drives"]]
    assert [d["irs"] for d in answer["drives"]] == [d["irs"] for d in expected["drives"]]


def test_rules_by_hand(shop: Shop) -> None:
    evaluation, _ = shop.evaluation(shop.submission("agent"), [episode(ego(HIT, HIT, RED))])

    def score(**order: object) -> dict[str, float]:
        answer = shop.client.post("/v1/rescore", json={"evaluation": evaluation, **order}).json()
        return {name: one["mean"] for name, one in answer["scores"].items()}

    assert score()["driving_score"] == pytest.approx(20.16)
    assert score(rules="2.1")["driving_score"] == pytest.approx(80 / 2.8)
    assert score(irs_lambda=0)["irs"] == pytest.approx(80.0)
    # exp(-1 * (0.4 + 0.4 + 0.3) / 0.8 km completed, or 1 km of route)
    assert score(irs_lambda=1)["irs"] == pytest.approx(80 * 2.718281828 ** (-1.1 / 0.8))
    assert score(irs_lambda=1, irs_length="route")["irs"] == pytest.approx(80 * 2.718281828**-1.1)
    for wrong in ({"rules": "3.0"}, {"irs_lambda": -1}, {"irs_lambda": "NaN"}, {"more": 1}):
        assert shop.client.post("/v1/rescore", json={"evaluation": evaluation, **wrong}).status_code == 422


def test_an_evaluations_metrics(shop: Shop) -> None:
    evaluation, _ = shop.evaluation(shop.submission("agent"), records(50.0, 60.0))
    document = shop.client.get(f"/v1/evaluations/{evaluation}/metrics").json()
    assert document["all"]["scores"]["driving_score"]["mean"] == pytest.approx(55.0)
    table = csv.DictReader(io.StringIO(shop.client.get(f"/v1/evaluations/{evaluation}/metrics.csv").text))
    assert [line["row"] for line in table] == ["drive", "drive", "cell", "all"]
    empty, _ = shop.evaluation(shop.submission("new"), [], status=EvaluationStatus.QUEUED)
    assert shop.client.get(f"/v1/evaluations/{empty}/metrics").json()["all"]["drives"] == 0
    assert shop.client.post("/v1/rescore", json={"evaluation": empty}).status_code == 409
    assert shop.client.get("/v1/evaluations/ev-0/metrics").status_code == 404


def test_lost_episodes_count_as_zero_in_the_metrics_with_all_their_egos(shop: Shop) -> None:
    fleet = load_benchmark("fleet")  # eight egos at once
    with shop.services.database.session() as session:
        document = fleet.model_dump(mode="json")
        session.add(BenchmarkVersion(sha256=fleet.sha256, name="fleet", document=document))
    evaluation, _ = shop.evaluation(shop.submission("agent"), records(50.0, 60.0), benchmark=fleet.sha256, ranked=False)
    with shop.services.database.session() as session:
        lost = {"evaluation_id": evaluation, "position": 2, "scenario": "s", "cell": "ingolstadt", "seed": 0}
        session.add(Episode(id="ep-lost", status=EpisodeStatus.LOST, **lost))
    whole = shop.client.get(f"/v1/evaluations/{evaluation}/metrics").json()
    assert (whole["all"]["lost"], whole["cells"]["ingolstadt"]["lost"]) == (8, 8)
    assert whole["all"]["scores"]["driving_score"]["mean"] == pytest.approx(55.0)
    assert whole["all"]["scores_lost_as_zero"]["driving_score"]["mean"] == pytest.approx(110.0 / 10)
    again = shop.client.post("/v1/rescore", json={"evaluation": evaluation}).json()
    assert again["lost"] == 8
    assert again["scores_lost_as_zero"]["driving_score"]["mean"] == pytest.approx(110.0 / 10)
    assert again["scores_lost_as_zero"]["irs"]["n"] == 10
