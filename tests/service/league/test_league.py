"""The league of a service: the stored standings, for everybody who may read, and in the navigation if it is wanted."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.agents.league.edition import PUBLISHED, read_edition
from dohyo.agents.league.rows import read_league_rows, versions_of
from dohyo.service.league import routes
from dohyo.service.server import run
from dohyo.service.settings import Settings
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.harness import Harness, running


def test_the_standings_are_those_of_the_published_rows(service: Harness) -> None:
    document = service.client.get("/v1/league").json()
    edition = read_edition()
    assert document["versions"] == sorted(versions_of(PUBLISHED, read_league_rows(edition, PUBLISHED)))
    assert (document["edition"], document["looked_at"]) == (edition.name, list(edition.looked_at))
    assert [one["name"] for one in document["disciplines"]] == [one.name for one in edition.disciplines]
    parking = next(one for one in document["disciplines"] if one["name"] == "parking")
    best, *others = parking["places"]
    assert best["leads"]
    headline = parking["measures"][0]["key"]
    assert all(best["scores"][headline]["mean"] >= one["scores"][headline]["mean"] for one in others)


def test_who_may_read_nothing_reads_no_standings(private: Harness) -> None:
    assert private.client.get("/v1/league").status_code == 401


def test_damaged_rows_are_no_fault_of_the_reader_and_keep_a_service_from_its_start(
    service: Harness, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "rows.jsonl").write_text('{"arm": "mbappe", "benchm')
    monkeypatch.setattr(routes, "PUBLISHED", tmp_path)
    routes.league.cache_clear()
    answer = service.client.get("/v1/league")
    assert answer.status_code == 500
    assert "rows.jsonl" not in answer.text
    with pytest.raises(InvalidInputError, match="line 1: expected a JSON object"):
        run(Settings(data=tmp_path / "refused", league=True), lambda url, token: None)
    assert not (tmp_path / "refused").exists()


def test_the_pages_lead_to_the_league_where_the_operator_wants_it(service: Harness, tmp_path: Path) -> None:
    link = 'href="/league"'
    assert link not in service.client.get("/", headers={"accept": "text/html"}).text
    with running(tmp_path / "other", league=True) as wanted:
        assert link in wanted.client.get("/", headers={"accept": "text/html"}).text
