"""The curriculum: its tasks, and its rule of promotion by hand."""

from __future__ import annotations

import pytest
from typer.testing import CliRunner

from dohyo.agents.learning.tasks.curriculum import Progress
from dohyo.agents.parking.training.curriculum import Doubling, tasks
from dohyo.agents.parking.training.task import ParkingTask
from dohyo.service.cli import app
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.parking.generate import Scene
from dohyo.sumo_networks.parking.rules import ALIGNED


def episodes(progress: Progress, successes: int, of: int) -> None:
    for number in range(of):
        progress.begin(row=0)
        progress.end(row=0, success=number < successes)


@pytest.mark.parametrize(("first", "wanted"), [(0.0, 0.7), (0.3, 0.7), (0.38, 0.76), (0.5, 0.8), (0.8, 0.8)])
def test_the_success_of_the_first_window_must_double_within_bounds(first, wanted):
    assert Doubling(3).wanted(first) == pytest.approx(wanted)


def test_a_learner_is_promoted_when_its_success_has_doubled():
    progress = Progress(Doubling(3, window=10))
    episodes(progress, 4, of=10)
    episodes(progress, 7, of=10)
    assert progress.level == 0
    kept = progress.state()
    again = Progress(Doubling(3, window=10))
    again.restore(kept)
    for one in (progress, again):
        episodes(one, 8, of=10)
        assert one.level == 1
    episodes(progress, 9, of=10)
    assert progress.level == 2
    episodes(progress, 10, of=10)
    assert progress.level == 2


def test_obstacles_come_before_alignment_and_the_last_task_is_the_whole():
    open_, crowded, whole = tasks(Scene.COMPLEX, ALIGNED)
    assert (open_.scene, crowded.scene, whole.scene) == (Scene.SIMPLE, Scene.COMPLEX, Scene.COMPLEX)
    assert crowded.rules.error_degrees is None
    assert whole.rules == ALIGNED
    gradual = ParkingTask(gradual=True)
    assert gradual.levels[-1] == ParkingTask().levels[0]
    assert gradual.curriculum is not None
    assert gradual.curriculum.levels == len(gradual.levels)


def test_a_curriculum_whose_checkpoints_leave_no_room_for_episodes_is_refused(tmp_path):
    arguments = ["train", "parking", "--set", "gradual=true", "--out", str(tmp_path / "run")]
    done = CliRunner().invoke(app, arguments)
    assert isinstance(done.exception, InvalidInputError)
    assert "expected checkpoint_every of at least 460800, 3 time limits of 256 karts, got 20000" in str(done.exception)
