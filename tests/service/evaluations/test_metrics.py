from __future__ import annotations

import csv
import io

import pytest

from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.service.boards.comparison import compare_entries
from dohyo.service.boards.leaderboard import Driver
from dohyo.service.evaluations.metrics import as_csv, as_document
from tests.evaluation.builders import ego, episode, infraction
from tests.service.evaluations.test_scoring import drives_of, entry

HIT = infraction(InfractionKind.COLLISION_VEHICLE, route_m=50.0)


def test_lost_drives_count_as_zero_beside_the_means_that_leave_them_out() -> None:
    drives = drives_of(episode(ego(), cell="town"))
    whole, without = as_document(entry("a", drives, lost={"town": 1, "gone": 2})), as_document(entry("a", drives))
    assert (without["all"]["lost"], without["all"]["scores_lost_as_zero"]) == (0, None)
    assert (whole["all"]["lost"], whole["cells"]["town"]["lost"], whole["cells"]["gone"]["lost"]) == (3, 1, 2)
    assert whole["all"]["scores"] == without["all"]["scores"]
    as_zero = [whole[part]["scores_lost_as_zero"] for part in ("all",)]
    as_zero += [whole["cells"][cell]["scores_lost_as_zero"] for cell in ("town", "gone")]
    assert [one["route_completion"]["mean"] for one in as_zero] == [20.0, 40.0, 0.0]


def test_the_gridlocked_drives_of_an_episode_are_one_episode_in_intervals() -> None:
    egos = [ego(name=name, status=Status.PERFECT) for name in ("one", "two", "three")]
    there = [drive for n in range(2) for drive in drives_of(episode(*egos, cell="town", seed=n), f"ep{n}")]
    gone = drives_of(episode(*egos[:2], ego(name="three", status=Status.GRIDLOCK), cell="town", seed=2), "ep2")
    lost = {"lost": {"town": 3}, "lost_egos": {"one": 1, "two": 1, "three": 1}, "gridlocked": tuple(gone)}
    alone = entry("a", there, **lost)
    mixed = entry("a", there, **lost, others={"three": Driver("su-b", "b", 1, "ann", "builtin", "map")})
    whole, (side, _) = as_document(alone), compare_entries([alone, entry("b", there)], "success")["evaluations"]
    agent, _ = as_document(mixed)["agents"]
    found = [(one["lost"], one["scores_lost_as_zero"]) for one in (whole["all"], whole["cells"]["town"], side, agent)]
    assert [lost for lost, _ in found] == [3, 3, 3, 2]
    assert [scores["driving_score"]["high"] for _, scores in found] == [100.0] * 4


def test_csv_has_a_row_per_drive_one_per_cell_and_one_for_all() -> None:
    records = [
        episode(ego(HIT, HIT), name="a", cell="town"),
        episode(ego(progress_m=400.0), name="b", cell="town"),
        episode(ego(progress_m=200.0), name="c", cell="country"),
    ]
    drives = [drive for number, record in enumerate(records) for drive in drives_of(record, f"ep{number}")]
    table = list(csv.DictReader(io.StringIO(as_csv(entry("a", drives)))))
    assert [(line["row"], line["cell"], line["scenario"]) for line in table] == [
        ("drive", "town", "a"),
        ("drive", "town", "b"),
        ("drive", "country", "c"),
        ("cell", "town", ""),
        ("cell", "country", ""),
        ("all", "", ""),
    ]
    assert [float(line["driving_score"]) for line in table] == pytest.approx([28.8, 40.0, 20.0, 34.4, 20.0, 88.8 / 3])
    assert [int(line["collision_vehicle"]) for line in table] == [2, 0, 0, 2, 0, 2]
    assert [float(line["km"]) for line in table] == pytest.approx([0.8, 0.4, 0.2, 1.2, 0.2, 1.4])
    assert (table[0]["driving_score_low"], table[0]["drives"], table[5]["drives"]) == ("", "1", "3")
    low, high = float(table[3]["driving_score_low"]), float(table[3]["driving_score_high"])
    assert low == pytest.approx(28.8)
    assert high == pytest.approx(40.0)


def test_the_document_holds_cells_and_drives() -> None:
    drives = drives_of(episode(ego(HIT), cell="town"), "ep1") + drives_of(episode(ego(), cell="country"), "ep2")
    document = as_document(entry("a", drives))
    assert list(document["cells"]) == ["town", "country"]
    assert document["cells"]["town"]["scores"]["driving_score"]["mean"] == pytest.approx(48.0)
    assert document["all"]["scores"]["driving_score"]["mean"] == pytest.approx(64.0)
    assert [drive["episode"] for drive in document["drives"]] == ["ep1", "ep2"]


def test_an_evaluation_without_a_finished_episode_has_empty_metrics() -> None:
    assert as_document(entry("a", []))["all"]["scores"]["driving_score"] == {
        "mean": None,
        "low": None,
        "high": None,
        "n": 0,
    }
    assert as_csv(entry("a", [])).count("\n") == 2
