"""The league: an edition is driven, resumed, told on a page and checked by hashes; two entrants, two disciplines."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from dohyo.agents.league import league
from dohyo.agents.league.edition import Edition, read_edition
from dohyo.agents.league.figures import front, profiles
from dohyo.agents.league.page import page
from dohyo.agents.league.standings import standings
from dohyo.agents.registry import agent_entries
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row, read_rows
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.families import Family
from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError

SMALL = """
name = "small"
[[discipline]]
name = "junction"
title = "A junction"
told = "One drive."
benchmark = "quickstart"
sample = 1
seeds = [5]
headline = "driving_score"
[[discipline]]
name = "lots"
title = "Lots"
told = "Two lots."
benchmark = "parking-simple"
seeds = [1079000000, 2]
headline = "success"
then = ["aligned", "time_s"]
[[entrant]]
name = "reckless"
family = "driving"
system = "sees nobody"
reported = { junction = "3, elsewhere" }
[[entrant]]
name = "three karts"
agent = "parking"
settings = { policy = "three" }
family = "parking"
system = "DPPO-IL"
weights = ["parking/checkpoints/three.safetensors"]
"""
DOCS = Path(__file__).parents[3] / "docs"
dohyo = CliRunner()


@pytest.fixture(scope="module")
def edition(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("edition") / "small.toml"
    path.write_text(SMALL)
    return path


@pytest.fixture(scope="module")
def driven(edition: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a league that the command has driven."""
    out = tmp_path_factory.mktemp("league")
    arguments = ["league", "run", "--edition", str(edition), "--out", str(out), "--workers", "1"]
    done = dohyo.invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert "2 of 2: three karts in lots" in done.output
    return out


def rows_of(**scores: list[float]) -> list[Row]:
    """Drives of entrants in one discipline, in the same scenarios."""
    return [
        Row(Cell(arm, None, "junction", f"m{i}", 1)._asdict())
        | {"driving_score": score, "driven_m": 500.0, "infractions": {}}
        for arm, found in scores.items()
        for i, score in enumerate(found)
    ]


def of_drivers(*names: str) -> Edition:
    small = {"name": "junction", "title": "J", "told": "T.", "benchmark": "quickstart", "headline": "driving_score"}
    entrants = [{"name": name, "family": "driving", "system": "S"} for name in names]
    return Edition(name="e", discipline=[small], entrant=entrants)  # type: ignore[arg-type]  # checked by pydantic


def test_rows_hold_scores_and_the_hash_of_the_record_that_an_evaluation_keeps(driven: Path) -> None:
    rows = {(row["benchmark"], row["arm"], row["seed"]): row for row in read_rows(driven)}
    assert list(rows) == [
        ("junction", "reckless", 5), ("lots", "three karts", 1079000000), ("lots", "three karts", 1079000001),
    ]  # fmt: skip
    (record,) = (driven / "junction" / "reckless" / "records").glob("*.json")
    assert rows["junction", "reckless", 5]["record_hash"] == json.loads(record.read_text())["record_hash"]
    assert 0.0 <= rows["junction", "reckless", 5]["driving_score"] < 100.0


def test_a_second_run_drives_nothing_and_changes_no_row(driven: Path, edition: Path) -> None:
    before = (driven / "rows.jsonl").read_bytes()
    (record,) = (driven / "junction" / "reckless" / "records").glob("*.json")
    made = record.stat().st_mtime_ns
    league.run(read_edition(edition), driven, disciplines=["junction"])
    assert record.stat().st_mtime_ns == made
    assert sorted((driven / "rows.jsonl").read_bytes().splitlines()) == sorted(before.splitlines())


def test_rows_driven_again_have_the_same_hashes_and_a_changed_one_is_found(driven: Path, edition: Path) -> None:
    arguments = ["league", "verify", "--edition", str(edition), "--rows", str(driven), "--sample", "1"]
    done = dohyo.invoke(app, arguments)
    assert done.exit_code == 0, done.output
    assert done.output.count(": same") == 2
    changed = [{**row, "record_hash": "0" * 64} for row in read_rows(driven)]
    checks = league.verify(read_edition(edition), changed, 1, 0)
    assert [check.same for check in checks] == [False, False]


def test_a_row_is_driven_again_alone_with_its_seed_or_that_of_its_excerpt() -> None:
    edition = read_edition()
    town, excerpts = edition.discipline("town"), edition.discipline("excerpts")
    again = league.only(town, {"scenario": "town-test.regular.test.m01", "seed": town.seeds[1]})
    assert (again.only, again.sample, again.seeds) == (("town-test.regular.test.m01",), None, (town.seeds[1],))
    again = league.only(excerpts, {"scenario": "changing-lane.m02", "seed": 4711})
    assert (again.only, again.even, again.seeds) == (("changing-lane.m02",), False, excerpts.seeds)


def test_the_page_names_places_sources_and_sizes(driven: Path, edition: Path) -> None:
    text = dohyo.invoke(app, ["league", "table", "--edition", str(edition), "--rows", str(driven)]).output
    assert "| 1 | **reckless** |" in text
    assert "*3, elsewhere*" in text
    assert "| three karts | DPPO-IL | — | 26,136 |" in text


