"""Enumerations: the same numbers in the interface, in its description, and in the guide for authors of workers."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dohyo.service.wire.enumerations import ENUMERATIONS, in_words
from tests.service.harness import Harness

GUIDE = Path(__file__).parents[3] / "docs" / "organisers" / "workers.md"


def test_the_interface_has_the_numbers(service: Harness) -> None:
    published = service.client.get("/v1/observations").json()["enumerations"]
    assert published["state of a light"] == {"off": 0, "red": 1, "yellow": 2, "green": 3}
    assert published["command of the navigation"]["change_right"] == 5
    chosen = service.client.get("/v1/observations", params={"sensors": "route"}).json()
    assert chosen["enumerations"] == published


@pytest.mark.parametrize("what", ENUMERATIONS)
def test_guide_and_description_have_the_numbers(service: Harness, what: str) -> None:
    numbers = in_words(ENUMERATIONS[what])
    assert f"| {what} | {numbers} |" in GUIDE.read_text()
    assert f"{what}: {numbers}" in json.dumps(service.client.get("/openapi.json").json())
