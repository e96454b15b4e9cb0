from __future__ import annotations

import csv
import dataclasses
import io
import json
import re
import shutil
import subprocess
from collections.abc import Callable, Iterable, Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest

from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.records.mixed import drives_of
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord, Infraction
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.report import contenders, figures
from dohyo.evaluation.report import style as look
from dohyo.evaluation.report.contenders import Evaluation, make_contenders, make_pairs
from dohyo.evaluation.report.page import COLUMNS, write_report
from dohyo.evaluation.report.road_map import LaneShape, drivable_lanes
from dohyo.evaluation.scores.driving import IrsLength, Rules
from dohyo.evaluation.scores.nuplan.score import ClosedLoop
from dohyo.evaluation.scores.nuplan.summary import ScoredDrive
from dohyo.evaluation.statistics import Estimate
from dohyo.evaluation.summary import compare, summarise
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import AGENT, ego, episode, infraction, lost

HASH = "0" * 64
HOSTILE = """<script>document.title="owned"</script><img src=x onerror='document.title="owned"'>{{ 7 * 7 }}"""
CHROMIUM = shutil.which("chromium")
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine to open the report with")


class Page(HTMLParser):
    """The elements of a page, as (tag, attributes), and its text outside scripts and styles."""

    def __init__(self, source: str) -> None:
        super().__init__()
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.text = ""
        self._inside = ""
        self.feed(source)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {name: value or "" for name, value in attrs}))
        self._inside = tag

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""

    def handle_data(self, data: str) -> None:
        if self._inside not in ("script", "style"):
            self.text = " ".join((self.text + data).split()) + (" " if data[-1:].isspace() else "")

    def having(self, tag: str, css_class: str) -> list[dict[str, str]]:
        return [found for name, found in self.elements if name == tag and css_class in found.get("class", "").split()]


def cross(network: str) -> list[LaneShape]:
    """Two roads that meet."""
    return [
        (np.array([[-100.0, 0.0], [0.0, 0.0], [100.0, 0.0]]), 3.2),
        (np.array([[0.0, -100.0], [0.0, 100.0]]), 3.0),
    ]


def at(kind: InfractionKind, x: float, y: float, **rest: Any) -> Infraction:
    return infraction(kind, **rest).model_copy(update={"x_m": x, "y_m": y})


def hit(**rest: Any) -> Infraction:
    return at(InfractionKind.COLLISION_VEHICLE, 10.0, 0.0, magnitude=6.5, **rest)


def red(**rest: Any) -> Infraction:
    return at(InfractionKind.RED_LIGHT, 0.0, 20.0, **rest)


def driver(name: str) -> AgentInfo:
    return AGENT.model_copy(update={"name": name})


def drives(name: str, *egos: Sequence[Infraction], **rest: Any) -> list[EpisodeRecord]:
    """One episode per list of infractions, each with the next seed."""
    return [episode(ego(*found, agent=driver(name), **rest), seed=seed) for seed, found in enumerate(egos)]


def evaluation(records: Iterable[EpisodeRecord], folder: Path, agent: str = "tester") -> Evaluation:
    records = tuple(records)
    paths = tuple(folder / f"{record.scenario.name} #{i}.json" for i, record in enumerate(records))
    return Evaluation(agent, "nocrash", HASH, records, paths)


def report(
    tmp_path: Path,
    *evaluations: Evaluation,
    rules: Rules = "2.0",
    irs_length: IrsLength = "completed",
    lanes: Callable[[str], Iterable[LaneShape]] = cross,
) -> tuple[Path, Page]:
    agents = make_contenders(evaluations, rules, irs_length)
    path = write_report(agents, make_pairs(agents), tmp_path / "out" / "report.html", lanes=lanes)
    return path, Page(path.read_text(encoding="utf-8"))


def open_in_browser(path: Path, profile: Path) -> tuple[str, list[str]]:
    """The page's document once its scripts have run, and what they said on the console."""
    assert CHROMIUM is not None
    switches = "headless no-sandbox disable-gpu disable-quic no-first-run disable-background-networking"
    switches += " disable-component-update disable-sync dump-dom enable-logging=stderr virtual-time-budget=4000"
    done = subprocess.run(
        [CHROMIUM, *(f"--{switch}" for switch in switches.split()), f"--user-data-dir={profile}", path.as_uri()],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )
    return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]