def test_only_significant_differences_make_somebody_better() -> None:
    many, few = range(20), range(3)
    edition = of_drivers("a", "b")
    clear = rows_of(a=[50.0 + i for i in many], b=[20.0 + i for i in many])
    first, second = standings(edition.disciplines[0], edition.entrants, clear)
    assert (first.entrant.name, first.ahead_of, second.behind) == ("a", ("b",), ("a",))
    unclear = rows_of(a=[50.0 + i for i in few], b=[20.0 + i for i in few])
    assert [place.ahead_of for place in standings(edition.disciplines[0], edition.entrants, unclear)] == [(), ()]
    assert "| b | 29.5 |" in page(edition, clear)
    assert "| b | **21.0** |" in page(edition, unclear)


def test_lower_errors_lead() -> None:
    edition = of_drivers("a", "b")
    errors = edition.disciplines[0].model_copy(update={"headline": "mse"})
    rows = [row | {"mse": row["driving_score"]} for row in rows_of(a=[9.0] * 20, b=[3.0] * 20)]
    first, second = standings(errors, edition.entrants, rows)
    assert (first.entrant.name, first.ahead_of, second.behind) == ("b", ("a",), ("b",))


def test_lost_drives_are_counted_and_in_no_mean() -> None:
    edition = of_drivers("a")
    rows = rows_of(a=[50.0, 60.0])
    rows[0] = {name: rows[0][name] for name in Cell._fields} | {"lost": "lost: simulation failed"}
    (place,) = standings(edition.disciplines[0], edition.entrants, rows)
    assert (place.score.mean, place.lost) == (60.0, 1)


def test_the_published_edition_has_agents_benchmarks_and_weights_that_exist() -> None:
    edition = read_edition()
    drivers = [one for one in edition.entrants if one.family in (Family.DRIVING, Family.PARKING)]
    assert {one.registered for one in drivers} <= set(agent_entries())
    assert all(one.benchmark in benchmark_names(one.family) for one in edition.disciplines)
    assert all(one.parameters > 0 for one in edition.entrants if one.weights)
    assert all(name in {one.name for one in edition.disciplines} for one in edition.entrants for name in one.reported)


def test_the_page_says_which_seeds_had_been_looked_at() -> None:
    edition = of_drivers("a")
    assert "Nobody had looked at drives on them." in page(edition, rows_of(a=[50.0]))
    told = edition.model_copy(update={"looked_at": "Seed 5 was driven before."})
    assert "Seed 5 was driven before." in page(told, rows_of(a=[50.0]))


def test_the_front_leaves_out_who_is_slower_and_no_better() -> None:
    edition = of_drivers("fast", "slow", "best")
    rows = rows_of(fast=[50.0, 60.0], slow=[40.0, 50.0], best=[80.0, 90.0])
    timed = [row | {"decision_ms": {"fast": 1.0, "slow": 2.0, "best": 3.0}[row["arm"]]} for row in rows]
    places = standings(edition.disciplines[0], edition.entrants, timed)
    assert [place.entrant.name for place in front(places)] == ["fast", "best"]


def test_a_profile_has_the_infractions_per_km_of_all_driving_disciplines() -> None:
    edition = of_drivers("a", "idle")
    rows = [row | {"infractions": {"red_light": 1}} for row in rows_of(a=[50.0, 60.0])]
    found = profiles(edition, rows)
    assert list(found) == ["a"]
    assert (found["a"]["red_light"], found["a"]["stop_sign"]) == (2.0, 0.0)


@pytest.mark.slow
def test_the_published_page_is_what_the_stored_rows_give(tmp_path: Path) -> None:
    assert dohyo.invoke(app, ["league", "table", "--out", str(tmp_path / "page.md")]).exit_code == 0
    assert (tmp_path / "page.md").read_text() == (DOCS / "league.md").read_text()


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name = 3", r"name: Input should be a valid string"),
        ('name = "x"\ndiscipline = []\nentrant = []\nseeds = [1]', r"seeds"),
        ("name =", "is no TOML"),
    ],
)
def test_a_file_that_is_no_edition_is_refused(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "edition.toml").write_text(text)
    with pytest.raises(InvalidInputError, match=said):
        read_edition(tmp_path / "edition.toml")


def test_names_that_are_not_there_and_rows_that_are_missing_are_refused(edition: Path, tmp_path: Path) -> None:
    for arguments, said in (
        (("run", "--disciplines", "juncton"), "no discipline named 'juncton'; did you mean 'junction'"),
        (("run", "--entrants", "nobody"), "no entrant named 'nobody'"),
        (("run", "--disciplines", "lots", "--entrants", "reckless"), "expected entrants for lots, got reckless"),
        (("table", "--rows", str(tmp_path)), "expected rows of the league, found none"),
    ):
        where = () if "table" in arguments else ("--out", str(tmp_path / "out"))
        done = dohyo.invoke(app, ["league", *arguments, "--edition", str(edition), *where])
        assert done.exit_code != 0
        assert said in str(done.exception or done.output)
