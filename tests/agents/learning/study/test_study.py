"""Study of peers: a short training of both libraries is a row with equal steps, and the table shows both."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from dohyo.agents.learning.study import study
from dohyo.agents.studies.study import read_results


@pytest.mark.slow
def test_both_libraries_train_and_are_judged_alike(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    match = study.MATCHES["Pendulum-v1", "sac"]
    short = dataclasses.replace(match, steps=200, config=match.config.model_copy(update={"round_steps": 100}))
    monkeypatch.setattr(study, "MATCHES", {("Pendulum-v1", "sac"): short})
    study.STUDY.run(tmp_path, ["episodes=1"], chosen=lambda cell: cell.training_seed == 0)
    rows = read_results(tmp_path).rows
    assert [row["arm"] for row in rows] == ["sac, dohyo", "sac, stable-baselines3"]
    assert all(row["steps"] == 200 and -2500.0 < row["return"] < 0.0 for row in rows)
    assert all(abs(row["updates"] - 100) <= 1 for row in rows)
    table = study.table(read_results(tmp_path))
    assert "Pendulum-v1 | SAC | dohyo | 200 | 1" in table
    assert "stable-baselines3" in table
