"""RESULTS.md: sections are replaced between their marks, and hold what their stored rows give."""

import json
import re
from pathlib import Path

import pytest

from dohyo.agents.forecasting import tables as forecasting
from dohyo.agents.hierarchical import evaluate_policies, study_tables
from dohyo.agents.hierarchical.arms import SUB_POLICIES
from dohyo.agents.hierarchical.training_results import only, read_results, table
from dohyo.agents.localization import tables as localization
from dohyo.agents.results_page import PAGE, write_section
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import read_lines

TEXT = "before\n<!-- begin a -->\nold\n<!-- end a -->\nbetween\n<!-- begin b -->\nkept\n<!-- end b -->\nafter\n"
AGENTS = Path(__file__).parents[2] / "agents"
STORED = AGENTS / "hierarchical/results"


def section(system: str, name: str) -> str:
    found = re.search(rf"<!-- begin {name} -->\n(.*?)\n<!-- end {name} -->", (AGENTS / system / PAGE).read_text(), re.S)
    assert found, f"{system} has no section {name}"
    return found[1]


def stored_drives(*arms: str) -> str:
    paths = sorted((STORED / "drives").glob("*.jsonl"))
    return study_tables.tables(
        [one for path in paths for one in study_tables.read_drives(path) if one["arm"] in arms], arms
    )


def test_one_section_is_replaced_and_the_rest_stays(tmp_path: Path) -> None:
    page = tmp_path / "RESULTS.md"
    page.write_text(TEXT)
    write_section(page, "a", "new\n")
    assert page.read_text() == TEXT.replace("old", "new")


@pytest.mark.parametrize("damaged", ["", "<!-- begin a -->\nold\n", "<!-- end a -->\n<!-- begin a -->\n"])
def test_a_page_without_both_marks_is_refused_and_left_alone(tmp_path: Path, damaged: str) -> None:
    page = tmp_path / "RESULTS.md"
    page.write_text(damaged)
    with pytest.raises(InvalidInputError, match="expected the marks <!-- begin a -->"):
        write_section(page, "a", "new")
    assert page.read_text() == damaged


def test_forecasting_shows_its_stored_study() -> None:
    assert section("forecasting", "study") == forecasting.markdown(json.loads(forecasting.RESULTS.read_text()))


def test_localization_shows_its_stored_study() -> None:
    stored = json.loads((AGENTS / "localization/results/study.json").read_text())
    assert section("localization", "study") == localization.markdown(stored)


def test_hierarchical_shows_its_stored_trainings() -> None:
    results, _ = read_results(STORED / "training")
    arms = ("ghrl", "ghrl-r", "hrl", "flat", "flat-guided", "ghrl-pictures")
    assert section("hierarchical", "trainings") == table(only(results, arms))


@pytest.mark.slow
def test_hierarchical_shows_its_stored_exercises_and_drives() -> None:
    exercises = {policy: read_lines(STORED / f"held_out/{policy}.jsonl") for policy in SUB_POLICIES}
    there = {policy: lines for policy, lines in exercises.items() if lines}
    assert section("hierarchical", "held-out") == evaluate_policies.tables(there)
    assert section("hierarchical", "benchmarks") == stored_drives("rules", "hrl", "ghrl", "ghrl-r", "ghrl-s")
    learned = ("ghrl", "ghrl-r-trained", "flat", "flat-guided", "ghrl-pictures", "ghrl-r-pictures")
    assert section("hierarchical", "other-arms") == stored_drives(*learned)
