"""The study of MBAPPE: its arms and claims can be made, and its tables come out of rows."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from dohyo.agents.mcts.config import Settings
from dohyo.agents.mcts.mbappe import Mbappe
from dohyo.agents.mcts.predictor_only import PredictorOnly
from dohyo.agents.mcts.predictors.export import export
from dohyo.agents.mcts.predictors.idm import IdmRollout
from dohyo.agents.mcts.predictors.network import MotionNetwork
from dohyo.agents.mcts.study import study
from dohyo.agents.mcts.study.arms import ARMS, TRAINED
from dohyo.agents.mcts.study.losses import CAUSES
from dohyo.agents.mcts.study.measures import EXCERPTS, ROUTES, SHARES, of_route
from dohyo.agents.mcts.study.tables import CLAIMS, ROUTE_CLAIMS, section
from dohyo.agents.planning.prediction import Predictor
from dohyo.agents.planning.scene import SENSORS, SceneBuilder
from dohyo.agents.planning.warm_up import empty_road
from dohyo.agents.studies.arms import Cell
from dohyo.agents.studies.rows import Row, cell_of, read_rows
from dohyo.agents.studies.samples import Sample
from dohyo.agents.studies.study import Results
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import ego, infraction


def rows(arm: str, benchmark: str, *scores: float) -> list[Row]:
    """A row per scenario, of the first training if the arm has some; shares are 0, all other measures 50."""
    training = 0 if arm in TRAINED else None
    rest = dict.fromkeys((*EXCERPTS, *ROUTES), 50.0) | dict.fromkeys(SHARES, 0.0)
    points = {"points": dict.fromkeys(CAUSES, 0.0)} if benchmark.startswith("val14") else {}
    return [
        {**Cell(arm, training, benchmark, f"town.m{i}", 0)._asdict(), **rest, **deepcopy(points), "score": score}
        for i, score in enumerate(scores)
    ]


def table(sample: Sample, *some: Row) -> str:
    return section(sample, ARMS)(Results(some, {}))


def predictor_of(cell: Cell, runs: Path) -> Predictor:
    agent = study.agent_of(cell, runs)
    assert isinstance(agent, Mbappe | PredictorOnly)
    return agent.predictor


def test_every_arm_can_be_set_and_every_claim_is_of_arms() -> None:
    for arm in ARMS.values():
        if arm.agent in ("mbappe", "random-shooting"):
            Settings(**arm.settings)
    assert {name for one in CLAIMS + ROUTE_CLAIMS for name in (one.left, one.right)} <= set(ARMS)


def test_the_cells_are_those_of_the_published_tables() -> None:
    cells = study.cells(study.Options())
    counts = {
        benchmark: len({c.scenario for c in cells if c.benchmark == benchmark}) for benchmark in ("val14", "nocrash")
    }
    assert counts == {"val14": 126, "nocrash": 50}
    untrained = len(ARMS) - len(TRAINED)
    assert len(cells) == 126 * (3 * len(TRAINED) + untrained) + 70 * 4 + 2 * 25 * 3 + 20 * 3


def test_the_stored_rows_are_of_cells_of_the_study_and_each_once() -> None:
    stored = [cell_of(row) for row in read_rows(study.STUDY.stored)]
    assert len(set(stored)) == len(stored)
    assert set(stored) <= set(study.cells(study.Options()))
    thesis = {name for name in ARMS if name.startswith(("prior", "thesis"))} - {"thesis-crafted", "thesis-wheel"}
    assert {cell.arm for cell in stored} >= thesis | {"mbappe"}


@pytest.mark.parametrize(
    ("shift", "word"), [(20.0, "reproduced"), (-20.0, "contradicted"), (0.1, "not resolved")], ids=str
)
def test_a_claim_is_judged_on_the_paired_scores(shift: float, word: str) -> None:
    noise = (1.0, -2.0, 2.0, -1.0, 0.5, -0.5, 1.5, -1.5)
    text = table(
        Sample("val14"),
        *rows("pdm-closed", "val14", *(50.0 + shift + one for one in noise)),
        *rows("mbappe", "val14", *(80.0 + shift + one for one in noise)),
        *rows("idm", "val14", *[50.0] * 8),
    )
    claims = {line.split(" | ")[0]: line for line in text.splitlines() if "> idm" in line}
    assert claims["| pdm-closed > idm"].endswith(f"| {word} |")
    # Its predictor was trained once.
    assert claims["| mbappe > idm"].endswith("| not resolved: 1 training |")


def test_an_arm_is_trained_where_the_predictor_has_a_part_in_it() -> None:
    other_predictors = {f"{arm}-{name}" for arm in ("predictor", "alone") for name in ("idm", "constant_velocity")}
    assert ARMS.keys() - TRAINED == {"autopilot", "idm", "pdm-closed", "pdm-published"} | other_predictors


@pytest.mark.parametrize("arm", ["mbappe", "alone-learned", "random-shooting", "predictor-idm"])
def test_an_arm_drives_with_the_predictor_of_its_training(arm: str, tmp_path: Path) -> None:
    cell = Cell(arm, 1 if arm in TRAINED else None, "val14", "town.m1", 0)
    if arm not in TRAINED:
        assert isinstance(predictor_of(cell, tmp_path), IdmRollout)
        return
    with pytest.raises(InvalidInputError, match=r"no predictor '.*seed-1/predictor\.onnx'"):
        study.agent_of(cell, tmp_path)
    folder = tmp_path / "predictor" / "seed-1"
    folder.mkdir(parents=True)
    export(MotionNetwork().eval(), folder / "predictor.onnx")
    scene = SceneBuilder().update(empty_road(SENSORS))
    other, shipped = (predictor_of(cell._replace(training_seed=seed), tmp_path).predict(scene).ego for seed in (1, 0))
    assert other is not None
    assert shipped is not None
    assert not np.array_equal(other, shipped)


def test_excerpts_and_whole_routes_have_their_own_columns_and_only_val14_the_thesiss() -> None:
    excerpts = table(Sample("val14"), *rows("mbappe", "val14", 80, 90))
    assert "| mbappe | 85.0 [80.0, 90.0] | 0.0 [0.0, 65.8] | 0.0 [0.0, 65.8] | 50.0 [50.0, 50.0] | 86 | 2 |" in excerpts
    reactive = table(Sample("val14-reactive"), *rows("mbappe", "val14-reactive", 80, 90))
    routes = table(Sample("nocrash", ("town",)), *rows("mbappe", "nocrash", 80, 90))
    assert "| NoCrash success, % | DS |" in routes
    assert "thesis" not in reactive + routes
    assert table(Sample("nocrash", ("city",)), *rows("mbappe", "nocrash", 80, 90)) == ""


def test_lost_drives_are_in_no_mean() -> None:
    driven = rows("mbappe", "nocrash", 80, 90)
    gridlock = {**driven[1], "scenario": "town.m9", "status": "lost: traffic was gridlocked", "driving_score": 0.0}
    gone = {**Cell("mbappe", 0, "nocrash", "town.m10", 0)._asdict(), "lost": "the process died"}
    lines = table(Sample("nocrash"), *driven, gridlock, gone).splitlines()
    assert next(line for line in lines if line.startswith("| mbappe")).endswith("| 2 |")


def test_what_was_lost_is_told_cause_by_cause() -> None:
    some = rows("mbappe", "val14", 80, 90)
    some[0]["points"]["person"] = 20.0
    text = table(Sample("val14"), *some, *rows("pdm-closed", "val14", 60, 70), *rows("idm", "val14", 60, 70))
    assert "| points lost (in drives) | mbappe | pdm-closed |" in text
    assert "| hit somebody on foot, at fault | 10.0 (1) | 0 |" in text
    assert "points lost" not in table(Sample("nocrash"), *rows("mbappe", "nocrash", 80, 90))


def test_shares_have_wilsons_interval() -> None:
    some = rows("mbappe", "nocrash", 80, 90, 70, 60)
    some[0]["hits"] = 100.0
    assert "| 25.0 [4.6, 69.9] |" in table(Sample("nocrash"), *some)


def test_whole_routes_are_measured_by_what_happened_on_them() -> None:
    good = of_route(ego(status=Status.PERFECT))
    late = of_route(ego(infraction(InfractionKind.COLLISION_VEHICLE, at_fault=False)))
    assert set(good) == set(ROUTES)
    assert (good["nocrash_success"], good["perfect"], good["hits"]) == (100.0, 100.0, 0.0)
    assert (late["nocrash_success"], late["out_of_time"], late["hits"], late["collisions"]) == (0.0, 100.0, 100.0, 0.0)


def test_the_planner_is_developed_on_the_other_half() -> None:
    look, published = (
        {cell.scenario for cell in study.cells(study.Options(look=half)) if cell.benchmark.startswith("val14")}
        for half in (True, False)
    )
    assert (len(look), len(published)) == (154, 126)
    assert not look & published
    sample, results = Sample("val14", remainder=0), Results(rows("idm", "val14", 80, 90), {"options": {"look": True}})
    assert section(sample, ARMS)(results).startswith("On `val14`, odd-numbered missions:")


@pytest.mark.slow
def test_an_excerpt_is_driven_and_scored() -> None:
    cell = next(one for one in study.cells(study.Options()) if one.arm == "idm")
    study.prepare(study.Options(), [cell], 1)
    (row,) = study.work(study.Options(), [cell])
    assert 0.0 <= row["score"] <= 100.0
    assert sum(row["points"].values()) == pytest.approx(100.0 - row["score"])
