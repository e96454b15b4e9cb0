"""Training of a network by phases: modules that a phase does not name stay unchanged."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dohyo.agents.forecasting.base import Progress
from dohyo.agents.forecasting.data.scale import Scale
from dohyo.agents.forecasting.data.windows import Windows
from dohyo.agents.forecasting.networks.looking_ahead import Phase, SpeedNetwork
from dohyo.agents.forecasting.pyramid import MAX_DEPTH, LaplacianLoss
from dohyo.agents.learning.runs.supervised import Fit, Rate, fit
from dohyo.sumo_networks.errors import InvalidInputError

PATIENCE, DECAY, LAST_RATE = 3, 0.1, 2e-5
COOLING = 0.8
"""Share of the steps after which the rate is at most a tenth of the first."""
FINE_TUNING = 0.1
"""Factor of the learning rate in a fine-tuning phase."""
VALIDATED = 4096
"""Windows at most."""


@dataclass(frozen=True, slots=True)
class TrainSettings:
    """Settings of a training.

    Attributes:
        depth: Of the Laplacian pyramid's loss, beside the squared error; None: without it.
        weight: Of that loss; 1 as printed in the thesis, where it outweighs the squared error a thousand times.
        rate: Of AdamW; a tenth after three validations in a row without a new best.
        batch: Windows per step; 0, or as many as there are: all of them, each step; None: see `batch_for`.
        steps: Upper bound in each phase.
        validate_every: Steps.
        clip: Largest norm of a gradient.
        seed: Of all randomness.
    """

    depth: int | None = 3
    weight: float = 1.0
    rate: float = 0.01
    batch: int | None = None
    steps: int = 600
    validate_every: int = 25
    clip: float = 1.0
    seed: int = 0

    def __post_init__(self) -> None:
        """Refuses impossible settings.

        Raises:
            InvalidInputError: A number is out of its range.
        """
        if self.depth is not None and not 0 <= self.depth <= MAX_DEPTH:
            raise InvalidInputError(f"expected a pyramid's depth of 0 to {MAX_DEPTH}, or none, got {self.depth}")
        if self.rate <= 0.0 or self.steps < 1 or self.validate_every < 1 or (self.batch or 0) < 0:
            raise InvalidInputError(f"expected a rate and steps above 0 and a batch of 0 or more, got {self}")


def batch_for(segments: int) -> int:
    """256 windows of 21 segments, fewer of wider roads, so that a step costs about the same; at least 32."""
    return max(32, min(256, 256 * 21 // segments))


class Examples:
    """Windows as tensors, standardised; a missing target has mask 0.

    Attributes:
        unit: From a standardised difference to one of normalised speeds, in which losses are.
        history: (B, s, N).
        target: (B, 3, N), 0 where missing.
        mask: (B, 3, N) 1 where there is a target.
    """

    def __init__(self, windows: Windows, scale: Scale, free_mps: float) -> None:
        self.unit = scale.spread_mps / free_mps
        self.history, target = scale.standard(windows.history), scale.standard(windows.target)
        self.mask = target.isfinite().to(target.dtype)
        self.target = target.nan_to_num()

    def __len__(self) -> int:
        return len(self.history)

    def difference(self, network: SpeedNetwork, phase: Phase, which: Tensor | slice) -> tuple[Tensor, Tensor]:
        """Forecast minus target (B, rows, N), normalised, 0 where the target is missing; and the mask."""
        rows = list(phase.rows)
        ahead = network.ahead(self.history[which], rows[-1] + 1)[:, rows]
        mask = self.mask[which][:, rows]
        return (ahead - self.target[which][:, rows]) * mask * self.unit, mask


def train_network(
    network: SpeedNetwork,
    train: Windows,
    validation: Windows,
    scale: Scale,
    free_mps: float,
    settings: TrainSettings,
    progress: Progress | None = None,
    first: int = 0,
) -> None:
    """Trains all phases from the first on; each ends with its best weights on the validation windows."""
    torch.manual_seed(settings.seed)
    few = np.linspace(0, len(validation) - 1, min(len(validation), VALIDATED)).astype(np.int64)
    examples, held_out = (Examples(some, scale, free_mps) for some in (train, validation.chosen(few)))
    phases = network.phases()
    for number, phase in enumerate(phases):
        if number < first:
            continue
        done = number * settings.steps

        def tell(step: int, error: float, done: int = done) -> None:
            if progress:
                progress(done + step, len(phases) * settings.steps, error)

        rate = settings.rate * (FINE_TUNING if number and phase.trained == [network] else 1.0)
        _train_phase(network, phase, examples, held_out, settings, rate, tell)
    network.requires_grad_(True)
    network.eval()


def _train_phase(
    network: SpeedNetwork,
    phase: Phase,
    examples: Examples,
    held_out: Examples,
    settings: TrainSettings,
    rate: float,
    tell: Callable[[int, float], None],
) -> None:
    network.requires_grad_(False)
    free = [parameter for module in phase.trained for parameter in module.parameters()]
    for parameter in free:
        parameter.requires_grad_(True)
    segments = examples.history.shape[2]
    batch = batch_for(segments) if settings.batch is None else settings.batch
    laplacian = None if settings.depth is None else LaplacianLoss(segments, settings.depth)
    job = Fit(
        network=network,
        optimizer=torch.optim.AdamW(free, lr=rate),
        losses=lambda rows: {"loss": _loss(network, phase, examples, laplacian, settings.weight, rows)},
        batches=lambda first: _batches(len(examples), batch, settings.seed),
        rate=Plateau(rate, rate * DECAY, int(COOLING * settings.steps)),
        steps=settings.steps,
        validate=lambda: {"error": validation_error(network, phase, held_out)},
        validate_every=settings.validate_every,
        gradient_norm=settings.clip,
        keeps_best=True,
    )
    fit(job, progress=lambda step, row: tell(step, row["error"]) if "error" in row else None)


@dataclass(slots=True)
class Plateau(Rate):
    """A tenth of the rate after three validations in a row without a new best; after the cooling step in any case.

    Attributes:
        rate: Present one.
        lowered: Upper bound after the cooling step.
        cooling: That step.
        stale: Validations without a new best.
        over: Whether the rate has become too low to go on.
    """

    rate: float
    lowered: float
    cooling: int
    stale: int = 0
    over: bool = False

    def at(self, step: int) -> float | None:
        """See `Rate`."""
        self._cool(step)
        return None if self.over else self.rate

    def validated(self, step: int, better: bool) -> None:
        """See `Rate`."""
        self._cool(step)
        self.stale = 0 if better else self.stale + 1
        if self.stale == PATIENCE:
            self.rate, self.stale = self.rate * DECAY, 0
            self.over = self.rate < LAST_RATE

    def state(self) -> dict[str, Any]:
        """See `Rate`."""
        return asdict(self)

    def restore(self, state: Mapping[str, Any]) -> None:
        """See `Rate`."""
        for name, value in state.items():
            setattr(self, name, value)

    def _cool(self, step: int) -> None:
        if step == self.cooling:
            self.rate, self.stale, self.cooling = min(self.rate, self.lowered), 0, -1


def _batches(size: int, batch: int, seed: int) -> Iterator[Tensor]:
    """Rows drawn with replacement; all rows if the batch is 0, or as large."""
    generator = torch.Generator().manual_seed(seed)
    whole = batch == 0 or batch >= size
    while True:
        yield torch.arange(size) if whole else torch.randint(size, (batch,), generator=generator)


def _loss(
    network: SpeedNetwork,
    phase: Phase,
    examples: Examples,
    laplacian: LaplacianLoss | None,
    weight: float,
    rows: Tensor,
) -> Tensor:
    """The squared error where there is a target, and the Laplacian loss."""
    difference, mask = examples.difference(network, phase, rows)
    loss = difference.square().sum() / mask.sum().clamp_min(1.0)
    return loss if laplacian is None else loss + weight * laplacian(difference)


@torch.no_grad()
def validation_error(network: SpeedNetwork, phase: Phase, held_out: Examples) -> float:
    """Mean squared error of a phase's rows, x 10^3."""
    difference, mask = held_out.difference(network, phase, slice(None))
    return 1e3 * float(difference.square().sum() / mask.sum().clamp_min(1.0))
