"""The version of a benchmark: what decides it, what does not, and that a changed copy has its own."""

from __future__ import annotations

from dohyo.evaluation.benchmarks.benchmark import load_benchmark


def test_a_changed_copy_has_a_version_of_its_own() -> None:
    quickstart = load_benchmark("quickstart")
    before = quickstart.sha256
    changed = quickstart.model_copy(update={"stop_on_collision": not quickstart.stop_on_collision})
    assert changed.sha256 != before
    assert type(changed).model_validate(changed.model_dump(mode="json")).sha256 == changed.sha256
    assert quickstart.sha256 == before


def test_default_seeds_and_description_are_no_part_of_it() -> None:
    quickstart = load_benchmark("quickstart")
    for same in ({"seeds": (7,)}, {"description": "other words"}):
        assert quickstart.model_copy(update=same).sha256 == quickstart.sha256
