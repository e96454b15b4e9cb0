"""Arms of the forecasters' study: rows 10 to 12 of the thesis's comparisons, and baselines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product
from types import MappingProxyType

from dohyo.agents.forecasting.quantiles import Quantiles
from dohyo.agents.forecasting.registry import OWN, SIMPLE

COMPARED = ("lstm", "sa-lstm", "transformer", "convlstm", "sa-convlstm")
DEPTH, DEPTHS = 3, (0, 1, 2, 3, 4)
BALANCED = 0.001
"""Weight of the Laplacian loss that makes it as large as the squared error."""
LONG = 10
"""Factor of the steps in the long runs, which show whether the Laplacian loss needs longer training."""
PHASES = 4
"""Phases of the n-step's training, and so the factor that gives all others as many steps."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A forecaster with the loss and length of its training.

    Attributes:
        name: Of the forecaster.
        depth: Of the Laplacian loss; None: squared error alone.
        weight: Of that loss.
        length: Factor of the study's steps.
        shipped: Whether it is the one that ships, which learned from days in meso.
    """

    name: str
    depth: int | None = None
    weight: float = 1.0
    length: int = 1
    shipped: bool = False

    @property
    def is_trained(self) -> bool:
        """Whether the study trains it, once for each seed."""
        return self.name not in SIMPLE and not self.shipped

    @property
    def first(self) -> Variant | None:
        """The one whose weights its training begins with; None: it begins with random ones."""
        name = {"sa-lstm-n-step": "sa-lstm", Quantiles.name: "sa-lstm-n-step"}.get(self.name)
        return replace(self, name=name) if name and not self.shipped else None

    @property
    def arm(self) -> str:
        """Name of the arm."""
        if self.shipped:
            return f"{self.name}-shipped"
        if self.name in (*SIMPLE, *OWN):
            return self.name
        loss = "mse" if self.depth is None else f"lap{self.depth}"
        balanced, long = "-balanced" * (self.weight != 1.0), {1: "", LONG: "-long"}.get(self.length, f"-x{self.length}")
        return f"{self.name}-{loss}{balanced}{long}"


def _variants() -> Iterator[Variant]:
    """All arms: simple ones, ways to look ahead, other networks with both losses, depths, and long runs."""
    yield from (Variant(name) for name in SIMPLE)
    for name in ("sa-lstm", "sa-lstm-n-step", "sa-lstm-all-at-once", Quantiles.name):
        yield Variant(name, DEPTH, BALANCED)
    yield from (Variant(name, depth) for name, depth in product(("tsmixer", *COMPARED), (None, DEPTH)))
    yield from (Variant("sa-lstm", depth) for depth in DEPTHS if depth != DEPTH)
    yield from (Variant(name, DEPTH) for name in ("sa-lstm-all-at-once", "sa-lstm-n-step"))
    yield from (Variant("sa-lstm", depth, length=LONG) for depth in (None, DEPTH))


def _equal() -> Iterator[Variant]:
    """Arms with as many steps as the n-step's phases have together: networks with both losses, depths, and ways."""
    yield from (Variant(name) for name in SIMPLE)
    for name, depth in product(("tsmixer", *COMPARED), (None, DEPTH)):
        yield Variant(name, depth, length=PHASES)
    yield from (Variant("sa-lstm", depth, length=PHASES) for depth in DEPTHS if depth != DEPTH)
    for weight in (1.0, BALANCED):
        yield Variant("sa-lstm-all-at-once", DEPTH, weight, PHASES)
        yield Variant("sa-lstm-n-step", DEPTH, weight)
    yield Variant("sa-lstm", DEPTH, BALANCED, PHASES)
    yield Variant(Quantiles.name, DEPTH, BALANCED)
    yield from (Variant(name, shipped=True) for name in ("sa-lstm-n-step", Quantiles.name))


ARMS: Mapping[str, Variant] = MappingProxyType({one.arm: one for one in _variants()})
"""Arms that learn from whole days in meso."""
EQUAL: Mapping[str, Variant] = MappingProxyType({one.arm: one for one in _equal()})
"""Arms that learn from congested mornings in micro."""
