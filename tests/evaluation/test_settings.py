from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
from pydantic import Field

from dohyo.evaluation.settings import (
    FieldsOf,
    OneOf,
    Schema,
    SettingsError,
    check_against,
    check_settings,
    names_a_path,
    settings_schema,
)


@dataclass(frozen=True)
class Style:
    """Numbers.

    Attributes:
        gap: Distance to a standing leader,
            m.
    """

    gap: Annotated[float, Field(ge=0, le=50)] = 2.5


class Mine:
    """An agent of a user."""

    def __init__(
        self,
        steps: Annotated[int, Field(gt=0)] = 3,
        kind: Annotated[str, OneOf({"ekf": 1, "ukf": 2})] = "ekf",
        weights: str | Path | None = None,
        careful: bool = True,
        mode: Literal["a", "b"] = "a",
        anything: Any = None,
        **style: Annotated[float, FieldsOf(Style)],
    ) -> None:
        """Makes it.

        Args:
            steps: Number of steps.
        """


class Bare:
    """An agent without a constructor."""


class Untyped:
    """An agent whose author wrote no types."""

    def __init__(self, speed=3, *, needed, **rest):  # type: ignore[no-untyped-def]
        """Makes it."""


def test_the_signature_is_the_schema() -> None:
    properties = settings_schema(Mine)["properties"]
    assert properties["steps"] == {
        "type": "integer", "default": 3, "description": "Number of steps.", "exclusiveMinimum": 0
    }  # fmt: skip
    assert properties["gap"] == {
        "type": "number", "default": 2.5, "description": "Distance to a standing leader, m.", "minimum": 0,
        "maximum": 50,
    }  # fmt: skip
    assert properties["kind"]["enum"] == ["ekf", "ukf"]
    assert [name for name, one in properties.items() if names_a_path(one)] == ["weights"]
    assert settings_schema(Bare)["properties"] == {}
    assert settings_schema(Untyped)["additionalProperties"]
    assert settings_schema(Untyped)["required"] == ["needed"]


GOOD = [{}, {"steps": 1, "gap": 50, "kind": "ukf", "careful": False}, {"weights": "x.onnx", "anything": [1, {"a": 2}]}]
BAD = [
    ({"stepps": 3}, r"'stepps': unknown, did you mean 'steps'\? \(its settings are anything, careful, gap, kind, "),
    ({"x": 3, "gap": 51, "y": 1}, "'x': unknown; .*'y': unknown"),
    ({"steps": 0}, "'steps': expected a whole number, above 0, got 0"),
    ({"steps": 2.5}, "expected a whole number, above 0, got 2.5"),
    ({"steps": "2"}, "expected a whole number, above 0, got '2'"),
    ({"steps": True}, "expected a whole number, above 0, got True"),
    ({"gap": -1}, "'gap': expected a number, at least 0, at most 50, got -1"),
    ({"kind": "ufk"}, "expected one of 'ekf', 'ukf', got 'ufk'"),
    ({"mode": "c"}, "expected one of 'a', 'b', got 'c'"),
    ({"careful": 1}, "expected true or false, got 1"),
    ({"weights": 3}, "expected text or null, got 3"),
]


@pytest.mark.parametrize("settings", GOOD)
def test_what_fits_is_taken(settings: Mapping[str, Any]) -> None:
    check_settings(Mine, "agent 'mine'", settings)
    check_against(settings_schema(Mine), "agent 'mine'", settings)


@pytest.mark.parametrize(("settings", "message"), BAD)
def test_what_does_not_fit_is_named_with_what_came(settings: Mapping[str, Any], message: str) -> None:
    schema: Schema = settings_schema(Mine)
    with pytest.raises(SettingsError, match=message) as by_class:
        check_settings(Mine, "agent 'mine'", settings)
    with pytest.raises(SettingsError, match=message) as by_schema:
        check_against(schema, "agent 'mine'", settings)
    assert by_class.value.faults == by_schema.value.faults
    assert by_class.value.faults.keys() == settings.keys()


def test_a_constructor_that_takes_anything_gets_anything_but_what_it_needs() -> None:
    check_settings(Untyped, "agent", {"needed": object(), "more": 1})
    with pytest.raises(SettingsError, match=r"'needed': expected a value, got nothing"):
        check_settings(Untyped, "agent", {"speed": 1})


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e999])
def test_numbers_must_be_finite(value: float) -> None:
    with pytest.raises(SettingsError, match="'gap'"):
        check_settings(Mine, "agent", {"gap": value})