@pytest.fixture
def two(tmp_path: Path) -> list[Evaluation]:
    """Two agents on four seeds; the second errs on each, and loses its last episode."""
    careful = drives("careful", [], [], [red()], [], status=Status.COMPLETED)
    reckless = drives("reckless", [hit(route_m=300.0), red(route_m=400.0)], [hit(at_fault=False)], [red()])
    return [
        evaluation(careful, tmp_path / "careful", "careful"),
        evaluation([*reckless, _lost("reckless", seed=3)], tmp_path / "reckless", "reckless"),
    ]


def _lost(agent: str, **rest: Any) -> EpisodeRecord:
    fallen = ego(agent=driver(agent), status=Status.SIMULATION, progress_m=0.0, failure="SUMO lost the ego")
    return episode(fallen, **rest)


def test_every_number_of_the_summaries_and_comparisons_is_there(two: list[Evaluation], tmp_path: Path) -> None:
    _, page = report(tmp_path, *two)
    for one in two:
        summary = summarise(one.records)
        shown = [summary.scores[column.key] for column in COLUMNS]
        for estimate in (*shown, *(rate for rate in summary.per_km.values() if rate.mean)):
            assert look.interval(estimate) in page.text
    comparisons = compare(two[0].records, two[1].records)
    for column in COLUMNS:
        comparison = comparisons[column.key]
        expected = f"{comparison.verdict} {look.probability(comparison.probability)}"
        assert f"{look.interval(comparison.difference)} {expected}" in page.text


def test_each_infraction_that_counts_is_on_the_map_once(two: list[Evaluation], tmp_path: Path) -> None:
    _, page = report(tmp_path, *two)
    spots = page.having("a", "spot")
    assert sorted(spot["transform"] for spot in spots) == ["translate(0.0 -20.0)"] * 3 + ["translate(10.0 0.0)"] * 2
    assert len([spot for spot in spots if "innocent" in spot["class"].split()]) == 1
    anchors = {found["id"] for _, found in page.elements if "id" in found}
    assert {spot["href"].removeprefix("#") for spot in spots} <= anchors


def test_lanes_are_drawn_by_width_with_north_up(tmp_path: Path) -> None:
    _, page = report(tmp_path, evaluation(drives("tester", [red()]), tmp_path))
    paths = {
        found["id"]: found["d"] for tag, found in page.elements if tag == "path" and found["id"].startswith("lanes")
    }
    assert paths == {"lanes-1-1": "M0.0 100.0l0 -200", "lanes-1-2": "M-100.0 0.0l100 0l100 0"}


def test_it_needs_nothing_from_outside(two: list[Evaluation], tmp_path: Path) -> None:
    path, page = report(tmp_path, *two)
    loads = [found for tag, found in page.elements if tag in ("link", "img", "iframe", "object", "embed", "base")]
    assert loads == []
    assert not any("src" in found for _, found in page.elements)
    hrefs = [found["href"] for _, found in page.elements if "href" in found]
    assert not [href for href in hrefs if re.match(r"[a-z]+:|//", href)]
    styles = "".join(re.findall(r"<style>(.*?)</style>", path.read_text(encoding="utf-8"), re.DOTALL))
    assert "@import" not in styles
    assert "url(" not in styles


def test_links_to_records_resolve_from_where_the_report_is(two: list[Evaluation], tmp_path: Path) -> None:
    for one in two:
        for record, file in zip(one.records, one.record_paths, strict=True):
            file.parent.mkdir(exist_ok=True)
            file.write_text(record.model_dump_json())
    path, page = report(tmp_path, *two)
    links = [found["href"] for _, found in page.elements if found.get("href", "").endswith(".json")]
    assert len(links) == 8
    assert all((path.parent / unquote(link)).is_file() for link in links)


def test_hostile_names_are_only_text(tmp_path: Path) -> None:
    def one(name: str) -> Evaluation:
        drive = ego(
            hit(actor=name), agent=driver(name), status=Status.AGENT_RAISED, failure=name, name=name, route_length_m=1e3
        )
        return evaluation([episode(drive, name=name), _lost(name, name=name, seed=1)], tmp_path, agent=name)

    hostile = report(tmp_path, one(HOSTILE))
    benign = report(tmp_path, one("benign"))
    source = hostile[0].read_text(encoding="utf-8")
    assert [tag for tag, _ in hostile[1].elements] == [tag for tag, _ in benign[1].elements]
    assert " ".join(HOSTILE.split()) in hostile[1].text
    assert "<img src=x" not in source


