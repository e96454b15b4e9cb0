"""Lab: trains the arms of the study, and measures them day by day; trained forecasters stay in a folder.

    python -m dohyo.agents.forecasting.study.lab out/forecasting 0

copies the shipped forecasters of one seed from that folder into `checkpoints/`, with cards, and networks also as ONNX.
"""

from __future__ import annotations

import hashlib
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from dohyo.agents.forecasting.base import Forecaster, read_file
from dohyo.agents.forecasting.data.speed_table import SpeedData
from dohyo.agents.forecasting.data.windows import HORIZON, Windows, make_windows
from dohyo.agents.forecasting.files.fitting import check_fits
from dohyo.agents.forecasting.learned import Learned
from dohyo.agents.forecasting.live.tracking import tracked
from dohyo.agents.forecasting.networks.looking_ahead import NStep, Recursive
from dohyo.agents.forecasting.quantiles import Quantiles
from dohyo.agents.forecasting.registry import CHECKPOINTS, load_forecaster, make_forecaster
from dohyo.agents.forecasting.scores import coverage, errors, frontier_scores, frontiers_ahead
from dohyo.agents.forecasting.study.arms import Variant
from dohyo.agents.forecasting.training import TrainSettings, train_network
from dohyo.agents.learning.files.card import UNKNOWN, Card, digest, weights_of, write_card
from dohyo.agents.learning.files.command import typed
from dohyo.agents.learning.files.surroundings import surroundings
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.files import write_atomically

SHIPPED = {"sa-lstm": "sa-lstm-lap3-balanced", "sa-lstm-n-step": "sa-lstm-n-step-lap3-balanced"}
SHIPPED |= {name: name for name in ("linear", "historical-mean", "sa-lstm-quantiles")} | {"tsmixer": "tsmixer-mse"}
TRAINER: Final = "dohyo.agents.forecasting.study.lab"


class Lab:
    """The data in windows, and a folder of trained forecasters.

    Attributes:
        data: To learn from.
        folder: Folder of the forecasters.
        steps: Of each phase of a training.
        windows: Windows of each set.
        free_mps: Speed with the normalised value 1.
    """

    def __init__(self, data: SpeedData, folder: Path, steps: int) -> None:
        self.data, self.folder, self.steps = data, folder, steps
        self.windows = {name: make_windows(some, data.step_s) for name, some in data.sets.items()}
        self.free_mps = float(np.quantile(self.windows["train"].history, 0.999))
        self._learned_from = self._fingerprint()
        folder.mkdir(parents=True, exist_ok=True)

    def _fingerprint(self) -> str:
        """Fingerprint of the windows to learn from, and of the length of the training."""
        some = [self.windows[name] for name in ("train", "validation")]
        shapes = [list(one.history.shape) for one in some]
        sums = [float(np.nansum(one.target, dtype=np.float64)) for one in some]
        return hashlib.sha256(json.dumps([shapes, sums, self.steps]).encode()).hexdigest()[:12]

    @cached_property
    def _data_digest(self) -> str:
        source = Path(self.data.source)
        return digest(source) if source.exists() else UNKNOWN

    @property
    def seconds(self) -> float:
        """Processor time of all trainings, s."""
        return math.fsum(json.loads(path.read_text())["seconds"] for path in self.folder.glob("*.training.json"))

    def forecaster(self, variant: Variant, seed: int) -> Forecaster:
        """The forecaster of an arm and seed, from its file or from a training."""
        if variant.shipped:
            forecaster = load_forecaster(variant.name)
            check_fits(forecaster, len(self.data.segments), self.data.step_s, variant.name, self.data.source)
            return forecaster
        path = self.folder / f"{variant.arm}-{seed}.safetensors"
        facts = path.with_suffix(".training.json")
        if facts.exists() and json.loads(facts.read_text())["of"] == self._learned_from:
            return load_forecaster(path)
        began = time.process_time()
        forecaster, steps = self._trained(variant, seed)
        seconds = round(time.process_time() - began, 1)
        forecaster.save(path)
        origin = {"of": self._learned_from, "seconds": seconds, "steps": steps, "data_sha256": self._data_digest}
        write_atomically(facts, json.dumps(origin | _session()).encode())
        return forecaster

    def measures(self, forecaster: Forecaster, name: str) -> Iterator[dict[str, float]]:
        """Measures of each day of a set; those of the t-th row ahead end in _t.

        A day without a frontier of congestion has no scores of frontiers.
        """
        windows = self.windows[name]
        got = errors(forecaster, windows, self.free_mps)
        tables = {"mse": got.normalised}
        if got.squared_true is not None:
            tables["mse_true"] = 1e3 * got.squared_true / self.free_mps**2
        if isinstance(forecaster, Quantiles):
            tables |= _intervals(forecaster, windows)
        tables |= frontier_scores(frontiers_ahead(forecaster, windows, self.free_mps), windows, self.free_mps)
        for day in range(len(got.normalised)):
            yield {
                f"{measure}_{row + 1}": round(float(table[day, row]), 4)
                for measure, table in tables.items()
                for row in range(HORIZON)
                if np.isfinite(table[day, row])
            }

    def _trained(self, variant: Variant, seed: int) -> tuple[Forecaster, list[int]]:
        """Trains one, and counts the steps of each phase, which patience may end early.

        The n-step starts from the one-step of its seed, intervals from the n-step.
        """
        settings = TrainSettings(depth=variant.depth, weight=variant.weight, steps=self.steps, seed=seed)
        # Patience counts validations: their interval grows with the arm's length, and not with the study's steps.
        settings = replace(
            settings, steps=variant.length * settings.steps, validate_every=variant.length * settings.validate_every
        )
        forecaster = make_forecaster(variant.name, len(self.data.segments), self.data.step_s, settings)
        train, validation = self.windows["train"], self.windows["validation"]
        first = self.forecaster(variant.first, seed) if variant.first else None
        taken: dict[int, int] = {}

        def count(done: int, _of: int, _error: float) -> None:
            before = (done - 1) // settings.steps
            taken[before] = done - before * settings.steps

        if isinstance(forecaster, Learned) and isinstance(forecaster.network, NStep):
            assert first is not None
            start_from(forecaster, first)
            scale = forecaster.scale
            train_network(forecaster.network, train, validation, scale, forecaster.free_mps, settings, count, first=1)
        elif isinstance(forecaster, Quantiles):
            assert isinstance(first, Learned)
            forecaster.network.middle.load_state_dict(first.network.state_dict())
            forecaster.scale, forecaster.free_mps = first.scale, first.free_mps
            forecaster.learn_ends(train, validation)
        else:
            forecaster.fit(train, validation, count)
        return forecaster, list(taken.values())


