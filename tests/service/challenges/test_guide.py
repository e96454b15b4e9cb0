"""The guide for organisers names every property of a phase."""

from __future__ import annotations

import re
from pathlib import Path

from dohyo.service.challenges.orders import PhaseOrder

GUIDE = Path(__file__).parents[3] / "docs" / "organisers" / "challenge.md"


def test_the_table_of_a_phase_has_every_property_but_its_name_and_benchmark() -> None:
    table = GUIDE.read_text().partition("| property | meaning | advice |")[2].partition("\n\n")[0]
    listed = {name for row in table.splitlines()[2:] for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert listed == PhaseOrder.model_fields.keys() - {"name", "benchmark"}
