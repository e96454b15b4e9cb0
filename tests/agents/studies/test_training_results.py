"""What trainings left behind, read by policy, arm and seed, and what the seeds of an arm say together."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from dohyo.agents.studies import training_results as results
from dohyo.evaluation.statistics import Estimate
from dohyo.sumo_networks.errors import InvalidInputError

HEAD = (
    "steps",
    "episodes",
    "return",
    "return_low",
    "return_high",
    "success",
    "success_low",
    "success_high",
    "standing",
    "infraction",
)
TASKS = ("lane", "left", "master")
T_2, T_1 = 4.302653, 12.706205
"""Student's quantiles at 97.5 % with 2 and 1 degrees of freedom, from a printed table."""


def written(folder: Path, rows: list[tuple[int, float, float]], imitated: int = 4000) -> Path:
    """A run with evaluations of (steps, return, success)."""
    folder.mkdir(parents=True)
    (folder / "config.toml").write_text(f"steps = 8000\n[ppo]\nimitated_steps = {imitated}\n")
    with (folder / "evaluations.csv").open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(HEAD)
        for steps, value, success in rows:
            table.writerow(
                (
                    steps,
                    20,
                    value,
                    value - 10,
                    value + 10,
                    success,
                    success - 15,
                    min(success + 5, 100),
                    0.1,
                    1.0 - success / 100.0,
                )
            )
    return folder


@pytest.fixture
def runs(tmp_path):
    """Arm ghrl with three seeds of lane and one of the master, hrl with one of lane."""
    for seed, end in enumerate((90.0, 100.0, 110.0)):
        written(tmp_path / "ghrl" / f"seed-{seed}" / "lane", [(4000, 50.0, 60.0), (8000, end, 100.0)])
    written(tmp_path / "ghrl" / "seed-1" / "master", [(4000, 7.0, 40.0)], imitated=0)
    written(tmp_path / "hrl" / "seed-2" / "lane", [(4000, 30.0, 20.0), (8000, 20.0, 10.0)], imitated=0)
    return tmp_path


def test_trainings_are_found_by_task_arm_and_seed_and_other_folders_are_left_alone(runs):
    (runs / "ghrl" / "seed-0" / "logs").mkdir()
    (runs / "ghrl" / "seed-old" / "lane").mkdir(parents=True)
    (runs / "aaa").write_text("a note")
    found = results.read_trainings(results.find_trainings(runs, TASKS), ("ghrl", "hrl", "none"), TASKS)
    assert {task: list(arms) for task, arms in found.items()} == {"lane": ["ghrl", "hrl"], "master": ["ghrl"]}
    assert [run.seed for run in found["lane"]["ghrl"]] == [0, 1, 2]
    assert [run.imitated for run in found["lane"]["ghrl"]] == [4000] * 3
    assert found["lane"]["hrl"][0].seed == 2


def test_trainings_tell_the_versions_that_made_them(runs):
    assert results.find_trainings(runs, TASKS).versions == ["0.1.0"]
    sessions = [{"versions": {"dohyo": version}} for version in ("0.2.0", "0.3.0")]
    (runs / "hrl" / "seed-2" / "lane" / "run.json").write_text(json.dumps({"sessions": sessions}))
    assert results.find_trainings(runs, TASKS).versions == ["0.1.0", "0.2.0", "0.3.0"]
    assert results.find_trainings(runs / "nowhere", TASKS).versions == []


def test_a_training_that_was_not_evaluated_so_far_is_named(runs, caplog):
    going = written(runs / "ghrl" / "seed-3" / "lane", [])
    found = results.read_trainings(results.find_trainings(runs, TASKS), ("ghrl",), TASKS)
    assert caplog.messages == [f"not evaluated so far: {going}"]
    assert len(found["lane"]["ghrl"]) == 3


