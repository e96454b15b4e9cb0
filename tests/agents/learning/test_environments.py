"""Environments: their episodes follow from seed and actions, and can be driven again."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from gymnasium.spaces import Box

from dohyo.agents.learning import environments as environments_module
from dohyo.agents.learning.environments import Environments
from dohyo.agents.learning.evaluation import evaluate
from dohyo.agents.learning.task import Task, check_task
from dohyo.agents.learning.worker import HereSeat, TaskError, take_seats
from dohyo.sumo_networks.errors import InvalidInputError, SimulationError
from dohyo.sumo_networks.seeds import HELD_OUT_FROM, training_seed
from tests.agents.learning.problems import LENGTH, STEP, Lock, Point

ROOT = Path(__file__).parents[3]


@contextmanager
def environments(task: Task, processes: int = 0, seed: int = 1) -> Iterator[Environments]:
    seats, held_out = take_seats(task, seed, processes)
    try:
        yield Environments(task, seats, seed)
    finally:
        for seat in (*seats, held_out):
            seat.close()


def drive(where: Environments, steps: int, seed: int = 0) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    seen = []
    for _ in range(steps):
        after = where.step(rng.uniform(-STEP, STEP, (len(where), 1)).astype(np.float32))
        seen += [after.observation, after.reward, after.terminated, after.truncated, where.observation.copy()]
    return seen


def same(one: list[np.ndarray], other: list[np.ndarray]) -> bool:
    return all((a == b).all() for a, b in zip(one, other, strict=True))


class Alone(Point):
    alone = True


@pytest.mark.parametrize(("task", "processes", "kinds"), [(Point(), 0, "hh"), (Alone(), 0, "hp"), (Point(), 2, "ppp")])
def test_a_process_holds_one_environment_where_there_can_be_no_more(task, processes, kinds):
    seats, held_out = take_seats(task, 0, processes)
    try:
        assert "".join("h" if isinstance(seat, HereSeat) else "p" for seat in (*seats, held_out)) == kinds
    finally:
        for seat in (*seats, held_out):
            seat.close()


def test_training_seeds_differ_and_are_never_held_out():
    seeds = [training_seed(run, episode) for run in range(20) for episode in range(200)]
    assert len(set(seeds)) > 3990
    assert max(seeds) < HELD_OUT_FROM


@pytest.mark.parametrize("processes", [0, 2])
def test_they_go_on_where_they_were(processes):
    with environments(Point(), processes) as first:
        first.guided_share = 0.5
        first.begin()
        drive(first, 50)
        state = first.state()
        expected = drive(first, 45, seed=9)
        counts, experts = (first.steps, first.finished_count), first.expert
    with environments(Point(), processes) as second:
        second.restore(state)
        second.guided_share = 0.5
        assert same(drive(second, 45, seed=9), expected)
        assert (second.steps, second.finished_count) == counts
        assert second.expert == experts


def test_a_step_tells_of_the_episode_that_ended_and_begins_the_next():
    with environments(Point()) as where:
        where.begin()
        begun = where.observation[0, 0]
        for _ in range(LENGTH - 1):
            assert where.step(np.zeros((1, 1), np.float32)).finished == []
        last = where.step(np.full((1, 1), -STEP * begun, np.float32))
        assert last.truncated.tolist() == [True]
        assert last.terminated.tolist() == [False]
        assert last.observation.tolist() == [[0.75 * begun, 1.0]]
        assert where.observation[0, 1] == 0.0
        (finished,) = last.finished
        assert finished.total == pytest.approx(-(LENGTH - 1) - 0.75)
        assert (finished.length, finished.success, finished.measures) == (LENGTH, False, {"distance": 0.75})


def test_whole_episodes_are_guided_as_often_as_asked():
    with environments(Lock()) as where:
        where.guided_share = 0.3
        where.begin()
        finished, asked = [], []
        for _ in range(4000):
            expert = where.expert[0]
            asked.append(expert is not None)
            after = where.step(np.zeros((1, 1), np.float32) if expert is None else expert[None])
            if after.finished:
                finished += after.finished
                assert len(set(asked[-after.finished[0].length :])) == 1
        guided = [episode for episode in finished if episode.guided]
        assert len(guided) / len(finished) == pytest.approx(0.3, abs=0.04)
        assert all(episode.total == 1.0 and episode.length == 6 for episode in guided)


def test_what_is_not_deterministic_is_found_out():
    with environments(Point(fragile="drift")) as first:
        first.begin()
        drive(first, 5)
        state = first.state()
    with (
        environments(Point(fragile="drift")) as second,
        pytest.raises(SimulationError, match="the task is not deterministic, or its code has changed"),
    ):
        second.restore(state)


@pytest.mark.parametrize("processes", [0, 1])
@pytest.mark.parametrize(
    ("fragile", "message"),
    [
        ("nan", "task 'point': expected finite observations, got others at [[0]]"),
        ("raise", "task 'point', environment 0: ValueError: the point is lost"),
    ],
)
def test_a_task_that_fails_is_named(processes, fragile, message):
    with environments(Point(fragile=fragile), processes) as where:
        where.begin()
        with pytest.raises(TaskError, match=re.escape(message)):
            drive(where, 1)


def test_an_episode_whose_simulation_fails_is_cut_off_and_counts_for_nothing(caplog):
    with environments(Point(fragile="crash")) as where:
        where.begin()
        finished, cut = [], 0
        for _ in range(400):
            begun, before = where.observation[0, 1] == 0.0, where.observation.copy()
            after = where.step(np.zeros((1, 1), np.float32))
            finished += after.finished
            if after.truncated[0] and not after.finished:
                cut += 1
                assert (after.observation == before).all()  # where it was last seen, a step before
                assert (after.reward[0], before[0, 1]) == (0.0, np.float32(2 / LENGTH))
                assert where.observation[0, 1] == 0.0
                assert not begun
        assert cut == where.lost_count > 3
        assert len(finished) == where.finished_count > 3
        assert all(episode.length == LENGTH for episode in finished)
        assert where.steps == 400
        assert "is lost after 3 steps: the point fell off the line" in caplog.text
        state = where.state()
    with environments(Point(fragile="crash")) as again:
        again.restore(state)
        assert again.lost_count == cut


def test_a_process_that_dies_is_replaced_unless_it_does_again_and_again(monkeypatch, caplog):
    monkeypatch.setattr(environments_module, "MAX_LOST", 3)
    still = np.zeros((1, 1), np.float32)
    with environments(Point(fragile="die"), 1, seed=4) as where:
        where.begin()
        for _ in range(LENGTH):
            where.step(still)
        assert (where.finished_count, where.lost_count) == (1, 0)
        where.step(still)
        where.step(still)
        assert (where.finished_count, where.lost_count) == (1, 2)
        assert "is lost after 1 steps" in caplog.text
        with pytest.raises(SimulationError, match="environment 0 of task 'point': its process ended with code 3"):
            where.step(still)


def test_a_held_out_episode_that_is_lost_is_in_no_mean():
    task, (_, held_out) = Point(fragile="crash"), take_seats(Point(fragile="crash"), 0, 0)
    evaluation = evaluate(task, held_out, lambda observation: np.zeros(1, np.float32))
    expected = [seed for seed in task.held_out if np.random.default_rng(seed).choice([-1.0, 1.0]) < 0]
    assert 0 < len(expected) < len(task.held_out)
    assert evaluation.returns == [-float(LENGTH)] * len(expected)


@dataclass(frozen=True)
class Boundless(Point):
    action_space = Box(-np.inf, np.inf, (1,), np.float32)


@dataclass(frozen=True)
class Seeds(Point):
    held_out: Sequence[int] = ()


@pytest.mark.parametrize(
    ("task", "message"),
    [
        (Boundless(), "expected actions with finite bounds, got"),
        (Seeds(), "expected at least one held-out seed"),
        (Seeds(held_out=(HELD_OUT_FROM, 7)), "expected held-out seeds in .*, got 7"),
    ],
)
def test_a_task_is_checked(task, message):
    with pytest.raises(InvalidInputError, match=message):
        check_task(task)


def test_a_task_that_cannot_travel_is_refused():
    @dataclass(frozen=True)
    class Local(Point):
        pass

    with pytest.raises(InvalidInputError, match="cannot be sent to another process"):
        take_seats(Local(), 0, 1)


def test_a_process_of_an_environment_does_not_load_torch():
    code = "import sys, dohyo.agents.learning.worker, dohyo.agents.learning.task; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
