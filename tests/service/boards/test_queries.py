"""The same queries on SQLite and on PostgreSQL."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dohyo.service.boards import queries as reading
from dohyo.service.evaluations.model import EvaluationStatus
from tests.evaluation.builders import ego, episode, lost
from tests.service.episodes.test_reading import records
from tests.service.shop import Shop


@pytest.fixture
def shop(tmp_path: Path, database_url: str) -> Iterator[Shop]:
    made = Shop(tmp_path / "data", url=database_url)
    yield made
    made.services.database.close()


def test_what_is_ranked(shop: Shop) -> None:
    one, two = shop.submission("one"), shop.submission("two", owner="bob", track="sensors")
    shop.evaluation(one, records(1.0))
    first, _ = shop.evaluation(one, records(2.0))
    second, _ = shop.evaluation(two, records(3.0), owner="bob")
    shop.evaluation(two, records(4.0), status=EvaluationStatus.FAILED, owner="bob")
    sha256 = shop.benchmark()
    with shop.services.database.reading() as session:
        assert reading.ranked_evaluations(session, sha256, None, None) == sorted([first, second])
        assert reading.ranked_evaluations(session, sha256, "sensors", None) == [second]
        assert reading.ranked_evaluations(session, sha256, None, "ann") == [first]
        assert reading.ranked_evaluations(session, "0" * 64, None, None) == []
        assert reading.benchmark_names(session) == ["made"]
        assert [one.sha256 for one in reading.benchmark_versions(session, "made")] == [sha256]


def test_entries_hold_drives_in_order(shop: Shop) -> None:
    made = [episode(ego(name="b"), ego(name="a"), name="z"), episode(ego(), name="y", seed=4)]
    evaluation, ids = shop.evaluation(shop.submission("agent"), made)
    with shop.services.database.reading() as session:
        found = reading.entries(session, [evaluation, "ev-0"])
    assert list(found) == [evaluation]
    entry = found[evaluation]
    assert [drive.key for drive in entry.drives] == [("z", 0, "b"), ("z", 0, "a"), ("y", 4, "ego")]
    assert [drive.episode for drive in entry.drives] == [ids[0], ids[0], ids[1]]
    assert (entry.agent, entry.kind, entry.seeds, entry.benchmark) == ("agent", "builtin", (0, 4), "made")


def test_what_one_may_see(shop: Shop) -> None:
    evaluation, (one,) = shop.evaluation(shop.submission("agent"), [lost()])
    with shop.services.database.reading() as session:
        assert reading.find_evaluation(session, evaluation, None) is not None
        assert reading.find_evaluation(session, evaluation, "ann") is not None
        assert reading.find_evaluation(session, evaluation, "bob") is None
        assert reading.find_episode(session, one, "bob") is None
        found = reading.find_episode(session, one, "ann")
        assert found is not None
        assert (found[0].id, found[1].id, found[1].benchmark.name) == (one, evaluation, "made")
        assert [episode.id for episode in reading.recorded_episodes(session, evaluation)] == [one]
        assert reading.count_by_status(session) == ({"done": 1}, {"done": 1})


def test_the_routes_answer(shop: Shop) -> None:
    evaluation, (one,) = shop.evaluation(shop.submission("agent"), [episode()])
    for path in (f"/v1/episodes/{one}", "/v1/leaderboard?benchmark=made", f"/v1/evaluations/{evaluation}/metrics"):
        assert shop.client.get(path).status_code == 200
    assert shop.client.get("/v1/episodes/%00").status_code == 422