def test_what_is_no_training_is_named(tmp_path, runs):
    with pytest.raises(InvalidInputError, match="expected evaluated trainings of ghrl; found none"):
        results.read_trainings(results.find_trainings(tmp_path / "nowhere", TASKS), ("ghrl",), TASKS)
    (runs / "hrl" / "seed-2" / "lane" / "config.toml").unlink()
    with pytest.raises(InvalidInputError, match=r"'.*hrl/seed-2/lane' is no run: .*config.toml"):
        results.read_trainings(results.find_trainings(runs, TASKS), ("hrl",), TASKS)
    folder = written(runs / "hrl" / "seed-4" / "lane", [(4000, 1.0, 1.0)])
    (folder / "evaluations.csv").write_text("steps,return\n4000,1.0\n")
    with pytest.raises(InvalidInputError, match="expected columns success"):
        results.read_run(folder, 4)


def test_seeds_have_students_interval_that_ends_where_the_measure_ends():
    seeds = [Estimate(value, value - 1, value + 1, 1) for value in (90.0, 100.0, 110.0)]
    found = results.over_seeds(seeds, "return")
    half = T_2 * 10.0 / 3**0.5
    assert (found.mean, found.low, found.high) == pytest.approx((100.0, 100.0 - half, 100.0 + half))
    low = results.over_seeds([Estimate(90.0, None, None, 1), Estimate(100.0, None, None, 1)], "success")
    assert (low.mean, low.low, low.high, low.n) == pytest.approx((95.0, 95.0 - T_1 * 5.0, 100.0, 2))


def test_one_seed_and_seeds_that_agree_have_the_interval_over_episodes():
    assert results.over_seeds([Estimate(50.0, 40.0, 65.0, 1)], "return") == Estimate(50.0, 40.0, 65.0, 1)
    alike = [Estimate(100.0, 84.0, 100.0, 1), Estimate(100.0, 89.0, 100.0, 1)]
    assert results.over_seeds(alike, "success") == Estimate(100.0, 84.0, 100.0, 2)
    assert results.over_seeds([Estimate(None, None, None, 1), alike[0]], "success").mean is None


def test_a_course_goes_as_far_as_all_seeds_and_straight_between_evaluations(tmp_path):
    runs = [
        results.read_run(written(tmp_path / "a", [(2000, 10.0, 0.0), (4000, 20.0, 0.0), (8000, 40.0, 0.0)]), 0),
        results.read_run(written(tmp_path / "b", [(4000, 40.0, 0.0), (6000, 50.0, 0.0), (9000, 90.0, 0.0)]), 1),
    ]
    steps, found = results.course([run for run in runs if run], "return")
    assert steps.tolist() == [4000.0, 6000.0, 8000.0]
    assert [one.mean for one in found] == pytest.approx([30.0, 40.0, (40.0 + 50.0 + 40.0 * 2 / 3) / 2])
    with pytest.raises(InvalidInputError, match="expected evaluations with a column 'speed_m_s'"):
        results.course([run for run in runs if run], "speed_m_s")


def test_seeds_that_never_met_have_no_course(tmp_path):
    early = results.read_run(written(tmp_path / "a", [(2000, 10.0, 0.0)]), 0)
    late = results.read_run(written(tmp_path / "b", [(4000, 40.0, 0.0)]), 1)
    assert early
    assert late
    steps, found = results.course([early, late], "return")
    assert steps.tolist() == []
    assert found == []


def test_the_table_has_the_last_evaluation_and_the_one_of_the_highest_return(runs):
    found = results.read_trainings(results.find_trainings(runs, TASKS), ("ghrl", "hrl"), TASKS)
    rows = results.table(found).splitlines()[2:]
    half = T_2 * 10.0 / 3**0.5
    last = f"100 [{100 - half:.1f}, {100 + half:.0f}] | 100 [85.0, 100]"
    assert rows[0] == f"| lane | ghrl | 0, 1, 2 | 8,000 | 4,000 | {last} | 0 | {last} |"
    assert rows[1] == "| lane | hrl | 2 | 8,000 | 0 | 20.0 [10.0, 30.0] | 10.0 [-5.00, 15.0] | 0.900 | " + (
        "30.0 [20.0, 40.0] | 20.0 [5.00, 25.0] |"
    )
    assert rows[2].startswith("| master | ghrl | 1 | 4,000 | 0 | 7.00 [-3.00, 17.0]")
