"""Layers: the service says at its start and in its health check how strangers' work is confined."""

from __future__ import annotations

import logging

import pytest

from dohyo.service.confinement import layers as room
from dohyo.service.confinement.errors import ConfinementError
from tests.service.harness import Harness


def test_the_health_check_names_the_layers(service: Harness) -> None:
    found = service.client.get("/health/ready").json()["confinement"]
    assert found["available"]
    assert found["system_calls"]
    assert len(found["missing"]) == (not found["files"]) + (not found["network"])


@pytest.mark.parametrize(
    ("layers", "says"),
    [({"landlock": 0, "own_network": True}, "Landlock"), ({"landlock": 4, "own_network": False}, "namespaces")],
)
def test_a_missing_layer_is_a_warning(
    layers: dict[str, object], says: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    class Weaker:
        def __init__(self, *_: object) -> None:
            self.layers = layers

        def end(self) -> None:
            """Nothing runs."""

    monkeypatch.setattr(room, "ConfinedProcess", Weaker)
    monkeypatch.setattr(room, "layers", room.layers.__wrapped__)
    room.prepare_confinement()
    (warning,) = [one for one in caplog.records if one.levelno == logging.WARNING]
    assert says in warning.getMessage()


def test_a_machine_that_cannot_confine_runs_nothing(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def refused(*_: object) -> None:
        raise ConfinementError("this machine cannot confine a process: seccomp: Function not implemented")

    monkeypatch.setattr(room, "ConfinedProcess", refused)
    monkeypatch.setattr(room, "layers", room.layers.__wrapped__)
    room.prepare_confinement()
    assert "none is run: this machine cannot confine a process: seccomp" in caplog.text
