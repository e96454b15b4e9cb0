"""The study of row 21: its arms, that a cell is one journey of the grid, and what calibration does to it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dohyo.agents.localization.study import grid
from dohyo.agents.localization.study.study import ARMS, CLAIMS, STUDY, VARIANTS, Options, cells, work
from dohyo.agents.localization.study.synthetic import ROUTES, errors_of
from dohyo.agents.studies.arms import Cell, Place
from dohyo.agents.studies.rows import cell_of, read_rows


@pytest.fixture
def short(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Journeys of 40 s."""
    monkeypatch.setattr(grid, "LENGTH_S", 40.0)
    grid._journey.cache_clear()
    yield
    grid._journey.cache_clear()


def test_every_variant_has_every_rate_and_every_arm_the_same_journeys() -> None:
    wanted = cells(Options())
    journeys = {arm: {cell[2:] for cell in wanted if cell.arm == arm} for arm in ARMS}
    assert len(ARMS) == len(VARIANTS) * len(grid.RATES_HZ)
    assert len({frozenset(own) for own in journeys.values()}) == 1
    assert {arm for claim in CLAIMS for arm in (claim.left, claim.right)} <= set(ARMS)


def test_the_stored_rows_are_the_cells_of_the_study() -> None:
    assert {cell_of(row) for row in read_rows(STUDY.stored)} == set(cells(Options()))


@pytest.mark.usefixtures("short")
def test_a_cell_is_a_journey_of_the_grid_and_calibration_makes_it_better() -> None:
    place = Place("sigma-0.1m", "straight", 3)
    job = [Cell(arm, None, *place) for arm in ("uncalibrated-10hz", "calibrated-10hz", "robust-1hz")]
    bad, good, robust = work(Options(), job)
    alone = grid.run_cell(grid.Cell("calibrated", "es-ekf", 10.0, 0.1), "straight", 3)
    assert good["rmse"] < 0.5 * bad["rmse"]
    assert good["rmse"] == pytest.approx(alone["rmse"], abs=1e-6)
    assert robust["accuracy"] > 50.0


def test_journeys_of_a_seed_have_errors_of_their_own() -> None:
    """Else their mean would be taken for that of as many draws."""
    drawn = {(route, seed): errors_of(route, seed).random() for route in ROUTES for seed in range(5)}
    assert len(set(drawn.values())) == len(drawn)
    assert errors_of("straight", 3).random() == drawn["straight", 3]
    assert errors_of("straight", 3, part=1).random() not in drawn.values()
