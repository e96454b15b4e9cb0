"""Trained arms: a training begins unless it is only to be judged, and what has no policy says so."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.registry import studies, study_named
from dohyo.agents.studies.trained import TrainedOptions, columns, result_of
from dohyo.sumo_networks.errors import SimulationError

TRAINING = [name for name in studies() if issubclass(study_named(name).options, TrainedOptions)]


def test_a_policy_is_trained_where_it_is_wanted_and_only_read_otherwise(tmp_path: Path) -> None:
    trained: list[Path] = []

    def train(folder: Path) -> None:
        trained.append(folder)
        folder.mkdir(parents=True)
        (folder / "best.onnx").touch()

    with pytest.raises(SimulationError, match=f"no policy in '{tmp_path}/ppo/seed-1' so far"):
        TrainedOptions(runs=tmp_path, train=False).trained("ppo/seed-1", train)
    assert trained == []
    policy = TrainedOptions(runs=tmp_path).trained("ppo/seed-1", train)
    assert (policy, trained) == (tmp_path / "ppo" / "seed-1" / "best.onnx", [policy.parent])
    assert TrainedOptions(runs=tmp_path, train=False).trained("ppo/seed-1", train) == policy


def test_a_training_that_left_no_policy_is_lost(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match="no policy"):
        TrainedOptions(runs=tmp_path).trained("gri/seed-0", lambda folder: None, "policy.onnx")


def test_tables_of_a_training_have_numbers_and_gaps(tmp_path: Path) -> None:
    (tmp_path / "metrics.csv").write_text("steps,return\n0,\n500,-3.5\n")
    (tmp_path / "evaluations.csv").write_text("steps,return\n")
    found = columns(tmp_path / "metrics.csv")
    assert found["steps"].tolist() == [0.0, 500.0]
    assert math.isnan(found["return"][0])
    assert found["return"][1] == -3.5
    assert len(columns(tmp_path / "evaluations.csv")["return"]) == 0
    (tmp_path / "result.json").write_text(json.dumps({"steps": 500, "finished": True}))
    assert result_of(tmp_path, "finished") == {"finished": True}


@pytest.mark.parametrize("name", TRAINING)
def test_jobs_that_begin_the_same_training_name_it(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[str] = []

    def trained(self: TrainedOptions, training: str, *rest: Any) -> Path:
        begun.append(training)
        raise SimulationError("begins no training here")

    monkeypatch.setattr(TrainedOptions, "trained", trained)
    study = study_named(name)
    options = study.options(runs=tmp_path)
    jobs: dict[Any, list[Cell]] = {}
    for cell in study.cells(options):
        if cell.training_seed is not None:
            jobs.setdefault(study.together(cell), []).append(cell)
    by_training: dict[str, list[Cell]] = {}
    for job in jobs.values():
        with pytest.raises(SimulationError, match="begins no training"):
            list(study.work(options, job))
        by_training.setdefault(begun[-1], []).append(job[0])
    assert by_training
    shared = {training: cells for training, cells in by_training.items() if len(cells) > 1}
    assert all(training in study.trainings(cell) for training, cells in shared.items() for cell in cells)
