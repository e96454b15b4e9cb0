"""Criteria, one file each: every criterion watches one ego for one kind of infraction in one episode.

A class derived from `Criterion` in a module of this folder is found automatically. To add one, write its file and the
specification of its kind.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from dohyo.evaluation.criteria.base import Criterion
from dohyo.evaluation.records.specifications import InfractionKind
from dohyo.sumo_networks.scenario import Scenario

__all__ = ["Criterion", "criteria_for", "criterion_types"]


def criteria_for(scenario: Scenario) -> tuple[Criterion, ...]:
    """New instances of all criteria, for one ego of a scenario."""
    return tuple(criterion.for_scenario(scenario) for criterion in criterion_types())


@cache
def criterion_types() -> tuple[type[Criterion], ...]:
    """Every criterion of this folder, in the order of the kinds that they detect."""
    modules = [import_module(f"{__name__}.{found.name}") for found in iter_modules(__path__)]
    defined = {one for module in modules for one in vars(module).values() if _is_criterion(one)}
    order = list(InfractionKind)
    return tuple(sorted(defined, key=lambda criterion: order.index(criterion.kinds[0])))


def _is_criterion(one: object) -> bool:
    return isinstance(one, type) and issubclass(one, Criterion) and one is not Criterion
