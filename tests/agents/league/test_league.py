"""The league: an edition is driven, resumed, told on a page and checked by hashes; two entrants, two disciplines."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from dohyo.agents.league import evaluating, league, localization
from dohyo.agents.league.edition import Discipline, Edition, Entrant, read_edition
from dohyo.agents.league.figures import Driver, drivers, front, label_places, profiles
from dohyo.agents.league.page import page
from dohyo.agents.league.rows import check_version, read_comparable_rows
from dohyo.agents.league.standings import standings
from dohyo.agents.registry import agent_entries
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row, read_rows
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.benchmarks.documents import benchmark_names
from dohyo.evaluation.families import Family
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.evaluation.running.manifest import manifest_of
from dohyo.evaluation.running.run import Result
from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import ego, episode, infraction

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


def test_differences_of_seeds_of_few_missions_are_none_of_missions() -> None:
    """Two arms on eight missions with one seed, and on one mission with eight."""
    edition = of_drivers("a", "b")
    scores = {"a": [90.0 + i for i in range(8)], "b": [20.0 + i for i in range(8)]}
    missions = rows_of(**scores)
    seeds = [row | {"scenario": "m0", "seed": i} for arm in scores for i, row in enumerate(of_arm(missions, arm))]
    assert "That leaves: junction 1 of 1." in page(edition, missions)
    assert "That leaves: junction 0 of 1." in page(edition, seeds)


def test_the_overview_has_the_best_first_and_who_did_not_drive_last() -> None:
    text = page(of_drivers("absent", "worse", "better"), rows_of(worse=[20.0], better=[30.0]))
    overview = text[: text.index("## ")]
    assert overview.index("| better |") < overview.index("| worse |") < overview.index("| absent |")


def of_arm(rows: list[Row], arm: str) -> list[Row]:
    return [row for row in rows if row["arm"] == arm]


def test_rows_hold_scores_and_the_hash_of_the_record_that_an_evaluation_keeps(driven: Path) -> None:
    rows = {(row["benchmark"], row["arm"], row["seed"]): row for row in read_rows(driven)}
    assert list(rows) == [
        ("junction", "reckless", 5), ("lots", "three karts", 1079000000), ("lots", "three karts", 1079000001),
    ]  # fmt: skip
    (record,) = (driven / "junction" / "reckless" / "records").glob("*.json")
    assert rows["junction", "reckless", 5]["record_hash"] == json.loads(record.read_text())["record_hash"]
    assert 0.0 <= rows["junction", "reckless", 5]["driving_score"] < 100.0


def test_a_drive_is_scored_by_the_rules_of_its_benchmark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    edition = of_drivers("reckless")
    hit = ego(infraction(InfractionKind.COLLISION_VEHICLE), infraction(InfractionKind.RED_LIGHT))
    for rules, score in (("2.0", 80.0 * 0.6 * 0.7), ("2.1", 80.0 / (1.0 + 0.7 + 0.4))):
        benchmark = load_benchmark("quickstart").model_copy(update={"rules": rules})
        manifest = manifest_of({"ego": hit.agent}, benchmark, benchmark.sha256)
        result = Result(manifest, (episode(hit),), (tmp_path / "one.json",), resumed=0, ordered=1)
        monkeypatch.setattr(evaluating, "run_benchmark", lambda *_, result=result, **__: result)
        (row,) = evaluating.evaluate(edition.discipline("junction"), edition.entrants[0], tmp_path)
        assert row["driving_score"] == pytest.approx(score)


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
    alone = dohyo.invoke(app, [*arguments, "--entrants", "reckless"])
    assert (alone.exit_code, alone.output.count(": same")) == (0, 1)
    assert "nobody" in str(dohyo.invoke(app, [*arguments, "--entrants", "nobody"]).exception)
    drive, lot, _ = sorted(read_rows(driven), key=lambda row: str(row["benchmark"]))
    changed = [{**drive, "record_hash": "0" * 64}, {**lot, "success": 50.0, "time_s": 1.0}]
    checks = league.verify(read_edition(edition), changed, 1, 0)
    assert [check.differences for check in checks] == [["record_hash"], ["success", "time_s"]]


def test_a_row_is_driven_again_alone_with_its_seed_or_that_of_its_excerpt() -> None:
    edition = read_edition()
    town, excerpts = edition.discipline("town"), edition.discipline("excerpts")
    again = league.only(town, {"scenario": "town-test.regular.test.m01", "seed": town.seeds[1]})
    assert (again.only, again.sample, again.seeds) == (("town-test.regular.test.m01",), None, (town.seeds[1],))
    again = league.only(excerpts, {"scenario": "changing-lane.m02", "seed": 4711})
    assert (again.only, again.even, again.seeds) == (("changing-lane.m02",), False, excerpts.seeds)


def test_the_page_is_not_written_in_the_place_of_a_folder(driven: Path, edition: Path, tmp_path: Path) -> None:
    arguments = ["league", "table", "--edition", str(edition), "--rows", str(driven)]
    done = dohyo.invoke(app, [*arguments, "--out", str(tmp_path)])
    assert isinstance(done.exception, InvalidInputError)
    assert f"cannot write '{tmp_path}': expected a file, got a folder" in str(done.exception)


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


def test_equal_scores_share_a_place_and_who_has_no_value_comes_last() -> None:
    edition = of_drivers("a", "b", "c")
    text = page(edition, rows_of(a=[50.0] * 3, b=[70.0] * 3, c=[70.0] * 3))
    assert [line.split(" |")[0] for line in text.splitlines() if line.startswith(("| 1 ", "| 3 "))] == [
        "| 1",
        "| 1",
        "| 3",
    ]
    times = edition.disciplines[0].model_copy(update={"headline": "time_s"})
    rows = [row | {"time_s": None if row["arm"] == "a" else 9.0} for row in rows_of(a=[0.0] * 3, b=[0.0] * 3)]
    first, last = standings(times, edition.entrants, rows)
    assert [(place.entrant.name, place.leads) for place in (first, last)] == [("b", True), ("a", False)]


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


@pytest.mark.parametrize(("missions", "few"), [(5, True), (6, False)])
def test_the_page_says_where_missions_are_too_few_to_tell(missions: int, few: bool) -> None:
    """Two entrants make one pair: six missions on one side have a p-value of 2 / 64."""
    edition = of_drivers("good", "bad")
    rows = [
        row | {"scenario": f"mission-{number % missions}", "seed": number // missions}
        for arm, score in (("good", 90.0), ("bad", 10.0))
        for number, row in enumerate(rows_of(**{arm: [score + one for one in range(2 * missions)]}))
    ]
    name = edition.disciplines[0].name
    assert (f"In {name} there are too few missions to show any difference" in page(edition, rows)) == few
    assert f"{name} {0 if few else 1} of 1." in page(edition, rows)


def test_the_page_says_which_seeds_had_been_looked_at() -> None:
    edition = of_drivers("a")
    assert "Who had looked at drives with them is not told." in page(edition, rows_of(a=[50.0]))
    told = edition.model_copy(update={"looked_at": ("Seed 5 was driven before.", "Seed 6, too.")})
    assert "* Seed 5 was driven before.\n* Seed 6, too.\n" in page(told, rows_of(a=[50.0]))


def test_the_front_leaves_out_who_is_slower_and_no_better() -> None:
    edition = of_drivers("fast", "slow", "best")
    rows = rows_of(fast=[50.0, 60.0], slow=[40.0, 50.0], best=[80.0, 90.0])
    timed = [row | {"decision_ms": {"fast": 1.0, "slow": 2.0, "best": 3.0}[row["arm"]]} for row in rows]
    found = drivers(edition, timed)
    assert [(one.name, one.score) for one in found] == [("fast", 55.0), ("slow", 45.0), ("best", 85.0)]
    assert [one.decision_ms for one in found] == pytest.approx([1.0, 2.0, 3.0])
    assert [one.name for one in front(found)] == ["fast", "best"]


def test_a_driver_that_left_out_a_discipline_is_not_compared_by_cost() -> None:
    edition = of_drivers("whole", "part")
    assert [one.name for one in drivers(edition, [row | {"decision_ms": 1.0} for row in rows_of(whole=[50.0])])] == [
        "whole"
    ]


def test_names_stand_where_they_cover_nothing() -> None:
    alone, beside = Driver("alone", 1.0, 50.0, 1.0), Driver("beside", 1.4, 50.0, 1.0)
    assert label_places([alone]) == ["middle right"]
    assert label_places([alone, beside]) == ["middle left", "middle right"]


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


def test_the_page_is_made_without_rows_that_are_not_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(localization, "STUDY", tmp_path / "results" / "study.json")
    assert localization.section().splitlines() == ["## Where a vehicle is", "", localization.NOT_HERE]


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


BROKEN: Mapping[str, tuple[str, str, str]] = {
    "unknown benchmark": ("quickstart", "quickstrat", "no benchmark named 'quickstrat'"),
    "negative seed": ("[5]", "[-5]", "seeds.0: Input should be greater than or equal to 0, got -5"),
    "seed twice": ("[5]", "[5, 5]", "discipline 'junction': expected at least one seed, and each once"),
    "no seed": ("seeds = [5]", "", "discipline 'junction': expected at least one seed, and each once, got []"),
    "no mission": ("sample = 1", "sample = 0", "sample: Input should be greater than or equal to 1, got 0"),
    "unknown measure": ("driving_score", "drving_score", "expected measures of 'quickstart' (driving_score, "),
    "measure of another family": ('["aligned", "time_s"]', '["irs"]', "expected measures of 'parking-simple'"),
    "measure of recorded traffic": ('"driving_score"', '"closed_loop"', "expected measures of 'quickstart'"),
    "no pair of seeds": ("[1079000000, 2]", "[5, 6, 7]", "expected seeds = [the first seed, the number of lots]"),
    "sample of lots": ("[1079000000, 2]", "[5, 6]\nsample = 3", "'only', 'even' and 'sample' of driving alone"),
    "name that leaves its folder": ('"junction"', '"../junction"', "discipline.0.name: String should match"),
    "title of two lines": ('"A junction"', '"A\\n# junction"', "discipline.0.title: String should match"),
    "names of one folder": ('name = "three karts"', 'name = "reckless"', "expected different names of entrants"),
    "number of nowhere": ("{ junction =", "{ town =", "entrant 'reckless': expected reported numbers of a discipline"),
    "unknown agent": ('agent = "parking"', 'agent = "parkin"', "no agent named 'parkin'; did you mean 'parking'"),
    "weights that are missing": ("three.safetensors", "five.safetensors", "expected weights (.safetensors or .onnx)"),
    "weights that are none": ("checkpoints/three.safetensors", "README.md", "expected weights as safetensors or ONNX"),
    "wrong type": ("sample = 1", 'sample = "many"', "sample: Input should be a valid integer"),
    "missions without numbers": ("sample = 1", "even = true", "reckless in junction: even: expected missions with"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_an_edition_that_cannot_be_driven_is_refused_in_one_sentence(tmp_path: Path, case: str) -> None:
    old, new, said = BROKEN[case]
    assert old in SMALL
    (tmp_path / "edition.toml").write_text(SMALL.replace(old, new, 1))
    arguments = ["league", "run", "--edition", str(tmp_path / "edition.toml"), "--out", str(tmp_path / "out")]
    done = dohyo.invoke(app, arguments)
    assert isinstance(done.exception, InvalidInputError)
    assert said in str(done.exception)
    assert "\n" not in str(done.exception)
    assert not list(tmp_path.rglob("*.jsonl"))


def test_an_edition_without_entrants_is_refused(tmp_path: Path) -> None:
    (tmp_path / "edition.toml").write_text("entrant = []\n" + SMALL.partition("[[entrant]]")[0])
    with pytest.raises(InvalidInputError, match="expected at least one entrant, found none"):
        read_edition(tmp_path / "edition.toml")


def drives(**changed: Any) -> str:
    """Lines of two entrants; values of the first are changed, or left out where they are None."""
    good = [row | {"record_hash": "0" * 64} for row in rows_of(reckless=[50.0, 60.0])]
    first = {name: value for name, value in (good[0] | changed).items() if value is not None or name in Cell._fields}
    return "".join(f"{json.dumps(row)}\n" for row in (first, *good[1:]))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (drives()[:-20], "line 2: expected a JSON object, got '{"),
        ("3\n", "line 1: expected a JSON object, got '3'"),
        ("{}\n", "line 1: expected a row with arm, training_seed, benchmark, scenario, seed, got {}"),
        (drives(arm="nobody"), "line 1: edition 'small' has no 'nobody' in 'junction'"),
        (drives(benchmark="lots"), "line 1: edition 'small' has no 'reckless' in 'lots'"),
        (drives(benchmark=["junction"]), "line 1: edition 'small' has no 'reckless' in "),
        (drives(scenario="m1"), "line 2: reckless in junction, m1 s1, comes twice"),
        (drives(scenario=[]), "line 1: expected a scenario's name and a seed, got [] and 1"),
        (drives(driving_score="high"), "line 1: expected a number as driving_score, got 'high'"),
        (drives(driving_score=math.nan), "line 1: expected a number as driving_score, got nan"),
        (drives(driven_m=-1.0), "line 1: expected metres as driven_m, got -1.0"),
        (drives(infractions={"sneezing": 1}), "line 1: expected infractions by kind, got {'sneezing': 1}"),
        (drives(record_hash=None), "line 1: expected the hash of a record, got None"),
    ],
)
def test_rows_that_are_damaged_or_of_another_edition_are_refused(
    tmp_path: Path, edition: Path, text: str, said: str
) -> None:
    (tmp_path / "rows.jsonl").write_text(text)
    for command in ("table", "verify"):
        done = dohyo.invoke(app, ["league", command, "--edition", str(edition), "--rows", str(tmp_path)])
        assert isinstance(done.exception, InvalidInputError)
        assert said in str(done.exception)


def test_rows_of_another_version_are_neither_verified_nor_gone_on_with(
    driven: Path, tmp_path: Path, edition: Path
) -> None:
    for name in ("rows.jsonl", "facts.json"):
        (tmp_path / name).write_text((driven / name).read_text().replace(f'"{version("dohyo")}"', '"0.0.1"'))
    arguments = ["--edition", str(edition), "--rows", str(tmp_path)]
    for command in (["verify"], ["run", "--out", str(tmp_path / "out")]):
        done = dohyo.invoke(app, ["league", *command, *arguments])
        assert isinstance(done.exception, InvalidInputError)
        assert f"driven with dohyo {version('dohyo')}, got ones of 0.0.1" in str(done.exception)
    assert "driven with dohyo 0.0.1" in dohyo.invoke(app, ["league", "table", *arguments]).output
    rows = read_rows(tmp_path)
    with pytest.raises(InvalidInputError, match=r"got ones of 0\.0\.1"):
        check_version(tmp_path / "rows.jsonl", rows)
    check_version(tmp_path, [])  # what is told of rows that are gone
    (tmp_path / "facts.json").write_text('{"evaluations": []}')
    with pytest.raises(InvalidInputError, match="expected versions of evaluations"):
        check_version(tmp_path, rows)


def test_rows_of_another_edition_are_refused(driven: Path, tmp_path: Path, edition: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(edition.read_text().replace('name = "small"', 'name = "later"'))
    for command in (["table"], ["verify"], ["run", "--out", str(tmp_path / "out")]):
        done = dohyo.invoke(app, ["league", *command, "--edition", str(other), "--rows", str(driven)])
        assert isinstance(done.exception, InvalidInputError)
        assert "expected rows of edition 'later', got ones of 'small'" in str(done.exception)
    assert not (tmp_path / "out").exists()


def test_standings_of_different_drives_are_refused(tmp_path: Path) -> None:
    edition = of_drivers("a", "b")
    rows = [row | {"record_hash": "0" * 64} for row in rows_of(a=[1.0, 2.0, 3.0], b=[1.0, 2.0])]
    (tmp_path / "rows.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    with pytest.raises(InvalidInputError, match=r"in junction, and b has 2 of 3 \(not m2 s1\)"):
        read_comparable_rows(edition, tmp_path)


def test_a_run_keeps_no_rows_that_it_cannot_read(tmp_path: Path, edition: Path) -> None:
    (tmp_path / "rows.jsonl").write_text("torn")
    with pytest.raises(InvalidInputError, match="line 1: expected a JSON object"):
        league.run(read_edition(edition), tmp_path, disciplines=["lots"])
    assert (tmp_path / "rows.jsonl").read_text() == "torn"
    assert not (tmp_path / "lots").exists()


def evaluated_as(monkeypatch: pytest.MonkeyPatch, *rows: Row) -> list[str]:
    """Names of the entrants that `run` evaluates from now on, each with the given rows."""
    asked = []

    def evaluate(discipline: Discipline, entrant: Entrant, *_: Any) -> list[Row]:
        asked.append(entrant.name)
        return [row | {"arm": entrant.name} for row in rows]

    monkeypatch.setattr(league, "evaluate", evaluate)
    return asked


def test_rows_in_other_files_of_a_folder_stay_there_and_are_not_driven_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    edition = of_drivers("reckless", "autopilot", "obstinate")
    rows = [row | {"record_hash": "0" * 64} for row in rows_of(reckless=[50.0, 60.0])]
    others = {tmp_path / f"{arm}.jsonl": [row | {"arm": arm} for row in rows] for arm in ("reckless", "obstinate")}
    for path, some in others.items():
        path.write_text("".join(f"{json.dumps(row)}\n" for row in some))
    asked = evaluated_as(monkeypatch, *rows)
    for _ in range(2):
        league.run(edition, tmp_path, entrants=["autopilot"])
    assert all(read_rows(path) == some for path, some in others.items())
    assert [row["arm"] for row in read_rows(tmp_path / "rows.jsonl")] == ["autopilot"] * 2
    assert {row["arm"] for row in read_comparable_rows(edition, tmp_path)} == {"reckless", "autopilot", "obstinate"}
    with pytest.raises(InvalidInputError, match=r"reckless\.jsonl' has rows of reckless in junction: expected them in"):
        league.run(edition, tmp_path, entrants=["autopilot", "reckless"])
    assert asked == ["autopilot"] * 2


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
