"""The study of plans: arms on the same mornings, their changes in percent, and copies of a process."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dohyo.agents.speed_planning.study.dissipation import Arm, Morning, run
from dohyo.agents.speed_planning.study.mornings import ARMS, drive_morning, in_a_copy, morning_place
from dohyo.agents.speed_planning.study.study import STUDY, Options, cells, tables
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row, read_rows
from dohyo.agents.studies.study import Results
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError

OUTCOME = {
    "throughput_vph": 5000.0, "speed_mps": 20.0, "speed_std_mps": 10.0, "speed_std_within_mps": 9.0,
    "fuel_circles_g_km": 70.0, "fuel_sumo_g_km": 75.0, "least_headway_s": 0.3, "least_ttc_s": 1.0, "collisions": 0,
    "waiting": 0,
}  # fmt: skip


def rows(arm: str, *deviations: float, training: int | None = None) -> list[Row]:
    return [
        {**Cell(arm, training, *morning_place(seed))._asdict(), **OUTCOME, "speed_std_mps": value}
        for seed, value in enumerate(deviations)
    ]


def test_all_arms_have_ten_mornings_and_the_chosen_designs_forty_further_ones() -> None:
    wanted = cells(Options())
    assert {"none", "limit+none", "rule+oracle", "learned+sa-lstm", "rule+persistence@1%"} <= set(ARMS)
    seeds = {arm: {cell.seed for cell in wanted if cell.arm == arm} for arm in ARMS}
    assert seeds["learned+oracle"] == seeds["rule+persistence@10%"] == set(range(10))
    assert seeds["none"] == seeds["limit+persistence"] == seeds["rule+persistence"] == set(range(50))
    assert {cell.training_seed for cell in wanted if cell.arm in ("rule+sa-lstm", "learned+none")} == {0}
    assert {cell.training_seed for cell in wanted if cell.arm in ("none", "rule+oracle")} == {None}
    assert Options().morning == Morning()
    assert Options(minutes=10.0, kernel_m=5000.0).morning.planner.kernel_m == 5000.0


def test_the_tables_say_the_change_in_percent_on_the_seeds_of_both() -> None:
    some = [*rows("none", *[10.0] * 8, 99.0), *rows("limit+oracle", *[8.0] * 8)]
    text = tables(Results(some, {}))
    assert "| limit+oracle | none | 8 | +0.0 [+0.0, +0.0] = | -20.0 [-20.0, -20.0] < |" in text
    assert "| none | 9 | 5000 [5000, 5000] |" in text


def test_one_training_resolves_nothing() -> None:
    some = [*rows("none", *[10.0] * 8), *rows("learned+oracle", *[8.0] * 8, training=0)]
    assert "| learned+oracle | none | 8 | +0.0 [+0.0, +0.0] = | -20.0 [-20.0, -20.0] = |" in tables(Results(some, {}))


def test_few_mornings_resolve_nothing() -> None:
    text = tables(Results([*rows("none", 10.0, 10.0), *rows("limit+oracle", 8.0, 8.0)], {}))
    assert "| limit+oracle | none | 2 | +0.0 [+0.0, +0.0] = | -20.0 [-20.0, -20.0] = |" in text


def test_what_is_done_in_a_copy_leaves_nothing_here_but_its_result() -> None:
    done: list[int] = []

    def work() -> list[int]:
        done.append(1)
        return [*done, *range(100_000)]

    assert len(in_a_copy("work", work)) == 100_001
    assert done == []


def test_a_copy_that_fails_is_said_by_its_name(capfd: pytest.CaptureFixture[str]) -> None:
    def work() -> None:
        raise ValueError("not today")

    with pytest.raises(SimulationError, match="rule, seed 4: the run failed"):
        in_a_copy("rule, seed 4", work)
    assert "not today" in capfd.readouterr().err


@pytest.mark.slow
def test_a_short_morning_alone_and_from_a_shared_lead_in() -> None:
    """In processes of their own, since both leave SUMO and a fleet behind: the same arm gives the same outcome."""
    morning = Morning(start_s=5.3 * 3600, duration_s=70, warm_up_s=60, penetration=0.3)
    job = [Cell(arm, None, *morning_place(1)) for arm in ("none", "rule+persistence")]
    none, rule = in_a_copy("shared", lambda: list(drive_morning(morning, "sa-lstm", job)))
    alone = in_a_copy("alone", lambda: run(Arm("rule", "persistence"), 1, morning).as_dict())
    assert {name: rule[name] for name in alone} == alone
    assert none["speed_std_mps"] != rule["speed_std_mps"]
    assert alone["travelled_km"] > 20
    with_few = in_a_copy("with few", lambda: run(Arm("rule", "persistence", 0.01), 1, morning).as_dict())
    without = in_a_copy("without", lambda: run(Arm(), 1, replace(morning, penetration=0.01)).as_dict())
    assert without == {name: none[name] for name in without}, "connected cars that get no plan drive as all others"
    assert with_few != alone
    assert alone["least_ttc_s"] > 0
    assert alone["fuel_sumo_g_km"] > 20


def test_a_network_that_is_not_there_is_said_before_anything_is_driven(tmp_path: Path) -> None:
    settings = [f"forecaster='{tmp_path / 'nowhere.safetensors'}'"]
    with pytest.raises(InvalidInputError, match="nowhere"):
        STUDY.run(tmp_path / "out", settings, chosen=lambda cell: cell.arm in ("none", "limit+sa-lstm"))
    assert read_rows(tmp_path / "out") == []
