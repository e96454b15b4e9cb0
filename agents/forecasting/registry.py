"""Forecasters by name: untrained ones, and shipped ones."""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.forecasting.base import Forecaster, columns_of, read_file
from dohyo.agents.forecasting.data.scale import Scale
from dohyo.agents.forecasting.exported import Exported
from dohyo.agents.forecasting.frontiers import Frontiers
from dohyo.agents.forecasting.learned import Learned
from dohyo.agents.forecasting.networks.registry import NETWORKS
from dohyo.agents.forecasting.quantiles import Quantiles
from dohyo.agents.forecasting.simple import HistoricalMean, Linear, Persistence
from dohyo.agents.forecasting.training import TrainSettings
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError

CHECKPOINTS = Path(__file__).with_name("checkpoints")
SIMPLE = {kind.name: kind for kind in (Persistence, HistoricalMean, Linear)}
OWN = {kind.name: kind for kind in (Quantiles, Frontiers)}
"""Networks with a training of their own."""
NAMES = (*SIMPLE, *NETWORKS, *OWN)


def make_forecaster(
    name: str, segments: int, step_s: float = 60.0, settings: TrainSettings | None = None
) -> Forecaster:
    """Untrained forecaster.

    Args:
        name: Of `NAMES`.
        segments: N.
        step_s: Seconds between rows.
        settings: Of the training, if there is one.

    Raises:
        UnknownNameError: There is no such forecaster.
    """
    if name in SIMPLE:
        return SIMPLE[name](segments, step_s)
    if name in OWN:
        return OWN[name](segments, step_s, settings)
    if name not in NETWORKS:
        raise UnknownNameError("forecaster", name, NAMES)
    return Learned(name, segments, step_s, settings)


def shipped() -> tuple[str, ...]:
    """Names of shipped forecasters, trained for the road `freeway`."""
    return tuple(sorted(path.stem for path in CHECKPOINTS.glob("*.safetensors")))


def load_forecaster(name: str | Path, exported: bool = False) -> Forecaster:
    """Trained forecaster: the name of a shipped one, or the path of a .safetensors or .onnx file.

    Args:
        name: Of `shipped()`, or a path; an ONNX model takes its time step from the .safetensors file beside it, and
            has one of a minute without.
        exported: Use the shipped ONNX model, which is faster for a single history.

    Raises:
        InvalidInputError: There is no such file, or it holds no forecaster.
    """
    path = Path(name)
    if path.suffix not in (".safetensors", ".onnx"):
        if str(name) == Persistence.name:
            raise InvalidInputError("'persistence' is not trained: use make_forecaster('persistence', segments)")
        if str(name) not in shipped():
            raise UnknownNameError("trained forecaster", str(name), shipped())
        path = CHECKPOINTS / f"{name}{'.onnx' if exported else '.safetensors'}"
    if path.suffix == ".onnx":
        return _exported(path)
    facts, tensors = read_file(path)
    try:
        segments, step_s, free_mps = int(facts["segments"]), float(facts["step_s"]), float(facts["free_mps"])
        scale = Scale(float(facts.get("centre_mps", 0.0)), float(facts.get("spread_mps", 1.0)))
        columns = columns_of(facts)
    except (KeyError, ValueError) as error:
        raise InvalidInputError(f"forecaster '{path}' is damaged: {error}") from error
    forecaster = make_forecaster(facts["forecaster"], segments, step_s)
    forecaster.free_mps, forecaster.columns = free_mps, columns
    if isinstance(forecaster, Learned | Quantiles | Frontiers):
        forecaster.scale = scale
    forecaster.restore(tensors)
    return forecaster


def _exported(path: Path) -> Exported:
    """ONNX model with the time step of the file beside it."""
    exported, beside = Exported(path), path.with_suffix(".safetensors")
    if beside.is_file():
        exported.step_s = float(read_file(beside)[0].get("step_s", exported.step_s))
    return exported
