from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.agents.mcts.config import Settings
from dohyo.agents.mcts.study import (
    ARMS,
    CLAIMS,
    ROUTE_CLAIMS,
    SHARES,
    as_document,
    cells_of,
    estimates,
    measure,
    part_of,
    run,
    verdict,
)
from dohyo.agents.mcts.tables import EXCERPTS, ROUTES, section, tables
from dohyo.evaluation.authoring.scenario_types import TYPES
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.running.run import Manifest, Result
from dohyo.sumo_networks.errors import InvalidInputError
from tests.evaluation.builders import ego, episode, infraction, lost


def drives(*scores: float) -> dict[tuple[str, int, str], dict[str, float]]:
    rest = dict.fromkeys((*EXCERPTS, *ROUTES), 50.0) | dict.fromkeys(SHARES, 0.0)
    return {(f"scenario-{i}", 0, "ego"): {**rest, "score": score} for i, score in enumerate(scores)}


def test_every_arm_can_be_set_and_every_claim_is_of_arms() -> None:
    for arm in ARMS.values():
        if arm.agent in ("mbappe", "random-shooting"):
            Settings(**arm.settings)
    assert {name for above, below, _ in CLAIMS + ROUTE_CLAIMS for name in (above, below)} <= set(ARMS)


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


def test_each_study_has_a_section_of_its_own() -> None:
    arms = {"mbappe": drives(80, 90)}
    assert section(as_document("val14", arms)) == "val14"
    assert section(as_document("nocrash", arms, cells="town")) == "nocrash town"


def test_excerpts_and_whole_routes_have_their_own_columns() -> None:
    arms = {"mbappe": drives(80, 90), "idm": drives(60, 70)}
    excerpts, routes = as_document("val14", arms), as_document("nocrash", arms, cells="town")
    assert "| mbappe | 85.0 [80.0, 90.0] | 0.0 [0.0, 65.8] | 0.0 [0.0, 65.8] | 50.0 [50.0, 50.0] | 86 | 2 |" in tables(
        excerpts
    )
    assert "| NoCrash success, % | DS |" in tables(routes)
    assert "thesis" not in tables(routes) + tables(as_document("val14-reactive", arms))


def test_what_was_lost_is_told_cause_by_cause() -> None:
    some = drives(80, 90)
    next(iter(some.values()))["lost_person"] = 20.0
    text = tables(as_document("val14", {"mbappe": some, "pdm-closed": drives(60, 70), "idm": drives(60, 70)}))
    assert "| points lost (in drives) | mbappe | pdm-closed |" in text
    assert "| hit somebody on foot, at fault | 10.0 (1) | 0 |" in text
    assert "points lost" not in tables(as_document("nocrash", {"mbappe": drives(80, 90)}))


def test_shares_have_wilsons_interval() -> None:
    some = drives(80, 90, 70, 60)
    next(iter(some.values()))["hits"] = 100.0
    found = estimates(some)["hits"]
    assert (found.mean, found.n) == (25.0, 4)
    assert found.low == pytest.approx(4.6, abs=0.1)
    assert found.high == pytest.approx(69.9, abs=0.1)


def test_what_is_looked_at_and_what_is_held_out_are_apart_and_whole() -> None:
    val14 = load_benchmark("val14")
    names = {part: [one.name for one in part_of(val14, part).scenarios([0])] for part in ("all", "look", "held-out")}
    assert not set(names["look"]) & set(names["held-out"])
    assert set(names["look"]) | set(names["held-out"]) == set(names["all"])
    for part in ("look", "held-out"):
        assert {name.partition(".")[0] for name in names[part]} == set(TYPES)
        assert part_of(val14, part).sha256 != val14.sha256


def test_so_many_of_each_type_are_a_part_of_more() -> None:
    val14 = load_benchmark("val14")
    few, more = ({one.name for one in part_of(val14, "held-out", n).scenarios([0])} for n in (2, 3))
    assert len(few) == 2 * len(TYPES)
    assert few < more


def test_a_benchmark_without_excerpts_has_no_parts() -> None:
    with pytest.raises(InvalidInputError, match="held-out"):
        part_of(load_benchmark("quickstart"), "held-out")


def test_cells_are_chosen_by_how_their_names_begin() -> None:
    nocrash = load_benchmark("nocrash")
    dense = cells_of(nocrash, "town-test.dense")
    assert [cell.name for cell in dense.cells] == ["town-test.dense.train", "town-test.dense.test"]
    names = {one.name for one in nocrash.scenarios([0])}
    assert {one.name for one in dense.scenarios([0])} == {name for name in names if name.startswith("town-test.dense")}
    with pytest.raises(InvalidInputError, match=r"expected a prefix of .*, got 'town-nowhere'"):
        cells_of(nocrash, "town-nowhere")


def test_whole_routes_are_measured_by_what_happened_on_them(tmp_path: Path) -> None:
    hit = infraction(InfractionKind.COLLISION_VEHICLE, at_fault=False)
    records = (episode(ego(status=Status.PERFECT), name="good"), episode(ego(hit), name="late"), lost(name="lost"))
    paths = tuple(tmp_path / record.scenario.name for record in records)  # no trajectory is read
    good, late = measure(Result(Manifest.model_construct(), records, paths, 0)).values()
    assert set(good) == set(ROUTES)
    assert (good["nocrash_success"], good["perfect"], good["hits"]) == (100.0, 100.0, 0.0)
    assert (late["nocrash_success"], late["out_of_time"], late["hits"], late["collisions"]) == (0.0, 100.0, 100.0, 0.0)


def test_an_unknown_arm_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="prior-nun"):
        run("quickstart", ["prior-nun"], [0], tmp_path, 1)
    assert not any(tmp_path.iterdir())