def _intervals(forecaster: Quantiles, windows: Windows) -> dict[str, FloatArray]:
    """(S, 3) share of values inside, %, and width, km/h: as calibrated, and tracked anew from each day's first."""
    calibrated = forecaster.intervals_many(windows.history)
    moving = np.empty_like(calibrated)
    for day in np.unique(windows.stretch):
        which = np.flatnonzero(windows.stretch == day)
        moving[which] = tracked(calibrated[which], windows.chosen(which))
    out: dict[str, FloatArray] = {}
    for suffix, ends in (("", calibrated), ("_tracked", moving)):
        inside, width = coverage(ends, windows)
        out |= {f"coverage{suffix}": 100.0 * inside, f"width_kmh{suffix}": 3.6 * width}
    return out


def start_from(forecaster: Learned, first: Forecaster) -> None:
    """Copies a trained one-step network into the first layer and the head, the result of the first phase."""
    assert isinstance(first, Learned)
    assert isinstance(forecaster.network, NStep)
    assert isinstance(first.network, Recursive)
    forecaster.network.layers[0].load_state_dict(first.network.trunk.state_dict())
    forecaster.network.head.load_state_dict(first.network.head.state_dict())
    forecaster.scale, forecaster.free_mps = first.scale, first.free_mps


def _session() -> dict[str, Any]:
    """Command and commit of this process, as cards have them."""
    told = surroundings()
    commit = told["commit"]
    return {
        "command": typed(told["command"]),
        "commits": [commit] if commit else UNKNOWN,
        "uncommitted": told["uncommitted"] if commit else UNKNOWN,
    }


def ship(folder: Path, seed: int, checkpoints: Path = CHECKPOINTS) -> None:
    """Copies the forecasters of one seed into the package, networks also as ONNX, and writes their cards."""
    for name, arm in SHIPPED.items():
        trained = folder / f"{arm}-{seed}.safetensors"
        forecaster = load_forecaster(trained)
        # A copy of the bytes: what is loaded and saved again has lost its settings.
        write_atomically(checkpoints / f"{name}.safetensors", trained.read_bytes())
        if isinstance(forecaster, Learned | Quantiles):
            forecaster.export(checkpoints / f"{name}.onnx")
        origin = json.loads(trained.with_suffix(".training.json").read_text())
        settings = json.loads(read_file(trained)[0].get("settings", "{}"))
        write_card(checkpoints, name, _card(checkpoints, name, settings, origin))


def _card(checkpoints: Path, name: str, settings: Mapping[str, Any], origin: Mapping[str, Any]) -> Card:
    """Card of a shipped forecaster; simple ones have no settings, no seed and no steps."""
    return Card(
        files=weights_of(checkpoints, name),
        subject=f"forecaster {name}",
        trainer=TRAINER if settings else None,
        config=dict(settings),
        seed=settings.get("seed"),
        steps=UNKNOWN if settings else None,
        device="cpu",
        tier=2,
        metrics=UNKNOWN,
        note="Measured by the study: RESULTS.md. The thesis has 350 days.",
        **{fact: origin.get(fact, UNKNOWN) for fact in ("command", "commits", "uncommitted", "data_sha256")},
    )


if __name__ == "__main__":
    ship(Path(sys.argv[1]), int(sys.argv[2]))
