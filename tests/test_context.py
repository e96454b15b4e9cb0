"""CONTEXT.md: every infraction and status, with the numbers in use."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dohyo.evaluation.records.record import EgoRecord, Infraction
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.scores.driving import infraction_penalty

ROOT = Path(__file__).parents[1]


def text(name: str) -> str:
    return (ROOT / name).read_text()


def table(source: str, title: str) -> dict[str, list[str]]:
    """Rows of the table whose header begins so, by their first cell; names are taken out of their backticks."""
    rows: dict[str, list[str]] = {}
    _, _, rest = source.partition(f"\n| {title} |")
    for line in rest.splitlines()[2:]:
        if not line.startswith("|"):
            break
        first, *others = (cell.strip() for cell in line.strip("|").split("|"))
        for name in re.findall(r"`([^`]+)`", first) or [first]:
            rows[name] = others
    assert rows, f"no table '{title}'"
    return rows


def test_context_has_every_infraction_and_status() -> None:
    source = text("CONTEXT.md")
    assert set(table(source, "kind")) == {kind.value for kind in InfractionKind}
    assert set(table(source, "status")) == {status.value for status in Status}


def test_context_has_the_factors_and_costs_in_use() -> None:
    rows = table(text("CONTEXT.md"), "infraction | p (1.0, 2.0)")
    for kind in InfractionKind:
        if kind in (InfractionKind.MINIMUM_SPEED, InfractionKind.OUTSIDE_LANES):
            continue  # theirs are formulas
        one = Infraction(kind=kind, time_s=0.0, x_m=0.0, y_m=0.0, route_m=0.0)
        factor, cost = infraction_penalty([one], "2.0", 0.0), 1 / infraction_penalty([one], "2.1", 0.0) - 1
        said = rows[kind.value]
        if said[1] == "none":
            assert (factor, cost) == (1.0, 0.0)
        else:
            assert (float(said[0].partition(",")[0]), float(said[1])) == pytest.approx((factor, cost))


def test_context_specifies_each_kind_as_the_code_does() -> None:
    source = text("CONTEXT.md")
    sizes, penalties = table(source, "kind"), table(source, "infraction | p (1.0, 2.0)")
    for kind in InfractionKind:
        when, size = sizes[kind.value]
        unit = kind.specification.unit
        assert re.search(rf"(^|, ){re.escape(unit)}($| of)", size), (kind, size)
        assert (kind.specification.ends is not None) == ("ends the drive" in when), kind
        assert (kind.specification.since != "1.0") == ("not in 1.0" in penalties[kind.value][0]), kind


def test_context_speaks_of_record_fields_that_exist() -> None:
    assert {"contacts", "infractions"} <= set(EgoRecord.model_fields)
    assert {"at_fault", "magnitude"} <= set(Infraction.model_fields)
