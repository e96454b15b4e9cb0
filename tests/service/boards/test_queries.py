"""The same queries on SQLite and on PostgreSQL."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import delete, false, select

from dohyo.service.boards import queries as reading
from dohyo.service.boards.model import Ranking, Result
from dohyo.service.boards.rankings import open_ranking_id
from dohyo.service.boards.results import is_behind
from dohyo.service.boards.standings import Standings
from dohyo.service.evaluations.model import Episode, Evaluation, EvaluationStatus
from tests.evaluation.builders import ego, episode, lost
from tests.service.episodes.test_reading import records
from tests.service.shop import Shop


@pytest.fixture
def shop(tmp_path: Path, database_url: str) -> Iterator[Shop]:
    made = Shop(tmp_path / "data", url=database_url)
    yield made
    made.services.database.close()


def test_complete_runs_of_a_ranking_get_a_result_once(shop: Shop) -> None:
    one, two = shop.submission("one"), shop.submission("two", owner="bob", track="sensors")
    first, _ = shop.evaluation(one, records(1.0))
    again, _ = shop.evaluation(one, records(2.0))
    other, _ = shop.evaluation(two, records(3.0), owner="bob")
    shop.evaluation(two, records(4.0), status=EvaluationStatus.FAILED, owner="bob")
    shop.evaluation(two, records(5.0), ranked=False, owner="bob")
    database, standings = shop.services.database, Standings()
    with database.reading() as session:
        ranking = session.get_one(Ranking, open_ranking_id(shop.benchmark()))
        assert is_behind(session, ranking)
        assert reading.benchmark_names(session) == ["made"]
        assert [one.sha256 for one in reading.benchmark_versions(session, "made")] == [shop.benchmark()]

    def listed(**rest: Any) -> list[str]:
        return [one.contender.evaluation for one in standings.places(database, ranking, "driving_score", **rest)]

    assert listed() == listed() == [other, first]
    assert listed(track="sensors") == [other]
    assert listed(only=frozenset((first, again))) == [first]
    with database.session() as session:
        assert not is_behind(session, ranking)
        assert {one.evaluation_id: one.score for one in session.scalars(select(Result))} == {
            first: pytest.approx(1.0),
            again: pytest.approx(2.0),
            other: pytest.approx(3.0),
        }
        session.delete(session.get_one(Result, other))
        session.execute(delete(Episode).where(Episode.evaluation_id == other))
        session.execute(delete(Evaluation).where(Evaluation.id == other))
    assert listed() == [first]


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


def test_episodes_are_found_with_their_evaluation(shop: Shop) -> None:
    evaluation, (one,) = shop.evaluation(shop.submission("agent"), [lost()])
    with shop.services.database.reading() as session:
        assert reading.find_episode(session, one, false()) is None
        found = reading.find_episode(session, one, Evaluation.owner == "ann")
        assert found is not None
        assert (found[0].id, found[1].id, found[1].benchmark.name) == (one, evaluation, "made")
        assert [episode.id for episode in reading.recorded_episodes(session, evaluation)] == [one]
        assert reading.count_by_status(session) == ({"done": 1}, {"done": 1})


def test_the_routes_answer(shop: Shop) -> None:
    evaluation, (one,) = shop.evaluation(shop.submission("agent"), [episode()])
    for path in (f"/v1/episodes/{one}", "/v1/leaderboard?benchmark=made", f"/v1/evaluations/{evaluation}/metrics"):
        assert shop.client.get(path).status_code == 200
    assert shop.client.get("/v1/episodes/%00").status_code == 422
