"""The study on congested mornings: what it learns from, and that all arms have as many updates as the n-step."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import pytest

from dohyo.agents.forecasting.data.reading import read_data
from dohyo.agents.forecasting.study import mornings, mornings_long, study
from dohyo.agents.forecasting.study.arms import EQUAL, PHASES
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.study import Results
from dohyo.evaluation.report.style import MISSING
from dohyo.sumo_networks.errors import InvalidInputError
from tests.agents.forecasting.roads import write_folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Mornings of one road, and test days of another; nothing in train/."""
    return write_mornings(tmp_path_factory.mktemp("data"), 21)


def write_mornings(folder: Path, segments: int) -> Path:
    """Three mornings of a road with so many segments."""
    made = write_folder(folder, days=3, rows=40, segments=segments)
    (made / "train").rename(made / "mornings")
    return made


def test_it_learns_from_the_mornings_alone(folder: Path) -> None:
    data = read_data(folder, learn="mornings")
    assert [one.name for one in data.sets["train"]] == ["mornings/day-0001", "mornings/day-0002"]
    assert [one.name for one in data.sets["validation"]] == ["mornings/day-0003"]
    with pytest.raises(InvalidInputError, match=r"expected days in '.*/train'"):
        read_data(folder)


def test_every_claim_is_of_arms_and_all_have_equal_updates() -> None:
    claimed = {arm for claim in mornings.claims() for arm in (claim.left, claim.right)}
    assert claimed <= set(EQUAL)
    for one in (EQUAL[arm] for arm in claimed if EQUAL[arm].is_trained):
        assert one.length * (PHASES if one.name == "sa-lstm-n-step" else 1) == PHASES, one


@pytest.mark.parametrize(
    ("kind", "section", "told"),
    [
        (mornings, mornings.section, "| SA-LSTM | 4.52 |"),
        (mornings_long, mornings_long.section, "n-step < recursive at t+3, balanced, at most 4 x the updates"),
    ],
)
def test_the_rows_of_a_run_make_the_tables(
    kind: ModuleType, section: Callable[[Results], str], told: str, folder: Path, tmp_path: Path
) -> None:
    options = kind.Options(data=folder, steps=1, models=tmp_path)
    rows = []
    for arm in options.arms:
        own = [cell for cell in kind.STUDY.cells(options) if cell.arm == arm and not cell.training_seed]
        measured = study.work(options, own)
        rows += [cell._asdict() | row for cell, row in zip(own, measured, strict=True)]
    facts = {"seeds": [0], "steps": 1, "training_s": 60.0, "free_kmh": 100.0, "stretches": {}, "windows": {}}
    text = section(Results(rows, facts))
    assert told in text
    assert MISSING not in text.split("| claim |")[0]
    assert section(Results([], {})) == ""
    if kind is mornings:
        assert "(sa-lstm-quantiles-shipped) | row | as calibrated: hold, % | width, km/h | tracked: hold, % |" in text


def test_what_ships_is_refused_on_another_road(tmp_path: Path) -> None:
    options = mornings.Options(data=write_mornings(tmp_path / "data", 4), steps=1, models=tmp_path)
    cell = Cell("sa-lstm-n-step-shipped", None, "hard", "00", None)
    with pytest.raises(InvalidInputError, match=r"forecasts 21 segments, '.*' has 4"):
        list(study.work(options, [cell]))
