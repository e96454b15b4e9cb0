"""Settings of trainings: what a subclass gives another default keeps its bounds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import pytest
from pydantic import TypeAdapter, ValidationError
from pydantic.fields import FieldInfo

from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.rlad.training import RladRunConfig
from dohyo.agents.trainers import TRAINERS, trainer_named
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError

NUMBERS = (-(2**31), -5, -1, -1e-9, 0, 1e-9, 1e-3, 0.5, 0.999, 1, 1.5, 2, 5, 64, 65, 1000, 1001, 10**9, 2**31)
OTHERS: tuple[Any, ...] = ("", "a", "mean", "return", True, False, None, [], [0], [1], [-1], [[0, 4]], {})


def redefined() -> Iterator[tuple[type[Config], type[Config], str]]:
    """Class of settings, one of its bases, and the name of a field that both of them define."""
    for trainer in TRAINERS:
        trainer_named(trainer)  # imports its settings
    for kind in (one for one in _below(Config) if one.__module__.startswith("dohyo.")):
        for name in kind.__annotations__:
            for base in kind.__mro__[1:]:
                if issubclass(base, Config) and name in base.model_fields and name in kind.model_fields:
                    yield kind, base, name


def _below(kind: type[Config]) -> Iterator[type[Config]]:
    for one in kind.__subclasses__():
        yield one
        yield from _below(one)


def takes(field: FieldInfo, value: object) -> bool:
    try:
        TypeAdapter(Annotated[field.annotation, *field.metadata, None]).validate_python(value)
    except ValidationError:
        return False
    return True


def test_no_subclass_takes_values_that_its_base_refuses():
    found = list(redefined())
    assert len({(kind, name) for kind, _, name in found}) > 50
    for kind, base, name in found:
        own, inherited = kind.model_fields[name], base.model_fields[name]
        wider = [one for one in (*NUMBERS, *OTHERS) if takes(own, one) and not takes(inherited, one)]
        assert not wider, f"{kind.__module__}.{kind.__name__}.{name} takes {wider}, {base.__name__} does not"


@pytest.mark.parametrize("setting", ["tau=5", "learning_rate=-1", "initial_alpha=0", "learning_starts=-5"])
def test_rlad_refuses_what_sac_refuses(setting):
    with pytest.raises(InvalidInputError, match=f"sac.{setting.partition('=')[0]}"):
        read_settings(RladRunConfig, None, [f"sac.{setting}"])
