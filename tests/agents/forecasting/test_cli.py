"""`dohyo forecast`, from outside."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from dohyo.service.cli import app
from dohyo.sumo_networks.errors import DohyoError
from tests.agents.forecasting.roads import jam_that_grows, road_speeds, write_csv, write_folder


def dohyo(*words: object) -> str:
    result = CliRunner().invoke(app, [str(word) for word in words])
    if isinstance(result.exception, DohyoError):
        raise result.exception
    assert result.exit_code == 0, result.output
    return result.output


def test_a_table_of_200_sensors_with_gaps_is_learned_and_evaluated(tmp_path: Path) -> None:
    speeds = np.concatenate([road_speeds(2000, 50, seed) for seed in range(4)], axis=1)
    speeds[np.random.default_rng(0).random(speeds.shape) < 0.05] = np.nan
    table = write_csv(tmp_path / "sensors.csv", speeds, 3.6)
    fit = ("forecast", "fit", "--data", table, "--unit", "km/h", "--model", "tsmixer", "--steps", 250, "--depth", -1)
    document = json.loads(dohyo(*fit, "--out", tmp_path / "f.safetensors", "--json"))
    assert document["segments"] == 200
    test = document["sets"]["test"]
    assert test["tsmixer"]["mse_x1000"][2] < test["persistence"]["mse_x1000"][2]
    np.testing.assert_allclose(test["tsmixer"]["inside_percent"], 90.0, atol=4.0)
    assert test["tsmixer"]["width_kmh"][2] < test["persistence"]["width_kmh"][2]
    assert {Path(one).suffix for one in document["written"]} == {".safetensors", ".onnx"}
    evaluate = ("forecast", "evaluate", "--data", table, "--unit", "km/h", "--json", "--model")
    for file in ("f.safetensors", "f.onnx"):
        again = json.loads(dohyo(*evaluate, tmp_path / file))["sets"]["test"]
        own = again.get("tsmixer", again.get("onnx"))
        np.testing.assert_allclose(own["rmse_kmh"], test["tsmixer"]["rmse_kmh"], rtol=1e-3)


def test_frontiers_of_a_moving_jam_are_foreseen_better_than_by_persistence(tmp_path: Path) -> None:
    speeds = np.concatenate([jam_that_grows(seed).speeds for seed in range(12)])
    table = write_csv(tmp_path / "sensors.csv", speeds, 3.6)
    fit = ("forecast", "fit", "--data", table, "--unit", "km/h", "--model", "frontiers", "--steps", 60)
    test = json.loads(dohyo(*fit, "--json"))["sets"]["test"]
    assert test["frontiers"]["frontier_f1"][2] > test["persistence"]["frontier_f1"][2] + 10.0
    told = dohyo("forecast", "evaluate", "--data", table, "--unit", "km/h", "--model", "persistence")
    assert "F1 in % at t+3 min" in told
    assert "inside the intervals of `forecast run` in test at t+3 min, of 90 %: " in " ".join(told.split())


def test_a_folder_is_evaluated_set_by_set(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "freeway", days=3, rows=40, segments=4)
    out = dohyo("forecast", "fit", "--data", folder, "--model", "linear", "--out", tmp_path / "f.safetensors")
    assert "easy" in out
    assert "hard" in out
    assert "late" in out
    document = json.loads(dohyo("forecast", "evaluate", "--data", folder, "--model", "persistence", "--json"))
    assert set(document["sets"]) == {"easy", "hard"}


def test_what_does_not_fit_is_one_clear_line(tmp_path: Path) -> None:
    table = write_csv(tmp_path / "t.csv", road_speeds(200, 3))
    with pytest.raises(DohyoError, match=r"expected --out to end in \.safetensors"):
        dohyo("forecast", "fit", "--data", table, "--model", "linear", "--out", tmp_path / "f.bin")
    with pytest.raises(DohyoError, match="no forecaster named 'arima'"):
        dohyo("forecast", "fit", "--data", table, "--model", "arima")
    dohyo("forecast", "fit", "--data", table, "--model", "linear", "--out", tmp_path / "f.safetensors")
    wider = write_csv(tmp_path / "w.csv", road_speeds(200, 4))
    with pytest.raises(DohyoError, match=r"forecasts 3 segments, .* has 4; train one on it"):
        dohyo("forecast", "evaluate", "--data", wider, "--model", tmp_path / "f.safetensors")


def test_a_model_has_the_same_errors_in_each_of_its_files(tmp_path: Path) -> None:
    """Its unit of speed is that of its training, also where the test part is slower."""
    speeds = road_speeds(1000, 3) * np.where(np.arange(1000) < 800, 1.0, 0.7)[:, None]
    table = write_csv(tmp_path / "t.csv", speeds)
    fit = ("forecast", "fit", "--data", table, "--model", "tsmixer", "--steps", 5, "--depth", -1)
    fitted = json.loads(dohyo(*fit, "--out", tmp_path / "f.safetensors", "--json"))["sets"]["test"]
    evaluate = ("forecast", "evaluate", "--data", table, "--model")
    onnx, alone = (
        json.loads(dohyo(*evaluate, model, "--json"))["sets"]["test"] for model in (tmp_path / "f.onnx", "persistence")
    )
    assert onnx["free_mps"] == fitted["free_mps"]
    np.testing.assert_allclose(onnx["onnx"]["mse_x1000"], fitted["tsmixer"]["mse_x1000"], rtol=1e-3)
    assert alone["persistence"]["mse_x1000"] == fitted["persistence"]["mse_x1000"]
    assert f"the speed 1 of MSE x 10^3 is {3.6 * fitted['free_mps']:.1f} km/h" in dohyo(*evaluate, "persistence")


def test_no_onnx_model_of_another_forecaster_stays_beside_a_new_one(tmp_path: Path) -> None:
    fit = ("forecast", "fit", "--data", write_csv(tmp_path / "t.csv", road_speeds(200, 3)), "--depth", -1)
    out = ("--out", tmp_path / "f.safetensors")
    dohyo(*fit, *out, "--model", "tsmixer", "--steps", 1)
    before = out[1].read_bytes()
    with pytest.raises(DohyoError, match=r"'linear' has no ONNX model, and '.*f\.onnx' is one of another forecaster"):
        dohyo(*fit, *out, "--model", "linear")
    assert out[1].read_bytes() == before
    dohyo(*fit, *out, "--model", "tsmixer", "--steps", 2)


def test_a_folder_of_mornings_alone_is_learned_from(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "freeway", days=3, rows=40, segments=4)
    (folder / "train").rename(folder / "mornings")
    fit = ("forecast", "fit", "--data", folder, "--model", "linear", "--json")
    with pytest.raises(DohyoError, match=r"expected days in '.*train', found no \*\.parquet; .*: --learn mornings"):
        dohyo(*fit)
    learned = json.loads(dohyo(*fit, "--learn", "mornings", "--out", tmp_path / "f.safetensors"))["sets"]
    evaluate = ("forecast", "evaluate", "--data", folder, "--model", tmp_path / "f.safetensors", "--json")
    assert json.loads(dohyo(*evaluate, "--learn", "mornings"))["sets"] == learned
    table = write_csv(tmp_path / "t.csv", road_speeds(200, 4))
    with pytest.raises(DohyoError, match="expected --learn with a folder of days"):
        dohyo("forecast", "fit", "--data", table, "--model", "linear", "--learn", "mornings")


@pytest.mark.parametrize("model", ["linear", "tsmixer"])
def test_a_model_knows_the_columns_of_its_table(tmp_path: Path, model: str) -> None:
    """Columns in another order are put in its own; others are refused."""
    speeds = road_speeds(400, 3)
    table = pl.DataFrame({"minute": np.arange(400)} | {name: speeds[:, i] for i, name in enumerate("abc")})
    for order in ("abc", "cab", "abd"):
        table.rename({"c": "d"} if "d" in order else {}).select("minute", *order).write_csv(tmp_path / f"{order}.csv")
    file = tmp_path / "f.safetensors"
    fit = ("forecast", "fit", "--data", tmp_path / "abc.csv", "--model", model, "--out", file, "--json")
    errors = json.loads(dohyo(*fit, "--steps", 5, "--depth", -1))["sets"]["test"][model]["rmse_kmh"]
    for one in (file, file.with_suffix(".onnx")) if model == "tsmixer" else (file,):
        words = ("--model", one, "--data")
        again = json.loads(dohyo("forecast", "evaluate", *words, tmp_path / "cab.csv", "--json"))
        (own,) = (of for name, of in again["sets"]["test"].items() if isinstance(of, dict) and name != "persistence")
        np.testing.assert_allclose(own["rmse_kmh"], errors, rtol=1e-4)
        assert "columns were put in the order of" in again["notes"][-1]
        now, other = (
            json.loads(dohyo("forecast", "run", *words, tmp_path / f"{order}.csv", "--json"))
            for order in ("abc", "cab")
        )
        assert now["segments"] == other["segments"] == ["a", "b", "c"]
        assert now["speed"] == other["speed"]
        for command in ("evaluate", "run"):
            with pytest.raises(DohyoError, match=r"was trained on 'c', .* has 'd' in its place \(1 of 3"):
                dohyo("forecast", command, *words, tmp_path / "abd.csv")


def test_another_name_of_a_file_is_told_and_no_reason_to_refuse(tmp_path: Path) -> None:
    speeds = road_speeds(400, 2)
    paths = [tmp_path / f"{name}.csv" for name in ("up", "down", "up-new")]
    for path, column in zip(paths, (0, 1, 0), strict=True):
        pl.DataFrame({"minute": np.arange(400), "speed": speeds[:, column]}).write_csv(path)
    file = tmp_path / "f.safetensors"
    dohyo("forecast", "fit", "--data", paths[0], "--data", paths[1], "--model", "linear", "--out", file)
    runs = {
        pair: json.loads(
            dohyo("forecast", "run", "--data", paths[pair[0]], "--data", paths[pair[1]], "--model", file, "--json")
        )
        for pair in ((0, 1), (1, 0), (2, 1))
    }
    assert runs[0, 1]["segments"] == runs[1, 0]["segments"] == ["up", "down"]
    assert runs[0, 1]["speed"] == runs[1, 0]["speed"] == runs[2, 1]["speed"]
    assert "was trained on 'up'" in runs[2, 1]["notes"][-1]
    assert "'up-new' in its place" in runs[2, 1]["notes"][-1]
    text = dohyo("forecast", "run", "--data", paths[2], "--data", paths[1], "--model", file)
    assert " ".join(text.split()).count("the same detectors in the same order?") == 1
