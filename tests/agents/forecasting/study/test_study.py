"""The study: trained forecasters stay, tables come out of rows alone, and every claim is of arms."""

from __future__ import annotations

import json
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.forecasting import training
from dohyo.agents.forecasting.data.reading import read_data
from dohyo.agents.forecasting.learned import Learned
from dohyo.agents.forecasting.registry import SIMPLE, load_forecaster, make_forecaster
from dohyo.agents.forecasting.study import lab, study, tables
from dohyo.agents.forecasting.study.arms import PHASES, Variant
from dohyo.agents.forecasting.study.lab import SHIPPED, Lab, start_from
from dohyo.agents.learning.files.card import digest, read_card
from dohyo.agents.studies.arms import TRAININGS, Cell
from dohyo.agents.studies.rows import cell_of, read_rows
from tests.agents.forecasting.roads import write_folder


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Lab:
    folder = tmp_path_factory.mktemp("study")
    data = read_data(write_folder(folder / "data", days=3, rows=40, segments=4))
    return Lab(data, folder / "models", steps=2)


def test_a_trained_forecaster_is_not_trained_again(small: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    first = list(small.measures(small.forecaster(Variant("lstm"), 0), "hard"))
    assert len(first) == 2
    assert {"mse_1", "mse_2", "mse_3"} <= set(first[0])
    monkeypatch.setattr(Lab, "_trained", lambda *_: pytest.fail("trained again"))
    assert list(small.measures(small.forecaster(Variant("lstm"), 0), "hard")) == first


def test_a_forecaster_of_other_data_is_trained_again(small: Lab, tmp_path: Path) -> None:
    small.forecaster(Variant("linear"), 0)
    data = read_data(write_folder(tmp_path / "data", days=4, rows=40, segments=4))
    other = Lab(data, small.folder, steps=2)
    again = other.forecaster(Variant("linear"), 0)
    rows = np.random.default_rng(0).uniform(5, 30, (8, 4))
    fresh = make_forecaster("linear", 4)
    fresh.fit(other.windows["train"], other.windows["validation"])
    np.testing.assert_allclose(again.predict(rows), fresh.predict(rows), rtol=1e-6)


def test_the_n_step_starts_from_the_one_step_of_its_seed(small: Lab) -> None:
    one = Variant("sa-lstm", 3)
    small.forecaster(one, 0)
    forecaster = make_forecaster("sa-lstm-n-step", 4)
    first = load_forecaster(small.folder / f"{one.arm}-0.safetensors")
    assert isinstance(forecaster, Learned)
    start_from(forecaster, first)
    rows = np.random.default_rng(0).uniform(5, 30, (8, 4))
    np.testing.assert_allclose(forecaster.predict(rows)[0], first.predict(rows)[0], rtol=1e-5)


def test_it_keeps_how_many_steps_each_phase_took(small: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fresh = Lab(small.data, tmp_path, steps=40)
    monkeypatch.setattr(training, "validation_error", lambda *_: 1.0)  # nothing is ever better than at first
    for variant in (Variant("linear"), Variant("sa-lstm", 3), Variant("sa-lstm-n-step", 3)):
        fresh.forecaster(variant, 0)
    kept = {path.stem: json.loads(path.read_text())["steps"] for path in tmp_path.glob("*.training.json")}
    assert kept["linear-0.training"] == []
    assert kept["sa-lstm-lap3-0.training"] == [40]
    assert kept["sa-lstm-n-step-lap3-0.training"] == [40] * (PHASES - 1)
    long = Lab(small.data, tmp_path / "long", steps=800)
    long.forecaster(Variant("lstm"), 0)
    (facts,) = long.folder.glob("*.training.json")
    assert json.loads(facts.read_text())["steps"] == [225], "three falls of the rate, each after three validations"


@pytest.mark.parametrize("arm", ["sa-lstm-quantiles", "sa-lstm-n-step-lap3", "lstm-mse"])
def test_a_job_names_all_trainings_that_it_begins(arm: str, small: Lab, tmp_path: Path) -> None:
    """Jobs with a common training run one after the other."""
    fresh = Lab(small.data, tmp_path, steps=1)
    fresh.forecaster(study.ARMS[arm], 1)
    begun = {path.stem for path in tmp_path.glob("*.safetensors")}
    assert set(study.STUDY.trainings(Cell(arm, 1, "easy", "00", None))) == begun


def test_what_ships_is_what_was_trained_with_a_card(
    small: Lab, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lab, "SHIPPED", {"sa-lstm": "sa-lstm-lap3-balanced", "linear": "linear"})
    monkeypatch.setattr("sys.argv", ["/home/me/dohyo/dohyo/agents/studies/__main__.py", "forecasting", "run"])
    small.forecaster(Variant("sa-lstm", 3, 0.001), 2)
    small.forecaster(Variant("linear"), 2)
    lab.ship(small.folder, 2, tmp_path)
    network, simple = (read_card(tmp_path / f"{name}.safetensors") for name in ("sa-lstm", "linear"))
    assert set(network.files) == {"sa-lstm.safetensors", "sa-lstm.onnx"}
    assert (tmp_path / "sa-lstm.safetensors").read_bytes() == (
        small.folder / "sa-lstm-lap3-balanced-2.safetensors"
    ).read_bytes()
    assert not isinstance(network.config, str)
    assert (network.config["depth"], network.config["weight"], network.config["steps"]) == (3, 0.001, 2)
    assert network.command == simple.command == "python -m dohyo.agents.studies forecasting run"
    assert network.data_sha256 == simple.data_sha256 == digest(Path(small.data.source))
    assert (network.seed, network.trainer) == (2, lab.TRAINER)
    assert (simple.seed, simple.trainer, simple.config) == (None, None, {})
    assert find_spec(lab.TRAINER) is not None


def test_every_arm_of_the_claims_and_of_the_package_is_run() -> None:
    claimed = {arm for claim in tables.directions() for arm in (claim.left, claim.right)}
    assert claimed | set(SHIPPED.values()) <= set(study.ARMS)


def test_a_run_has_a_row_per_arm_seed_and_day(tmp_path: Path) -> None:
    data = write_folder(tmp_path / "data", days=3, rows=40, segments=4)
    options = study.Options(data=data, steps=2, models=tmp_path / "models")
    cells = study.cells(options)
    days = {(cell.benchmark, cell.scenario) for cell in cells}
    assert len(cells) == len(days) * (len(SIMPLE) + 3 * (len(study.ARMS) - len(SIMPLE)))
    for arm, seed in (("persistence", None), ("sa-lstm-lap3", 1)):
        rows = list(study.work(options, [cell for cell in cells if (cell.arm, cell.training_seed) == (arm, seed)]))
        assert {(row["benchmark"], row["scenario"]) for row in rows} == days
        assert all(row["mse_3"] > 0.0 for row in rows)


def test_the_stored_rows_are_of_every_arm_and_seed() -> None:
    stored = {cell_of(row)[:2] for row in read_rows(study.STUDY.stored)}
    wanted = {(arm, None) for arm in SIMPLE}
    wanted |= {(arm, seed) for arm in study.ARMS if arm not in SIMPLE for seed in TRAININGS}
    assert stored == wanted
