"""A drive that fails, for the works of studies that drive several missions in one job."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from types import ModuleType

import pytest

from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row
from dohyo.sumo_networks.errors import SimulationError
from dohyo.sumo_networks.scenario import Scenario


def check_that_one_failed_drive_loses_its_cell_alone(
    monkeypatch: pytest.MonkeyPatch, study: ModuleType, work: Callable[[list[Cell]], Iterable[Row]], cell: Cell
) -> None:
    """Three missions as one job of a study's module, of which the second one's simulation fails."""

    def driven(scenario: Scenario, agent: object) -> tuple[Scenario, object]:
        if scenario.name.endswith(".m02"):
            raise SimulationError("SUMO is gone")
        return scenario, agent

    monkeypatch.setattr(study, "driven", driven)
    monkeypatch.setattr(study, "measures", lambda *_: dict.fromkeys((*getattr(study, "KEPT", ()), "success"), 100.0))
    job = [cell._replace(scenario=f"town-test.empty.test.m0{number}") for number in (1, 2, 3)]
    rows = list(work(job))
    assert [row.get("success") for row in rows] == [100.0, None, 100.0]
    assert rows[1] == {**job[1]._asdict(), "lost": "SimulationError: SUMO is gone"}
