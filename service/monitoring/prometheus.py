"""Prometheus' text format, version 0.0.4."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from dohyo.sumo_networks.errors import InvalidInputError

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"
_NAME: Final = re.compile(r"[a-zA-Z_:][a-zA-Z0-9_:]*")
_LABEL: Final = re.compile(r"[a-zA-Z_][a-zA-Z0-9_]*")


@dataclass(frozen=True, slots=True)
class Sample:
    """One value.

    Attributes:
        value: Any float, also infinite or NaN.
        labels: Pairs of name and value.
        suffix: After the family's name: "_sum", "_count", "_bucket" or nothing.
    """

    value: float
    labels: Mapping[str, str] = field(default_factory=dict)
    suffix: str = ""


@dataclass(frozen=True, slots=True)
class Family:
    """Samples of one name.

    Attributes:
        name: As Prometheus has it: unit and "_total" at its end.
        help: Description in one line.
        type: Type of the metric: counter, gauge, histogram...
        samples: Samples, possibly none.
    """

    name: str
    help: str
    type: Literal["counter", "gauge", "summary", "histogram"]
    samples: tuple[Sample, ...]


def exposition(families: Iterable[Family]) -> str:
    """Formats the families as text; every family once, with its help and type.

    Raises:
        InvalidInputError: A name or a label's name is not one that Prometheus takes.
    """
    lines = []
    for family in families:
        if not _NAME.fullmatch(family.name):
            raise InvalidInputError(f"expected a metric's name, got {family.name!r}")
        lines.append(f"# HELP {family.name} {_escaped(family.help)}")
        lines.append(f"# TYPE {family.name} {family.type}")
        lines += [_line(family.name, sample) for sample in family.samples]
    return "\n".join(lines) + "\n"


def _line(name: str, sample: Sample) -> str:
    for label in sample.labels:
        if not _LABEL.fullmatch(label):
            raise InvalidInputError(f"expected a label's name, got {label!r} in metric {name}")
    labels = ",".join(f'{label}="{_quoted(value)}"' for label, value in sample.labels.items())
    return f"{name}{sample.suffix}{f'{{{labels}}}' if labels else ''} {_number(sample.value)}"


def _number(value: float) -> str:
    if math.isnan(value):
        return "NaN"
    if math.isinf(value):
        return "+Inf" if value > 0 else "-Inf"
    return repr(float(value))


def _escaped(text: str) -> str:
    return text.replace("\\", r"\\").replace("\n", r"\n")


def _quoted(text: str) -> str:
    return _escaped(text).replace('"', r"\"")
