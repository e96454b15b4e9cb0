"""Study: the thesis's tables 6.1 to 6.4 on our freeway, with baselines, seeds and intervals.

    python -m dohyo.agents.forecasting.study --data DIR --steps 200 --seeds 0 1 2 --out out/forecasting --results

Each run is one forecaster, loss and seed. The same command resumes: finished runs are kept. `--results` stores the
results and writes the tables into RESULTS.md, `--ship` copies the first seed's forecasters into `checkpoints/`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from dohyo.agents.forecasting.base import Forecaster
from dohyo.agents.forecasting.data import SpeedData
from dohyo.agents.forecasting.latency import of_network
from dohyo.agents.forecasting.learned import Learned
from dohyo.agents.forecasting.networks.looking_ahead import NStep, Recursive
from dohyo.agents.forecasting.quantiles import Quantiles
from dohyo.agents.forecasting.reading import read_data
from dohyo.agents.forecasting.registry import CHECKPOINTS, SIMPLE, load_forecaster, make_forecaster
from dohyo.agents.forecasting.scores import coverage, errors
from dohyo.agents.forecasting.training import TrainSettings, train_network
from dohyo.agents.forecasting.windows import Windows, make_windows
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

COMPARED = ("lstm", "sa-lstm", "transformer", "convlstm", "sa-convlstm")
DEPTH, DEPTHS = 3, (0, 1, 2, 3, 4)
BALANCED = 0.001
"""Weight of the Laplacian loss that makes it as large as the squared error."""
SHIPPED = {"sa-lstm": "sa-lstm-lap3-balanced", "sa-lstm-n-step": "sa-lstm-n-step-lap3-balanced"}
SHIPPED |= {name: name for name in ("linear", "historical-mean", "sa-lstm-quantiles")} | {"tsmixer": "tsmixer-mse"}
LATENCY = (*((name, 1) for name in COMPARED), *((f"sa-lstm{way}", 3) for way in ("", "-all-at-once", "-n-step")))
QUICK_RUNS = 2000
LONG = 10
"""Factor of the steps in the long runs, which show whether the Laplacian loss needs longer training."""


@dataclass(frozen=True, slots=True)
class Run:
    """One training.

    Attributes:
        name: Of the forecaster.
        depth: Of the Laplacian loss; None: squared error alone.
        weight: Of that loss.
        seed: Of the training.
        length: Factor of the study's steps.
    """

    name: str
    depth: int | None
    weight: float
    seed: int
    length: int = 1

    @property
    def arm(self) -> str:
        """Name shared by all seeds."""
        if self.name in SIMPLE or self.name == Quantiles.name:
            return self.name
        loss = "mse" if self.depth is None else f"lap{self.depth}"
        return (
            f"{self.name}-{loss}" + ("" if self.weight == 1.0 else "-balanced") + ("-long" if self.length > 1 else "")
        )


def runs(seeds: Sequence[int]) -> Iterator[Run]:
    """All runs, in the order of their dependencies; all seeds of a part before the next part."""
    for name in SIMPLE:
        yield Run(name, None, 1.0, seeds[0])
    for part in (_main_arms, _other_networks, _costly_arms):
        for seed in seeds:
            yield from (Run(name, depth, weight, seed) for name, depth, weight in part())
    for seed in seeds:
        yield from (Run("sa-lstm", depth, 1.0, seed, LONG) for depth in (None, DEPTH))


def _main_arms() -> Iterator[tuple[str, int | None, float]]:
    """SA-LSTM against LSTM, with and without Lap3, and the ways to look ahead."""
    for name in ("sa-lstm", "sa-lstm-n-step", "sa-lstm-all-at-once", Quantiles.name):
        yield name, DEPTH, BALANCED
    for name in ("tsmixer", "lstm", "sa-lstm"):
        yield name, None, 1.0
        yield name, DEPTH, 1.0


def _other_networks() -> Iterator[tuple[str, int | None, float]]:
    """Transformer and ConvLSTM, the other depths, and all-at-once with the loss as printed."""
    for name in ("transformer", "convlstm"):
        yield name, None, 1.0
        yield name, DEPTH, 1.0
    for depth in DEPTHS:
        if depth != DEPTH:
            yield "sa-lstm", depth, 1.0
    yield "sa-lstm-all-at-once", DEPTH, 1.0


def _costly_arms() -> Iterator[tuple[str, int | None, float]]:
    """Arms that take half of the time."""
    yield "sa-convlstm", None, 1.0
    yield "sa-convlstm", DEPTH, 1.0
    yield "sa-lstm-n-step", DEPTH, 1.0


class Study:
    """The data in windows, and a folder in which finished runs stay.

    Attributes:
        data: To learn from.
        out: The folder.
        steps: Of each phase of a training.
    """

    def __init__(self, data: SpeedData, out: Path, steps: int) -> None:
        self.data, self.out, self.steps = data, out, steps
        self.windows = {name: make_windows(some, data.step_s) for name, some in data.sets.items()}
        self.free_mps = float(np.quantile(self.windows["train"].history, 0.999))
        self.learned_from = self._fingerprint("train", "validation")
        (out / "runs").mkdir(parents=True, exist_ok=True)

    def _fingerprint(self, *sets: str) -> str:
        """Fingerprint of the windows of some sets, and of the length of the training."""
        shapes = [list(self.windows[name].history.shape) for name in sets]
        sums = [float(np.nansum(self.windows[name].target, dtype=np.float64)) for name in sets]
        return hashlib.sha256(json.dumps([shapes, sums, self.steps]).encode()).hexdigest()[:12]

    def is_trained(self, run: Run) -> bool:
        """Whether the forecaster of one run is stored, and of this data."""
        facts = self.out / "runs" / f"{run.arm}-{run.seed}.training.json"
        return facts.exists() and json.loads(facts.read_text())["of"] == self.learned_from

    def model(self, run: Run) -> Forecaster:
        """The forecaster of one run, from its file or from a training."""
        path, facts = self._path(run), self.out / "runs" / f"{run.arm}-{run.seed}.training.json"
        if self.is_trained(run):
            return load_forecaster(path)
        began = time.process_time()
        forecaster = self.trained(run)
        seconds = round(time.process_time() - began, 1)
        forecaster.save(path)
        write_atomically(facts, json.dumps({"of": self.learned_from, "seconds": seconds}).encode())
        print(f"{run.arm} seed {run.seed}: {seconds:.0f} s", flush=True)
        return forecaster

    def result(self, run: Run) -> dict[str, Any]:
        """The scores of one run, from its file or measured."""
        forecaster = self.model(run)
        path = self.out / "runs" / f"{run.arm}-{run.seed}.json"
        facts = json.loads(path.with_suffix(".training.json").read_text())
        of = [self.learned_from, self._fingerprint(*self.data.measured_sets)]
        if path.exists():
            kept: dict[str, Any] = json.loads(path.read_text())
            if kept["of"] == of:
                return kept
        document = {"of": of, "arm": run.arm, "seed": run.seed, "seconds": facts["seconds"]}
        document |= {"sets": {name: self._scores(forecaster, self.windows[name]) for name in self.data.measured_sets}}
        write_atomically(path, json.dumps(document).encode())
        return document

    def trained(self, run: Run) -> Forecaster:
        """Trains one; the n-step starts from the one-step of its seed, intervals from the n-step."""
        settings = TrainSettings(depth=run.depth, weight=run.weight, steps=self.steps, seed=run.seed)
        # Patience counts validations, so their interval grows with the length.
        settings = replace(
            settings, steps=run.length * settings.steps, validate_every=run.length * settings.validate_every
        )
        forecaster = make_forecaster(run.name, len(self.data.segments), self.data.step_s, settings)
        train, validation = self.windows["train"], self.windows["validation"]
        if isinstance(forecaster, Learned) and isinstance(forecaster.network, NStep):
            first = self.model(replace(run, name="sa-lstm"))
            start_from(forecaster, first)
            scale = forecaster.scale
            train_network(forecaster.network, train, validation, scale, forecaster.free_mps, settings, first=1)
        elif isinstance(forecaster, Quantiles):
            middle = self.model(replace(run, name="sa-lstm-n-step"))
            assert isinstance(middle, Learned)
            forecaster.network.middle.load_state_dict(middle.network.state_dict())
            forecaster.scale, forecaster.free_mps = middle.scale, middle.free_mps
            forecaster.learn_ends(train, validation)
        else:
            forecaster.fit(train, validation)
        return forecaster

    def _scores(self, forecaster: Forecaster, windows: Windows) -> dict[str, Any]:
        got = errors(forecaster, windows, self.free_mps)
        out = {
            "mse": _rounded(got.normalised),
            "rmse_kmh": _rounded(got.rmse("km/h")),
            "rmse_mph": _rounded(got.rmse("mph")),
        }
        if got.squared_true is not None:
            out["mse_true"] = _rounded(1e3 * got.squared_true / self.free_mps**2)
        if isinstance(forecaster, Quantiles):
            inside, width = coverage(forecaster.intervals_many(windows.history), windows)
            out |= {"coverage": _rounded(inside), "width_kmh": _rounded(3.6 * width)}
        return out

    def _path(self, run: Run) -> Path:
        return self.out / "models" / f"{run.arm}-{run.seed}.safetensors"


def start_from(forecaster: Learned, first: Forecaster) -> None:
    """Copies a trained one-step network into the first layer and the head, the result of the first phase."""
    assert isinstance(first, Learned)
    assert isinstance(forecaster.network, NStep)
    assert isinstance(first.network, Recursive)
    forecaster.network.layers[0].load_state_dict(first.network.trunk.state_dict())
    forecaster.network.head.load_state_dict(first.network.head.state_dict())
    forecaster.scale, forecaster.free_mps = first.scale, first.free_mps


def _rounded(values: np.ndarray) -> Any:
    return np.round(values, 4).tolist()


def study(data: SpeedData, seeds: Sequence[int], out: Path, steps: int, trained_only: bool = False) -> dict[str, Any]:
    """Runs what is missing, or with `trained_only` nothing more, and collects all results."""
    torch.set_num_threads(1)
    own = Study(data, out, steps)
    if not data.measured_sets:
        for run in runs(seeds):
            own.model(run)
        raise InvalidInputError(f"'{data.source}': expected test days in easy/ and hard/, got none")
    arms: dict[str, list[dict[str, Any]]] = {}
    for run in runs(seeds):
        if own.is_trained(run) or not trained_only:
            arms.setdefault(run.arm, []).append(own.result(run))
    segments = len(data.segments)
    measured = {(name, rows): of_network(name, segments, rows, QUICK_RUNS, 200) for name, rows in LATENCY}
    latency = {
        f"{name}, {rows}": {where: round(one.core_ms, 3) for where, one in by.items()}
        for (name, rows), by in measured.items()
    }
    windows = {name: len(some) for name, some in own.windows.items()}
    stretches = {name: len(some) for name, some in data.sets.items()}
    facts = {"seeds": list(seeds), "steps": steps, "free_kmh": round(3.6 * own.free_mps, 1), "segments": segments}
    result = facts | {"windows": windows, "stretches": stretches, "latency_ms": latency, "arms": arms}
    write_atomically(out / "results.json", json.dumps(result, indent=None).encode())
    return result


def ship(out: Path, seed: int) -> None:
    """Copies the forecasters of one seed into the package, networks also as ONNX."""
    for name, arm in SHIPPED.items():
        forecaster = load_forecaster(out / "models" / f"{arm}-{seed}.safetensors")
        forecaster.save(CHECKPOINTS / f"{name}.safetensors")
        if isinstance(forecaster, Learned | Quantiles):
            forecaster.export(CHECKPOINTS / f"{name}.onnx")


def main() -> None:
    """Command-line entry point."""
    from dohyo.agents.forecasting.tables import RESULTS, write_results

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--out", type=Path, default=Path("out/forecasting"))
    parser.add_argument("--steps", type=int, default=600, help="of each phase of a training")
    parser.add_argument("--trained-only", action="store_true", help="do not train missing runs")
    parser.add_argument("--results", action="store_true", help="store the results, and write RESULTS.md")
    parser.add_argument("--ship", action="store_true")
    arguments = parser.parse_args()
    data = read_data(arguments.data)
    result = study(data, arguments.seeds, arguments.out, arguments.steps, arguments.trained_only)
    if arguments.ship:
        ship(arguments.out, arguments.seeds[0])
    if arguments.results:
        RESULTS.parent.mkdir(exist_ok=True)
        write_atomically(RESULTS, (arguments.out / "results.json").read_bytes())
        write_results(result)


if __name__ == "__main__":
    main()
