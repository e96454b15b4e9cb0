from __future__ import annotations

import json
from pathlib import Path

import pytest

from dohyo.agents.speed_planning.buffer_training import BufferEnv, discharge
from dohyo.agents.speed_planning.dissipation import Arm, Morning, run
from dohyo.agents.speed_planning.study import (
    ARMS,
    collect,
    compared,
    drive,
    drive_all,
    drive_seed,
    in_a_copy,
    run_path,
    settings_of,
    tables,
)
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError

OUTCOME = {
    "throughput_vph": 5000.0, "speed_mps": 20.0, "speed_std_mps": 10.0, "speed_std_within_mps": 9.0,
    "fuel_circles_g_km": 70.0, "fuel_sumo_g_km": 75.0, "least_headway_s": 0.3, "least_ttc_s": 1.0, "collisions": 0,
}  # fmt: skip


def runs(**stds: list[float]) -> dict[str, dict[int, dict[str, float]]]:
    return {
        name: {seed: OUTCOME | {"speed_std_mps": value} for seed, value in enumerate(values)}
        for name, values in stds.items()
    }


def test_thirteen_arms() -> None:
    assert len(ARMS) == 13
    assert {"none", "limit+none", "rule+oracle", "learned+sa-lstm"} <= set(ARMS)


def test_arms_are_compared_on_the_seeds_of_both() -> None:
    found = {"none": runs(x=[10.0, 11.0, 12.0])["x"], "rule+oracle": runs(x=[8.0, 9.0])["x"]}
    comparison, base = compared(found, "rule+oracle", "none", "speed_std_mps") or (None, 0.0)
    assert comparison is not None
    assert comparison.difference.n == 2
    assert comparison.difference.mean == pytest.approx(-2.0)
    assert comparison.verdict == "<"
    assert base == pytest.approx(10.5)
    assert compared(found, "rule+none", "none", "speed_std_mps") is None


def test_the_tables_say_the_change_in_percent() -> None:
    text = tables({"none": runs(x=[10.0, 10.0])["x"], "limit+oracle": runs(x=[8.0, 8.0])["x"]})
    assert "| limit+oracle | none | 2 | +0.0 [+0.0, +0.0] = | -20.0 [-20.0, -20.0] < |" in text


def test_a_run_that_is_there_is_kept_and_one_of_other_settings_refused(tmp_path: Path) -> None:
    morning = Morning()
    path = run_path(tmp_path, "none", 3)
    path.parent.mkdir(parents=True)
    document = {"arm": "none", "seed": 3, "settings": settings_of(morning, "sa-lstm"), "outcome": OUTCOME}
    path.write_text(json.dumps(document))
    assert drive_seed(tmp_path, ["none"], 3, morning, "sa-lstm") == 0
    drive(tmp_path, "none", 3, morning, "sa-lstm")
    assert collect(tmp_path) == {"none": {3: OUTCOME}}
    with pytest.raises(InvalidInputError, match="other settings"):
        drive(tmp_path, "none", 3, Morning(penetration=0.1), "sa-lstm")
    with pytest.raises(InvalidInputError, match="other settings"):
        drive_seed(tmp_path, ["none"], 3, Morning(penetration=0.1), "sa-lstm")


def test_what_is_done_in_a_copy_leaves_nothing_here_but_its_files(tmp_path: Path) -> None:
    done: list[int] = []

    def work() -> None:
        done.append(1)
        (tmp_path / "done").write_text("yes")

    in_a_copy("work", work)
    assert (tmp_path / "done").read_text() == "yes"
    assert done == []


def test_a_copy_that_fails_is_said_by_its_name(capfd: pytest.CaptureFixture[str]) -> None:
    def work() -> None:
        raise ValueError("not today")

    with pytest.raises(SimulationError, match="rule, seed 4: the run failed"):
        in_a_copy("rule, seed 4", work)
    assert "not today" in capfd.readouterr().err


def test_training_mornings_begin_with_traffic_and_pay_what_passes() -> None:
    env = BufferEnv(seed=2, roads=4)
    assert env.reset().shape == (4, env.observations)
    _, reward, over = env.step(env.reset()[:, :1] * 0 - 1)
    assert (reward > 0.3).all()
    assert (reward <= 1.01).all()
    assert not over
    assert discharge(None, 2, roads=4) == pytest.approx(discharge(None, 2, roads=4))


@pytest.mark.slow
def test_a_short_morning_from_end_to_end_alone_and_from_a_shared_lead_in(tmp_path: Path) -> None:
    """In processes of their own, since both leave SUMO and a fleet behind: the same arm gives the same outcome."""
    morning = Morning(start_s=5.3 * 3600, duration_s=70, warm_up_s=60, penetration=0.3)
    arms = ["none", "rule+persistence"]
    drive_all(tmp_path, arms, [1], morning, "sa-lstm", workers=1)
    shared = {name: by_seed[1] for name, by_seed in collect(tmp_path).items()}
    alone = run(Arm("rule", "persistence"), 1, morning)
    assert shared["rule+persistence"] == alone.as_dict()
    assert shared["none"] != shared["rule+persistence"]
    assert alone.travelled_km > 20
    assert alone.least_ttc_s > 0
    assert alone.fuel_sumo_g_km > 20


def test_a_network_that_is_not_there_is_said_before_anything_is_driven(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="nowhere"):
        drive_all(tmp_path, ["none", "limit+sa-lstm"], [0], Morning(), str(tmp_path / "nowhere.safetensors"), workers=1)
    assert not list(tmp_path.iterdir())
