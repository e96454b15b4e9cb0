"""The page of the theses' ablations: every claim is on it, and it holds what stored rows give."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dohyo.agents.ablations import Ablation, Decided, ablations, main, page
from dohyo.agents.studies.claims import Claim, Judgement, judge, of_ablation
from dohyo.agents.studies.registry import studies

DOCS = Path(__file__).parents[2] / "docs"


def judged(*higher: float, trainings: int = 3) -> list[Judgement]:
    """Claims "a > b" whose differences are given."""
    seeds = range(trainings)

    def values(claim: Claim, arm: str) -> dict[tuple[str], dict[int | None, float]]:
        difference = float(claim.measure) if arm == "a" else 0.0
        return {(f"m{i}",): dict.fromkeys(seeds, difference + i) for i in range(20)}

    return judge(of_ablation(1, *(Claim("a", ">", "b", str(one)) for one in higher)), values)


def decided(*higher: float, trainings: int = 3) -> Decided:
    ablation = Ablation(number=1, thesis="A", system="S", asks="Which?", told="This.", studies=("gri",), page="p.md")
    return Decided(ablation, judged(*higher, trainings=trainings))


def test_the_comparisons_have_consecutive_numbers_and_known_studies_and_pages() -> None:
    found = ablations()
    assert [one.number for one in found] == list(range(1, 30))
    assert {name for one in found for name in one.studies} <= set(studies())
    assert all((DOCS / one.page).exists() for one in found)


def test_a_comparison_is_reproduced_only_if_all_of_its_claims_are() -> None:
    assert decided(5.0, 7.0).verdict == "**reproduced**, 2 claims"
    assert decided(5.0, -7.0).verdict == "1 reproduced, 1 contradicted"
    assert decided(5.0, trainings=2).verdict == "**not resolved**"
    assert decided().verdict == "not judged so far"


def test_the_page_counts_the_claims_and_names_missing_trainings() -> None:
    text = page([decided(5.0, -7.0), decided()])
    assert "judge, 1 are reproduced, 1 contradicted and 0 not resolved. 1 ablations have no" in text
    assert "| a > b | 5.0 | 5.00 [5.00, 5.00] | < 0.001 | reproduced |" in text
    assert "— (1 training) | not resolved |" in page([decided(5.0, trainings=1)])


def test_claims_on_all_drives_are_told_to_stand_beside_those_on_parts() -> None:
    (one,) = judged(5.0)
    some = [replace(one, claim=replace(one.claim, where=where)) for where in ("", "town", "city")]
    alone = replace(one, claim=replace(one.claim, measure="other"))
    every = replace(decided(), judged=[*some, alone])
    text = page([every, replace(every, judged=[alone])])
    assert "Of 5 claims" in text
    assert "1 of the claims are on all drives together, and counted beside the same claims on parts of them." in text
    assert "over all claims of its list." in text


@pytest.mark.slow
def test_the_published_page_is_what_the_stored_rows_give(tmp_path: Path) -> None:
    main(["--out", str(tmp_path / "page.md")])
    assert (tmp_path / "page.md").read_text() == (DOCS / "ablations.md").read_text()
