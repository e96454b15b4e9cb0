from __future__ import annotations

import json
from pathlib import Path

import pytest

from agents.mcts.config import Settings
from agents.mcts.study import ARMS, CLAIMS, as_document, run, tables, verdict, write_tables
from sumo_networks.errors import InvalidInputError


def drives(*scores: float) -> dict[tuple[str, int, str], dict[str, float]]:
    rest = {"collisions": 0.0, "off_road": 0.0, "progress": 90.0, "driving_score": 50.0, "nocrash_success": 100.0}
    return {(f"scenario-{i}", 0, "ego"): {"score": score, **rest} for i, score in enumerate(scores)}


def test_every_arm_can_be_set_and_every_claim_is_of_arms() -> None:
    for arm in ARMS.values():
        if arm.agent in ("mbappe", "random-shooting"):
            Settings(**arm.settings)
    assert {name for above, below, _ in CLAIMS for name in (above, below)} <= set(ARMS)


@pytest.mark.parametrize(
    ("above", "word"),
    [((80, 90, 85, 95), "reproduced"), ((60, 50, 50, 55), "contradicted"), ((70, 71, 69, 72), "not resolved")],
)
def test_verdicts_follow_the_paired_interval(above: tuple[float, ...], word: str) -> None:
    assert verdict(drives(*above), drives(70, 72, 68, 71), "score")[0] == word


def test_only_drives_of_both_are_compared() -> None:
    _, compared = verdict(drives(80, 90, 85), drives(70, 80), "score")
    assert compared is not None
    assert compared.difference.n == 2
    assert compared.difference.mean == pytest.approx(10.0)


def test_tables_go_between_their_marks(tmp_path: Path) -> None:
    document = as_document("val14", {"mbappe": drives(80, 90), "idm": drives(60, 70)})
    readme = tmp_path / "README.md"
    readme.write_text("before\n<!-- study val14 -->\nold\n<!-- end val14 -->\nafter\n")
    write_tables(readme, json.loads(json.dumps(document)))
    text = readme.read_text()
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    assert "old" not in text
    assert tables(document) in text
    with pytest.raises(InvalidInputError, match="marks"):
        write_tables(readme, {**document, "benchmark": "other"})


def test_an_unknown_arm_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="prior-nun"):
        run("quickstart", ["prior-nun"], [0], tmp_path, 1)
    assert not any(tmp_path.iterdir())
