"""One episode: whatever an agent does, there is a record, and the same one again."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.experts.reckless import Reckless
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import drive_episode, run_episode
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.networks.entries import network_path
from dohyo.sumo_networks.scenario import Mission, Obstacle, Place, Scenario, Traffic
from tests.evaluation import agents


def mission(name: str = "ego", start_m: float = 20.0) -> Mission:
    return Mission(
        name=name,
        start=Place(lane="737320747#3_2", position_m=start_m),
        goal=Place(lane="737320747#4_2", position_m=60.0),
    )


def scenario(**changes: object) -> Scenario:
    defaults: dict[str, object] = {
        "network": "ingolstadt",
        "missions": (mission(),),
        "traffic": Traffic(vehicles=5, pedestrians=5, warm_up_s=5.0),
        "seed": 4,
    }
    return Scenario(**(defaults | changes))  # type: ignore[arg-type]


def test_a_drive_to_the_goal_is_complete() -> None:
    record = run_episode(scenario(traffic=Traffic()), {"ego": agents.Steady()})
    (ego,) = record.egos
    assert ego.status is Status.PERFECT
    assert ego.failure is None
    assert ego.progress_m > 0.99 * ego.route_length_m
    assert ego.driven_m == pytest.approx(ego.progress_m, rel=0.02)
    assert record.ticks == pytest.approx(ego.duration_s * 10)


def test_the_same_episode_has_the_same_hash_and_another_seed_another() -> None:
    first = run_episode(scenario(), {"ego": agents.Steady()})
    again = run_episode(scenario(), {"ego": agents.Steady()})
    other = run_episode(scenario(seed=5), {"ego": agents.Steady()})
    assert first.record_hash == again.record_hash
    assert first.record_hash != other.record_hash


def test_a_record_names_the_roads_that_were_driven_though_their_file_is_another_meanwhile(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped, folder = network_path("ingolstadt"), tmp_path / "networks" / "town"
    monkeypatch.setenv("DOHYO_HOME", str(tmp_path))
    folder.mkdir(parents=True)
    there = folder / shipped.name
    (folder / "network.toml").write_text(f'title = "Town"\nsource = "made"\nlicence = "CC0"\nfile = "{shipped.name}"\n')
    shutil.copy(shipped, there)

    class Replaces(agents.Steady):
        def misbehave(self) -> np.ndarray:
            there.write_bytes(network_path("town-test").read_bytes())
            return super().misbehave()

    driven = load_network("town").sha256
    record = run_episode(scenario(network="town", traffic=Traffic()), {"ego": Replaces()})
    assert record.egos[0].status is Status.PERFECT
    assert load_network("town").sha256 != driven
    assert record.versions.network_sha256 == driven


def test_trajectories_cover_every_tick() -> None:
    record, trajectory = drive_episode(scenario(), {"ego": agents.Steady()})
    ego = trajectory.tick[trajectory.key == -1]
    assert ego.tolist() == list(range(record.ticks + 1))
    assert (trajectory.key >= 0).any()


@pytest.mark.parametrize(
    ("agent", "status", "says"),
    [
        (agents.Raises(), Status.AGENT_RAISED, "RuntimeError: out of ideas"),
        (agents.Exits(), Status.AGENT_RAISED, "SystemExit: 3 (agents.py:"),
        (agents.IsCancelled(), Status.AGENT_RAISED, "CancelledError"),
        (agents.BlamesTheMachine(), Status.AGENT_RAISED, "SimulationError: SUMO failed, I swear"),
        (agents.ExitsInReset(), Status.AGENT_SETUP, "SystemExit: no such mission"),
        (agents.AnswersNan(), Status.AGENT_ACTION, "finite"),
        (agents.AnswersWrongShape(), Status.AGENT_ACTION, "(2,), got shape (7,)"),
        (agents.AnswersNothing(), Status.AGENT_ACTION, "expected"),
        (agents.Hangs(), Status.AGENT_DEADLINE, "longer than 0.2 s"),
        (agents.FailsInWarmUp(), Status.AGENT_SETUP, "ValueError: no such kernel"),
        (agents.FailsInReset(), Status.AGENT_SETUP, "ValueError: no such mission"),
    ],
)
def test_an_agents_fault_ends_its_episode_and_says_why(agent: agents.Steady, status: Status, says: str) -> None:
    record = run_episode(scenario(), {"ego": agent}, act_deadline_s=0.2 if status is Status.AGENT_DEADLINE else 60.0)
    (ego,) = record.egos
    assert ego.status is status
    assert says in (ego.failure or "")
    assert not ego.status.infrastructure_fault


def test_an_agents_fault_gives_the_same_hash_again() -> None:
    hashes = {run_episode(scenario(), {"ego": agents.Raises()}).record_hash for _ in range(2)}
    assert len(hashes) == 1, "the message of the error holds an address"


def test_ctrl_c_during_a_decision_is_no_fault_of_the_agent() -> None:
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores Ctrl-C
    try:
        with pytest.raises(KeyboardInterrupt):
            run_episode(scenario(traffic=Traffic()), {"ego": agents.Interrupts()})
    finally:
        signal.signal(signal.SIGINT, before)


def test_one_agents_fault_leaves_the_others_driving() -> None:
    both = scenario(missions=(mission("a", 5.0), mission("b", 25.0)), traffic=Traffic())
    record = run_episode(both, {"a": agents.Raises(), "b": agents.Steady()})
    assert [ego.status for ego in record.egos] == [Status.AGENT_RAISED, Status.PERFECT]


def test_hitting_an_obstacle_is_recorded_and_ends_the_episode_where_asked() -> None:
    block = Obstacle(x_m=5620.0, y_m=5633.5, length_m=2.0, width_m=2.0)
    on = run_episode(scenario(obstacles=(block,), traffic=Traffic()), {"ego": agents.Steady()})
    stopped = run_episode(
        scenario(obstacles=(block,), traffic=Traffic(), stop_on_collision=True), {"ego": agents.Steady()}
    )
    assert [i.kind for i in on.egos[0].infractions] == [InfractionKind.COLLISION_STATIC]
    assert on.egos[0].infractions[0].at_fault
    assert on.egos[0].status is Status.COMPLETED
    assert stopped.egos[0].status is Status.COLLIDED


def test_the_time_limit_ends_the_episode() -> None:
    record = run_episode(scenario(time_limit_s=3.0), {"ego": agents.Steady()})
    assert record.egos[0].status is Status.TIMED_OUT
    assert record.egos[0].duration_s == pytest.approx(3.0, abs=0.2)


def test_reckless_runs_red_lights_and_collides() -> None:
    kinds = set()
    for drive in load_benchmark("quickstart").scenarios([0]):
        kinds |= {infraction.kind for infraction in run_episode(drive, {"ego": Reckless()}).egos[0].infractions}
    assert {InfractionKind.RED_LIGHT, InfractionKind.COLLISION_VEHICLE, InfractionKind.COLLISION_PEDESTRIAN} <= kinds


def test_a_mission_without_an_agent_is_refused() -> None:
    with pytest.raises(InvalidInputError, match=r"no agent for \['ego'\]"):
        run_episode(scenario(), {"other": agents.Steady()})