def test_a_cell_that_a_spreadsheet_would_run_is_quoted(tmp_path: Path) -> None:
    _, page = report(tmp_path, evaluation(drives("=cmd()", [hit()]), tmp_path, agent="=cmd()"))
    rows = list(csv.DictReader(io.StringIO(page.having("button", "copy")[0]["data-csv"])))
    assert {row["agent"] for row in rows} == {"'=cmd()"}


def test_csv_holds_the_numbers_unrounded(two: list[Evaluation], tmp_path: Path) -> None:
    _, page = report(tmp_path, *two)
    scores, pairs, rates, table = (
        list(csv.DictReader(io.StringIO(button["data-csv"]))) for button in page.having("button", "copy")
    )
    found = {(row["agent"], row["quantity"]): float(row["mean"]) for row in scores}
    assert found["reckless", "driving_score"] == summarise(two[1].records).scores["driving_score"].mean
    assert {row["verdict"] for row in pairs} <= {"<", "=", ">"}
    assert len(rates) == 2 * len(InfractionKind)
    assert [float(row["DS"]) for row in table] == sorted(float(row["DS"]) for row in table)
    assert len(table) == 7


@pytest.mark.parametrize(
    ("rules", "expected"),
    [
        ("2.0", "80 × 0.9 × 0.6 × 0.6 × 0.7 = 18.1"),
        ("2.1", "80 × 0.9 / (1 + 0.7 + 0.7 + 0.4) = 25.7"),
    ],
)
def test_a_score_explains_itself(rules: Rules, expected: str, tmp_path: Path) -> None:
    drive = ego(hit(), hit(), red(), driven_m=800.0, outside_lanes_m=80.0)
    _, page = report(tmp_path, evaluation([episode(drive)], tmp_path), rules=rules)
    assert expected in page.text


def test_a_flawless_drive_explains_itself_too(tmp_path: Path) -> None:
    _, page = report(tmp_path, evaluation([episode(ego(status=Status.PERFECT))], tmp_path))
    assert "100 × 1 = 100" in page.text


def test_without_any_infraction(tmp_path: Path) -> None:
    _, page = report(tmp_path, evaluation(drives("tester", [], [], status=Status.PERFECT), tmp_path))
    assert "No agent committed an infraction" in page.text
    assert "No infraction on this network" in page.text
    assert page.having("a", "spot") == []


def test_with_lost_episodes_only(tmp_path: Path) -> None:
    _, page = report(tmp_path, evaluation([lost(seed=0), lost(seed=1)], tmp_path))
    assert "No drive counts yet" in page.text
    assert page.text.count("SUMO lost the ego") == 2
    assert {found["title"] for found in page.having("span", "missing")} == {"no score: every episode was lost"}


def test_the_headline_is_explained_where_the_benchmark_says_it(tmp_path: Path) -> None:
    one = evaluation(drives("tester", [red()]), tmp_path)
    _, page = report(tmp_path, dataclasses.replace(one, metric="success: reaches the goal at 5 km/h"))
    assert "success: reaches the goal at 5 km/h." in page.text


def test_a_folder_is_no_report(tmp_path: Path) -> None:
    one = evaluation(drives("tester", [red()]), tmp_path)
    with pytest.raises(InvalidInputError, match="expected a file, got a folder"):
        write_report(make_contenders([one], "2.0", "completed"), [], tmp_path, lanes=cross)


def test_with_one_episode(tmp_path: Path) -> None:
    _, page = report(tmp_path, evaluation(drives("tester", [red()]), tmp_path))
    assert "56.0 n=1" in page.text
    assert "Half of" not in page.text


def test_lost_episodes_stand_apart_and_enter_no_mean(two: list[Evaluation], tmp_path: Path) -> None:
    _, page = report(tmp_path, *two)
    _, lost_part = page.text.split("Lost to gridlocks and infrastructure faults")
    assert "SUMO lost the ego" in lost_part
    assert page.text.count("SUMO lost the ego") == 1
    assert look.interval(summarise(two[1].records[:3]).scores["driving_score"]) in page.text


def test_where_a_drive_was_lost_the_report_shows_both_means(two: list[Evaluation], tmp_path: Path) -> None:
    _, page = report(tmp_path, *two)
    assert page.text.count("counting lost drives as 0") == 1
    as_zero = summarise(two[1].records).scores_lost_as_zero
    assert as_zero is not None
    assert look.interval(as_zero["driving_score"]) in page.text
    _, whole = report(tmp_path, two[0])
    assert "counting lost drives as 0" not in whole.text


