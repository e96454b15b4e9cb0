from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.episode.runner import drive_episode
from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.records.store import write_record
from dohyo.evaluation.scores.nuplan.score import ClosedLoop
from dohyo.evaluation.scores.nuplan.summary import score_records
from dohyo.evaluation.summary import summarise
from dohyo.service.boards.leaderboard import Entry
from dohyo.service.evaluations.scoring import (
    Drive,
    compare_drives,
    lost_episodes,
    rates_per_km,
    scores_of,
    summarise_drives,
    summary_at,
    summary_of,
)
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Scenario, Traffic
from tests.evaluation.builders import ego, episode, infraction, lost
from tests.service.served import STEADY, short


def drives_of(record: EpisodeRecord, name: str = "ep") -> list[Drive]:
    summary = json.loads(json.dumps(summary_of(record, "2.0")))  # as it comes back from a database
    scenario = record.scenario
    return [Drive(name, scenario.name, scenario.cell, scenario.seed, facts) for facts in summary["egos"]]


def entry(agent: str, drives: list[Drive], **changes: object) -> Entry:
    made = Entry(
        evaluation=f"ev-{agent}",
        submission=f"su-{agent}",
        agent=agent,
        version=1,
        owner="ann",
        kind="builtin",
        track="map",
        benchmark="made",
        benchmark_sha256="b" * 64,
        seeds=(0,),
        finished=None,
        drives=tuple(drives),
        dohyo_versions=("0.2.0",),
    )
    return dataclasses.replace(made, **changes)  # type: ignore[arg-type]


VEHICLE = infraction(InfractionKind.COLLISION_VEHICLE, time_s=3.14159, route_m=40.0)
RED = infraction(InfractionKind.RED_LIGHT, time_s=9.0, route_m=90.0)


def test_a_drive_of_80_percent_with_two_hits_and_a_red_light() -> None:
    summary = summary_of(episode(ego(VEHICLE, VEHICLE, RED)), "2.0")
    (facts,) = summary["egos"]
    assert facts["rc"] == 80.0
    assert facts["ip"] == pytest.approx(0.6 * 0.6 * 0.7)
    assert facts["ds"] == pytest.approx(20.16)
    assert facts["infractions"] == {"collision_vehicle": 2, "red_light": 1}
    assert facts["marks"][0] == {"kind": "collision_vehicle", "time_s": 3.14, "x_m": 0.0, "y_m": 0.0, "route_m": 40.0}
    assert (facts["success"], facts["nocrash"], facts["status"]) == (False, False, "failed: agent ran out of time")
    assert (facts["route_m"], facts["driven_m"], facts["km"]) == (1000.0, 800.0, 0.8)
    assert summary["decision_ms"] == [1.0, 2.0, 3.0]
    assert summary["wall_s"] == 1.5


def test_rules_change_the_driving_score_alone() -> None:
    record = episode(ego(VEHICLE, VEHICLE, RED))
    old, new = (summary_of(record, rules)["egos"][0] for rules in ("2.0", "2.1"))
    assert new["ds"] == pytest.approx(80 / 2.8)
    assert {key for key in old if old[key] != new[key]} == {"ds", "ip"}


def test_a_record_without_timing_and_a_lost_one_are_summarised_too() -> None:
    assert summary_of(episode(timing=None), "2.0")["decision_ms"] is None
    assert summary_of(lost(), "2.0")["egos"][0]["status"] == "lost: simulation failed"


def test_drives_summarised_from_the_database_equal_the_records() -> None:
    records = [
        episode(ego(VEHICLE), name="a"),
        episode(ego(RED, status=Status.COMPLETED, progress_m=1000.0), name="b"),
        episode(ego(name="one"), ego(VEHICLE, RED, name="two", progress_m=300.0), name="c"),
    ]
    drives = [drive for number, record in enumerate(records) for drive in drives_of(record, f"ep{number}")]
    found, expected = summarise_drives(drives), summarise(records)
    for name, estimate in expected.scores.items():
        assert found["scores"][name] == dataclasses.asdict(estimate), name
    for kind, estimate in expected.per_km.items():
        assert found["per_km"][kind] == dataclasses.asdict(estimate), kind
    assert found["statuses"] == expected.statuses
    assert found["km"] == expected.km
    assert (found["episodes"], found["drives"]) == (3, 4)


