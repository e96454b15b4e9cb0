"""The study: finished runs stay, tables come out of results alone, claims are judged by their intervals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.forecasting import study, tables
from dohyo.agents.forecasting.reading import read_data
from tests.agents.forecasting.roads import write_folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> study.Study:
    folder = tmp_path_factory.mktemp("study")
    data = read_data(write_folder(folder / "data", days=3, rows=40, segments=4))
    return study.Study(data, folder / "out", steps=2)


def test_a_finished_run_is_not_run_again(small: study.Study, monkeypatch: pytest.MonkeyPatch) -> None:
    run = study.Run("lstm", None, 1.0, 0)
    first = small.result(run)
    assert np.shape(first["sets"]["hard"]["mse"]) == (2, 3)
    monkeypatch.setattr(study.Study, "trained", lambda *_: pytest.fail("trained again"))
    assert small.result(run) == first


def test_a_run_on_other_data_is_run_again(small: study.Study, tmp_path: Path) -> None:
    run = study.Run("linear", None, 1.0, 0)
    small.result(run)
    data = read_data(write_folder(tmp_path / "data", days=4, rows=40, segments=4))
    other = study.Study(data, small.out, steps=2)
    assert other.result(run)["of"][0] != small.result(run)["of"][0]


def test_the_n_step_starts_from_the_one_step_of_its_seed(small: study.Study) -> None:
    one, many = study.Run("sa-lstm", 3, 1.0, 0), study.Run("sa-lstm-n-step", 3, 1.0, 0)
    small.result(one)
    forecaster = study.make_forecaster("sa-lstm-n-step", 4)
    first = study.load_forecaster(small.out / "models" / f"{one.arm}-0.safetensors")
    assert isinstance(forecaster, study.Learned)
    study.start_from(forecaster, first)
    rows = np.random.default_rng(0).uniform(5, 30, (8, 4))
    np.testing.assert_allclose(forecaster.predict(rows)[0], first.predict(rows)[0], rtol=1e-5)
    assert small.result(many)["arm"] == "sa-lstm-n-step-lap3"


def test_every_arm_of_the_tables_is_run() -> None:
    arms = {run.arm for run in study.runs([0])}
    claimed = {arm for claim in tables._directions() for arm in claim[1:3]}
    assert claimed | set(study.SHIPPED.values()) <= arms
    assert {run.seed for run in study.runs([4, 5])} == {4, 5}


@pytest.mark.parametrize(
    ("shift", "said"), [(-1.0, "reproduced"), (1.0, "contradicted"), (0.0, "not resolved")], ids=str
)
def test_a_direction_is_judged_by_its_interval(shift: float, said: str) -> None:
    noise = np.array([[0.3, -0.3, 0.2, -0.2]] * 3)
    arms = {"a": (5.0 + shift + noise).tolist(), "b": np.full((3, 4), 5.0).tolist()}
    runs = {
        arm: [{"seed": i, "sets": {"hard": {"mse": [[one] for one in row]}}} for i, row in enumerate(rows)]
        for arm, rows in arms.items()
    }
    assert tables.verdict({"arms": runs}, "a", "b", "hard", 0)[1] == said
    fewer = {arm: some[:2] for arm, some in runs.items()}
    few = tables.verdict({"arms": fewer}, "a", "b", "hard", 0)[1]
    assert few == (said if shift == 0.0 else f"{said}, too few seeds")