def test_an_agents_failure_is_told_in_its_own_words(tmp_path: Path) -> None:
    drive = ego(status=Status.AGENT_RAISED, failure="ValueError: shapes (4,) and (3,) differ")
    _, page = report(tmp_path, evaluation([episode(drive)], tmp_path))
    assert "! raised ValueError: shapes (4,) and (3,) differ" in page.text


def test_agents_without_a_drive_in_common_are_not_compared(tmp_path: Path) -> None:
    a = evaluation([episode(ego(agent=driver("a")), seed=0)], tmp_path, "a")
    b = evaluation([episode(ego(agent=driver("b")), seed=1)], tmp_path, "b")
    _, page = report(tmp_path, a, b)
    assert any("no drive in common" in found["title"] for found in page.having("span", "missing"))


def test_a_network_that_is_not_here_leaves_the_infractions(tmp_path: Path) -> None:
    _, page = report(tmp_path, evaluation(drives("tester", [red()]), tmp_path), lanes=drivable_lanes)
    assert "The roads are missing: no network named 'hand-made'" in page.text
    assert len(page.having("a", "spot")) == 1


def test_the_same_records_give_the_same_bytes(two: list[Evaluation], tmp_path: Path) -> None:
    first = report(tmp_path, *two)[0].read_bytes()
    assert report(tmp_path, *two[::-1])[0].read_bytes() == first


def test_what_cannot_be_reported_is_refused(two: list[Evaluation], tmp_path: Path) -> None:
    other = Evaluation("other", "nocrash", "1" * 64, two[0].records, two[0].record_paths)
    with pytest.raises(InvalidInputError, match="at least one evaluation"):
        report(tmp_path)
    with pytest.raises(InvalidInputError, match="several of careful"):
        report(tmp_path, two[0], two[0])
    with pytest.raises(InvalidInputError, match="one benchmark version"):
        report(tmp_path, two[0], other)
    with pytest.raises(InvalidInputError, match="4 records and 0 paths"):
        Evaluation("careful", "nocrash", HASH, two[0].records, ())


@pytest.fixture
def slow_and_rash(tmp_path: Path) -> list[Evaluation]:
    """Six drives of two agents: one is slow, with the higher driving score; one reaches its goals over red lights."""
    slow = drives("slow", *[[]] * 6)
    rash = drives("rash", *[[red(), red(), red()]] * 6, status=Status.COMPLETED, progress_m=1000.0)
    return [evaluation(slow, tmp_path / "slow", "slow"), evaluation(rash, tmp_path / "rash", "rash")]


def headed(evaluations: Sequence[Evaluation], headline: Headline) -> list[Evaluation]:
    return [dataclasses.replace(one, headline=headline) for one in evaluations]


def columns(page: Page) -> list[str]:
    """Titles of the cells in the first row of scores."""
    return list(dict.fromkeys(cell["data-label"] for cell in page.having("td", "estimate")))


@pytest.mark.parametrize(
    ("headline", "lead", "column"),
    [
        (Headline.DRIVING_SCORE, "slow has a driving score of 80.0", "driving score DS"),
        (Headline.NOCRASH_SUCCESS, "rash has a NoCrash success score of 100", "success without crash"),
        (Headline.IRS, "slow has an infraction rate score of 80.0", "infraction rate score IRS"),
    ],
)
def test_the_headline_of_the_benchmark_leads(
    headline: Headline, lead: str, column: str, slow_and_rash: list[Evaluation], tmp_path: Path
) -> None:
    _, page = report(tmp_path, *headed(slow_and_rash, headline))
    assert lead in page.text
    assert "points above" in page.text
    first = columns(page)[0]
    assert first == column
    means = [float(cell["data-value"]) for cell in page.having("td", "estimate") if cell["data-label"] == first]
    assert means[0] > means[1]


def test_2500_m_is_a_column_where_it_is_the_headline(slow_and_rash: list[Evaluation], tmp_path: Path) -> None:
    _, page = report(tmp_path, *headed(slow_and_rash, Headline.DROVE_2500M))
    assert columns(page)[0] == "2500 m without crash"
    assert "has a 2500 m score of 0" in page.text


