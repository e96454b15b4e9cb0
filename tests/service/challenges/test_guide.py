"""The guide for organisers names every property of a phase, and its phases can be made as they stand."""

from __future__ import annotations

import json
import os
import re
import subprocess
from pathlib import Path

from dohyo.service.accounts.model import Role
from dohyo.service.challenges.orders import PhaseOrder
from tests.service.harness import Harness

GUIDE = Path(__file__).parents[3] / "docs" / "organisers" / "challenge.md"


def test_the_table_of_a_phase_has_every_property_but_its_name_and_benchmark() -> None:
    table = GUIDE.read_text().partition("| property | meaning | default | advice |")[2].partition("\n\n")[0]
    listed = {name for row in table.splitlines()[2:] for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert listed == PhaseOrder.model_fields.keys() - {"name", "benchmark"}


def test_the_phases_of_the_guide_can_be_made_whenever_they_are_copied(service: Harness, tmp_path: Path) -> None:
    block = next(one for one in GUIDE.read_text().split("```")[1::2] if "<<PHASE" in one)
    curl = tmp_path / "curl"
    curl.write_text('#!/bin/sh\nfor one; do test "$one" = @- && cat; done\n')
    curl.chmod(0o755)
    path = {"PATH": f"{tmp_path}:{os.environ['PATH']}"}
    sent = subprocess.run(["bash", "-c", block], env=path, capture_output=True, text=True, check=True).stdout
    organiser = service.caller("lab", Role.ORGANISER)
    organiser.post("/v1/challenges", {"name": "autumn-2026", "title": "t"})
    orders = [json.loads(one + "}") for one in sent.split("}\n")[:-1]]
    assert [order["name"] for order in orders] == ["practice", "final"]
    for order in orders:
        made = organiser.post("/v1/challenges/autumn-2026/phases", order)
        assert made.status_code == 201, made.text