def test_lost_drives_from_the_database_equal_those_of_the_records() -> None:
    egos = [ego(VEHICLE, name="one"), ego(name="two", progress_m=300.0)]
    records = [episode(*egos, seed=seed) for seed in range(3)]
    records += [episode(ego(name="one", status=Status.GRIDLOCK), egos[1], seed=seed) for seed in (3, 4)]
    drives = [drive for number, record in enumerate(records) for drive in drives_of(record, f"ep{number}")]
    sizes = lost_episodes(5, drives[6:])
    assert sizes == [2, 2, 1]
    found, expected = summarise_drives(drives[:6], sizes), summarise(records, unrecorded=1)
    assert expected.scores_lost_as_zero is not None
    assert (found["lost"], expected.lost) == (5, 5)
    for name, estimate in expected.scores_lost_as_zero.items():
        assert found["scores_lost_as_zero"][name] == dataclasses.asdict(estimate), name


def test_egos_of_an_episode_are_one_pair() -> None:
    good = drives_of(episode(*(ego(name=f"e{i}", progress_m=1000.0) for i in range(8))), "a")
    poor = drives_of(episode(*(ego(name=f"e{i}", progress_m=500.0) for i in range(8))), "b")
    found = compare_drives("driving_score", good, poor)
    assert found is not None
    assert (found.difference.n, found.verdict) == (1, "=")


def test_rates_pool_kilometres() -> None:
    drives = drives_of(episode(ego(VEHICLE))) + drives_of(episode(ego(VEHICLE, progress_m=200.0)))
    assert rates_per_km(drives) == {"collision_vehicle": pytest.approx(2 / 1.0)}


@pytest.mark.parametrize("headline", Headline)
def test_every_headline_is_a_score_of_a_drive(headline: Headline) -> None:
    facts = summary_of(episode(ego(RED)), "2.0", {"ego": terms(0.5, 0.2)})["egos"][0]
    assert Drive("ep", "s", "c", 0, facts).score(headline) >= 0.0


def test_a_running_evaluation_without_a_drive_shows_no_closed_loop_score() -> None:
    scores = summarise_drives([])["scores"]
    assert not {"closed_loop", "no_collision"} & set(scores)
    assert scores["driving_score"]["mean"] is None


def terms(no_collision: float, progress: float) -> ClosedLoop:
    """A drive that is perfect but for these two."""
    return ClosedLoop(
        no_collision=no_collision,
        drivable_area=1.0,
        driving_direction=1.0,
        making_progress=1.0,
        time_to_collision=1.0,
        speed_limit=1.0,
        progress=progress,
        comfort=1.0,
        red_lights=0,
    )


def test_a_closed_loop_drive_has_its_score_and_terms_in_percent() -> None:
    summary = summary_of(episode(ego(RED)), "2.0", {"ego": terms(0.5, 0.2)})
    (facts,) = summary["egos"]
    assert facts["closed_loop"]["closed_loop"] == pytest.approx(50.0 * (11 + 5 * 0.2) / 16)
    assert (facts["closed_loop"]["no_collision"], facts["closed_loop"]["progress"]) == (50.0, 20.0)
    drive = Drive("ep", "s", "c", 0, facts)
    assert drive.score("closed_loop") == facts["closed_loop"]["closed_loop"]
    assert drive.score("driving_score") == pytest.approx(56.0)
    assert summarise_drives([drive])["scores"]["closed_loop"]["mean"] == drive.score("closed_loop")


def test_drives_without_that_score_say_nothing_of_it() -> None:
    with_it = Drive("a", "s", "c", 0, summary_of(episode(ego()), "2.0", {"ego": terms(1.0, 1.0)})["egos"][0])
    without = Drive("b", "s", "c", 1, summary_of(episode(ego()), "2.0")["egos"][0])
    assert "closed_loop" in scores_of([with_it])
    assert "closed_loop" not in scores_of([with_it, without])
    assert "closed_loop" not in summarise_drives([without])["scores"]


def test_a_record_on_disk_has_the_closed_loop_score_that_the_command_line_prints(tmp_path: Path) -> None:
    mission = short().missions["all"][0].model_copy(update={"name": "ego"})
    scenario = Scenario(network="ingolstadt", missions=(mission,), traffic=Traffic(), duration_s=3.0, reference_m=20.0)
    record, trajectory = drive_episode(scenario, {"ego": make_agent(STEADY)})
    write_record(tmp_path, "one", record, trajectory)
    (scored,) = score_records([(record, tmp_path / "one.json")])
    (facts,) = summary_at(tmp_path / "one.json", record, "2.0")["egos"]
    assert facts["closed_loop"]["closed_loop"] == scored.terms.score > 0.0
    versions = record.versions.model_copy(update={"network_sha256": "f" * 64})
    with pytest.raises(InvalidInputError, match="driven on network 'ingolstadt' ffffffffffff, and the one here is"):
        score_records([(record.model_copy(update={"versions": versions}), tmp_path / "one.json")])
    assert "closed_loop" not in summary_of(record, "2.0")["egos"][0]