def test_the_closed_loop_score_leads_and_is_compared(
    slow_and_rash: list[Evaluation], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def scored(records: Iterable[tuple[EpisodeRecord, Path]]) -> list[ScoredDrive]:
        return [
            ScoredDrive("scenario", record.scenario.seed, "ego", "turn", ClosedLoop(*[ego.agent.name == "rash"] * 8))
            for record, _ in records
            for ego in record.egos
        ]

    monkeypatch.setattr(contenders, "score_records", scored)
    _, page = report(tmp_path, *headed(slow_and_rash, Headline.CLOSED_LOOP))
    assert "rash has a closed-loop score of 100" in page.text
    assert "100 points above slow" in page.text
    assert columns(page)[0] == "closed-loop score"
    scores, pairs, *_ = (list(csv.DictReader(io.StringIO(one["data-csv"]))) for one in page.having("button", "copy"))
    assert {row["agent"]: float(row["mean"]) for row in scores if row["quantity"] == "closed_loop"} == {
        "rash": 100.0,
        "slow": 0.0,
    }
    assert [(row["a"], row["verdict"], row["b"]) for row in pairs if row["quantity"] == "closed_loop"] == [
        ("rash", ">", "slow")
    ]


def driven_by(record: EpisodeRecord, **versions: str) -> EpisodeRecord:
    return record.model_copy(update={"versions": record.versions.model_copy(update=versions)})


def test_mixed_versions_are_named(two: list[Evaluation], tmp_path: Path) -> None:
    careful, reckless = two
    assert "different versions" not in report(tmp_path, careful, reckless)[1].text
    new = tuple(driven_by(one, dohyo="7.0.0") for one in careful.records)
    old = [driven_by(one, dohyo="6.5.0", sumo="SUMO 1.20.0") for one in reckless.records[:3]]
    mixed = (*old, driven_by(reckless.records[3], dohyo="7.0.0"))
    _, page = report(tmp_path, dataclasses.replace(careful, records=new), dataclasses.replace(reckless, records=mixed))
    assert "different versions drove these episodes" in page.text
    assert "careful: dohyo 7.0.0, SUMO 1.28.0; reckless: dohyo 6.5.0, 7.0.0, SUMO 1.20.0, 1.28.0." in page.text


@needs_chromium
def test_a_browser_opens_it_without_complaint(two: list[Evaluation], tmp_path: Path) -> None:
    path, _ = report(tmp_path, *two)
    document, console = open_in_browser(path, tmp_path / "profile")
    page = Page(document)
    assert console == []
    assert len(page.having("div", "js-plotly-plot")) == 3
    assert len(page.having("svg", "main-svg")) >= 3
    assert all("reckless" in spot["aria-label"] or "careful" in spot["aria-label"] for spot in page.having("a", "spot"))
    assert all("hidden" not in button for button in page.having("button", "copy"))


@needs_chromium
def test_a_browser_runs_nothing_that_a_record_says(tmp_path: Path) -> None:
    drive = ego(hit(actor=HOSTILE), agent=driver(HOSTILE), status=Status.AGENT_RAISED, failure=HOSTILE)
    hostile = evaluation([episode(drive, name=HOSTILE)], tmp_path, agent=HOSTILE)
    hostile = Evaluation(HOSTILE, HOSTILE, HASH, hostile.records, (tmp_path / "record.json",))
    document, console = open_in_browser(report(tmp_path, hostile)[0], tmp_path / "profile")
    assert console == []
    assert "<title>owned" not in document
    assert "<img src=" not in document


@needs_chromium
@pytest.mark.parametrize("records", [[lost()], drives("tester", [], status=Status.PERFECT)])
def test_a_browser_opens_what_is_nearly_empty(records: list[EpisodeRecord], tmp_path: Path) -> None:
    _, console = open_in_browser(report(tmp_path, evaluation(records, tmp_path))[0], tmp_path / "profile")
    assert console == []


def test_an_agent_keeps_its_colour_whoever_stands_beside_it() -> None:
    agents = [f"agent {i}" for i in range(8)]
    colours = look.agent_colours(agents)
    assert sorted(colours.values()) == sorted(look.OKABE_ITO)
    assert colours == look.agent_colours(agents[::-1])
    assert look.agent_colours(["mcts"])["mcts"] == look.agent_colours(["mcts", "idm"])["mcts"]
    assert len(look.agent_colours(map(str, range(20)))) == 20


@pytest.mark.parametrize(
    ("value", "expected"),
    [(0.0, "0"), (78.44, "78.4"), (100.0, "100"), (99.96, "100"), (0.5, "0.500"), (1234.5, "1234"), (-3.456, "-3.46")],
)
def test_numbers_have_three_significant_digits(value: float, expected: str) -> None:
    assert look.number(value) == expected


@pytest.mark.parametrize(
    ("estimate", "expected"),
    [
        (Estimate(78.4, 75.9, 80.6, 75), "78.4 [75.9, 80.6] n=75"),
        (Estimate(78.4, None, None, 1), "78.4 n=1"),
        (Estimate(None, None, None, 0), "—"),
    ],
)
def test_an_estimate_reads_as_mean_interval_and_n(estimate: Estimate, expected: str) -> None:
    assert look.interval(estimate) == expected


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (1.0, "P(A > B) > 0.999"),
        (0.9994, "P(A > B) = 0.999"),
        (0.873, "P(A > B) = 0.873"),
        (0.0005, "P(A > B) = 0.001"),
        (0.0, "P(A > B) < 0.001"),
        (None, "too few to decide"),
    ],
)
def test_a_probability_is_never_written_as_certain(value: float | None, expected: str) -> None:
    assert look.probability(value) == expected


