"""Study: longer routes of the same driving lower the driving score alone; and where an ego loses its time."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.priboot.study import hesitation, study
from dohyo.agents.priboot.study.lengths import JOINED, in_pairs, joined
from dohyo.agents.priboot.study.tables import arms_table
from dohyo.agents.priboot.training.train import TrainConfig
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.study import Results
from dohyo.sumo_networks.scenario import Traffic
from tests.agents.priboot.test_priboot import policy


def drive(done: float, collisions: int) -> Row:
    """A kilometre of which a share was driven, with collisions with vehicles (p = 0.6)."""
    driven = 1000.0 * done
    rate = math.exp(-4.0 * collisions * (1.0 - 0.6) / done)
    return {
        "route_m": 1000.0, "driven_m": driven, "route_completion": 100.0 * done,
        "infraction_penalty": 0.6**collisions, "irs": 100.0 * done * rate,
    }  # fmt: skip


def test_at_a_constant_rate_only_the_driving_score_falls_with_the_length() -> None:
    found = {count: joined([drive(0.8, 1)], count) for count in JOINED}
    for count, (penalty, score, irs, by_route) in found.items():
        assert penalty == pytest.approx(0.6**count)
        assert score == pytest.approx(80.0 * 0.6**count)
        assert irs == pytest.approx(80.0 * math.exp(-2.0))
        assert by_route == pytest.approx(80.0 * math.exp(-1.6))


def on_missions(*drives: Row) -> list[Row]:
    cell = {"arm": "autopilot", "training_seed": None, "benchmark": "nocrash", "seed": 0}
    return [{**cell, "scenario": f"m{number}", **one} for number, one in enumerate(drives)]


def test_success_in_all_drives_has_wilsons_interval() -> None:
    more = {"driving_score": 100.0, "irs_route": 100.0, "nocrash_success": 100.0}
    rows = [{**one, **more} for one in on_missions(*(drive(1.0, 0) for _ in range(25)))]
    line = arms_table(Results(rows, {})).splitlines()[2]
    assert "| 100.0 [86.7, 100.0] |" in line
    assert line.count("[86.7") == 1, "the driving score is no share"


def test_two_equal_drives_joined_have_the_same_rate_score_and_a_lower_driving_score() -> None:
    alone, both = in_pairs(on_missions(drive(1.0, 1), drive(1.0, 1), drive(1.0, 9)))
    assert (alone["arm"], both["arm"]) == ("autopilot x 1", "autopilot x 2")
    assert alone["driving_score"] == pytest.approx(60.0)
    assert both["driving_score"] == pytest.approx(36.0)
    assert alone["irs"] == pytest.approx(both["irs"]) == pytest.approx(100.0 * math.exp(-1.6))


def test_pairs_stay_together_after_a_lost_drive() -> None:
    drives = on_missions(*(drive(1.0, number) for number in range(6)))
    others = [{**one, "arm": "full", "training_seed": 0} for one in drives]
    of_all = [one["scenario"] for one in in_pairs(others) if one["arm"] == "full x 2"]
    assert of_all == ["m0, m1", "m2, m3", "m4, m5"]
    of_some = [
        one["scenario"] for one in in_pairs([*others, *drives[:1], *drives[2:]]) if one["arm"] == "autopilot x 2"
    ]
    assert of_some == ["m2, m3", "m4, m5"], "m1 was lost, and m0 has no partner"


@given(st.integers(0, 9), st.integers(0, 9))
def test_the_mean_rate_score_of_two_complete_drives_is_never_below_that_of_both_joined(one: int, other: int) -> None:
    alone, both = in_pairs(on_missions(drive(1.0, one), drive(1.0, other)))
    assert alone["irs"] >= both["irs"] - 1e-9  # Jensen's inequality: the score is convex in the rate


def test_an_ego_that_stands_on_a_free_road_loses_all_its_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(hesitation, "LONGEST_S", 5.0)
    drawn = hesitation.MISSIONS.scenarios()[0]
    empty = drawn.model_copy(update={"traffic": Traffic(), "events": ()})
    stands = policy(tmp_path, 0.0)
    metres, ticks = hesitation.lost_time(empty, "priboot", stands)
    assert ticks["stands though it could go"] == ticks["stands"] == ticks["time"] == 50
    assert metres < 1.0
    metres, ticks = hesitation.lost_time(empty, "autopilot", stands)
    assert ticks["stands"] < 15
    assert metres > 5.0


def test_a_training_that_begins_from_another_trains_that_first(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trained = []

    def train(config: TrainConfig, order: TrainRequest) -> Path:
        assert config.begin is None or config.begin.exists()
        order.out.mkdir(parents=True)
        for kind in ("safetensors", "onnx"):
            (order.out / f"priboot.{kind}").touch()
        trained.append(f"{order.out.parent.name}/{order.out.name}")
        return order.out / study.POLICY

    monkeypatch.setattr(study, "PRIBOOT", Trainer("a stand-in", TrainConfig, train))
    for training in ("tuned", "further", "masks"):
        study.train_to_the_end(tmp_path, training, 2, tmp_path / training / "seed-2")
    assert trained == ["full/seed-2", "tuned/seed-2", "further/seed-2", "masks/seed-2"]
    needed = {arm: study.trainings(Cell(arm, 2, "nocrash", "m0", 0)) for arm in ("full", "no-rules", "further")}
    assert needed["full"] == needed["no-rules"] == trained[:1]
    assert needed["further"] == ["full/seed-2", "further/seed-2"]
    assert study.trainings(Cell("autopilot", None, "nocrash", "m0", 0)) == []
