"""The study of planners: what each scores, where its points go, and that only held-out excerpts are driven."""

from __future__ import annotations

from dohyo.agents.league.study.planners import ARMS, STUDY, Options, cells
from dohyo.agents.mcts.study.losses import CAUSES
from dohyo.agents.studies.rows import Row
from dohyo.agents.studies.study import Results


def drives(arm: str, scores: list[float]) -> list[Row]:
    return [
        {
            "arm": arm, "training_seed": None, "benchmark": "val14", "scenario": f"turn.m{2 * i:02}", "seed": 0,
            "status": "finished", "score": score, "collisions": 0.0, "off_road": 0.0, "progress": 100.0,
            "points": dict.fromkeys(CAUSES, 0.0) | {"comfort": 100.0 - score},
        }
        for i, score in enumerate(scores)
    ]  # fmt: skip


def test_every_planner_drives_every_even_excerpt_once() -> None:
    driven = cells(Options())
    assert len(driven) == len(set(driven)) == 126 * len(ARMS)
    assert {int(cell.scenario.rpartition(".m")[2]) % 2 for cell in driven} == {0}
    assert {cell.benchmark for cell in driven} == {"val14"}


def test_the_tables_tell_scores_and_where_points_went() -> None:
    results = Results([*drives("mbappe", [100.0, 80.0]), *drives("idm", [60.0, 60.0])], {})
    scores = STUDY.tables["planners"](results).splitlines()
    assert [line.split(" | ")[0].strip("| ") for line in scores[2:]] == ["mbappe", "idm"]
    assert "90.0 [" in scores[2]
    assert scores[2].endswith("| 86 | 2 |")
    causes = STUDY.tables["planner-causes"](results)
    assert "10.0 (1)" in causes
    assert "40.0 (2)" in causes
    assert len(causes.splitlines()) == 3, "causes that took nothing are left out"


def test_a_claim_pairs_the_excerpts_that_both_drove() -> None:
    rows = [*drives("mbappe", [100.0] * 9), *drives("idm", [60.0] * 8)]
    assert "| mbappe > idm | 8 | 40.0 [40.0, 40.0] n=8 |" in STUDY.tables["planner-claims"](Results(rows, {}))


def test_without_rows_there_are_no_tables() -> None:
    assert {table(Results([], {})) for name, table in STUDY.tables.items() if name != "planner-claims"} == {""}