def test_scores_by_mission_stand_with_the_hardest_first() -> None:
    records = {"a": [_mission("easy", 900.0), _mission("hard", 100.0)], "b": [_mission("easy", 950.0)]}
    figure = figures.score_by_mission(records)
    assert figure.layout.yaxis.ticktext == ("hard", "easy")
    assert figure.data[0].x == pytest.approx((10.0, 90.0))
    assert "'hard' is the hardest of 2 missions" in figure.layout.title.text


def test_rates_along_the_route_divide_by_what_was_driven_there() -> None:
    """Half a kilometre driven twice: 0.2 km in each tenth up to the middle, and nothing beyond it."""
    found = infraction(InfractionKind.RED_LIGHT, route_m=250.0)
    some = [episode(ego(found, progress_m=500.0), seed=0), episode(ego(progress_m=500.0), seed=1)]
    rates, marks = figures.infractions_along_route({"a": some}).data
    assert list(rates.y) == [0, 0, pytest.approx(1 / 0.2), 0, 0, None, None, None, None, None]
    assert list(marks.x) == [25.0]


def test_endings_are_counted_with_the_lost_apart() -> None:
    some = [*drives("a", [], [], status=Status.PERFECT), _lost("a", seed=9)]
    figure = figures.episode_endings({"a": some})
    assert {bar.name: bar.x[0] for bar in figure.data} == {"perfect": 2, "simulation failed": 1}
    assert figure.layout.title.text == "Goals reached: a 2 of 2"


def test_the_endings_of_a_lost_episode_are_its_fault_for_all_egos_and_agents() -> None:
    other = driver("other")
    gone = episode(ego(name="a", status=Status.GRIDLOCK), ego(name="b", status=Status.COMPLETED, agent=other))
    apart = {agent.name: [drives_of(agent, gone) or gone] for agent in (AGENT, other)}
    for records in ({"a": [gone]}, apart):
        (bar,) = figures.episode_endings(records).data
        assert (bar.name, sum(bar.x)) == ("traffic was gridlocked", 2)
    title = figures.episode_endings({"a": [gone, *drives("a", [], status=Status.PERFECT)]}).layout.title.text
    assert title == "Goals reached: a 1 of 1"


def test_figures_read_no_markup_in_names() -> None:
    text = json.dumps(figures.score_by_mission({HOSTILE: [episode(name=HOSTILE)]}).to_plotly_json()["data"])
    assert "<img" not in text


def _mission(name: str, progress_m: float) -> EpisodeRecord:
    return episode(ego(progress_m=progress_m), name=name)


def test_every_kind_and_status_has_a_look_of_its_own() -> None:
    assert len({kind.specification.mark.symbol for kind in InfractionKind}) == len(InfractionKind)
    assert len({kind.specification.mark.path for kind in InfractionKind}) == len(InfractionKind)
    assert len({(status.outcome, status.hatch) for status in Status}) == len(Status)


def test_a_part_of_the_benchmark_is_named_beside_its_scores(two: list[Evaluation], tmp_path: Path) -> None:
    careful, reckless = two
    words = "part of nocrash: 10 of 150 missions"
    _, page = report(tmp_path, dataclasses.replace(careful, part=words), reckless)
    assert f"careful: {words}. Its scores are not those of the benchmark." in page.text
    assert "nocrash, in part" in page.text
    assert "reckless has a driving score" in page.text  # careful has the higher one, on a part
    _, alone = report(tmp_path, dataclasses.replace(careful, part=words))
    assert f"careful ({words}) has a driving score" in alone.text
    _, whole = report(tmp_path, careful, reckless)
    assert "part of" not in whole.text
    assert "in part" not in whole.text
