"""Ablations: the twenty-nine comparisons of the three theses, with the verdicts of stored rows, as one page.

    python -m dohyo.agents.ablations                            # prints the page
    python -m dohyo.agents.ablations --out docs/ablations.md

A comparison is decided by claims of studies, which name it by its number. What no stored rows decide says so.
"""

from __future__ import annotations

import argparse
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

from dohyo.agents.studies.claims import Judgement
from dohyo.agents.studies.registry import study_named
from dohyo.agents.studies.tables import anchor, bracketed, probability
from dohyo.evaluation.report.style import MISSING, markdown
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.files import write_atomically

DOCUMENT: Final = Path(__file__).with_suffix(".toml")
THESES: Final[Mapping[str, str]] = {
    "A": "Chekroun 2024: demonstrations in reinforcement learning, tree search, forecasting",
    "B": "Coelho 2024: driving from pictures, few demonstrations",
    "C": "Albilani 2023: localization, parking, rules over options",
}


class Ablation(Config):
    """One comparison of a thesis.

    Attributes:
        number: From 1; claims refer to it.
        thesis: Key in `THESES`.
        system: What is compared.
        asks: The arms.
        told: The thesis's result.
        studies: Names of the studies whose claims decide it.
        tables: Sections that tell it beside claims, as "study:section".
        page: Page of the results, relative to `docs/`.
        found: What is known without claims, or beyond them; "": nothing.
        because: Why we think that it is so; "": nothing to add.
    """

    number: int
    thesis: str
    system: str
    asks: str
    told: str
    studies: tuple[str, ...] = ()
    tables: tuple[str, ...] = ()
    page: str
    found: str = ""
    because: str = ""


@dataclass(frozen=True, slots=True)
class Decided:
    """A comparison and the claims on it that stored rows decide.

    Attributes:
        ablation: The comparison.
        judged: Its claims; empty without stored rows.
    """

    ablation: Ablation
    judged: Sequence[Judgement]

    @property
    def verdict(self) -> str:
        """All claims in a few words, in bold where all have one verdict."""
        counts = Counter(one.verdict for one in self.judged)
        if not counts:
            return "not judged so far"
        if len(counts) == 1:
            (only,) = counts
            return f"**{only}**" + (f", {counts[only]} claims" if counts[only] > 1 else "")
        return ", ".join(
            f"{counts[one]} {one}" for one in ("reproduced", "contradicted", "not resolved") if counts[one]
        )


def ablations() -> list[Ablation]:
    """All comparisons, in the order of their numbers."""
    return [Ablation(**one) for one in tomllib.loads(DOCUMENT.read_text())["ablation"]]


def decided() -> list[Decided]:
    """All comparisons with their verdicts."""
    return [
        Decided(one, [found for name in one.studies for found in _judged(name) if found.claim.ablation == one.number])
        for one in ablations()
    ]


@cache
def _judged(study: str) -> Sequence[Judgement]:
    found = study_named(study)
    return found.judged(found.read(found.stored))


def page(found: Sequence[Decided]) -> str:
    """The page as Markdown: an overview, then every claim by thesis."""
    parts = [_HEAD.format(counts=_counts(found)), _overview(found)]
    for thesis, title in THESES.items():
        parts += [f"## {title}", *(_section(one) for one in found if one.ablation.thesis == thesis)]
    return "\n\n".join(parts) + "\n"


_HEAD: Final = """# What holds of three theses

The theses compare their systems in twenty-nine ablations. They are repeated here in SUMO, on drives, lots and days that no arm was trained on. {counts}

A claim is *reproduced* or *contradicted* if its paired differences are significant over scenarios and trainings. The level is 5 %, after Holm's correction over all claims of its list. A list has all claims of a study; in `ghrl` and `mbappe`, those of one table of the page of results. With three trainings it is a rough one. Of simulated lists of fourteen claims without any difference 2 % had a false verdict where trainings do not differ. Where they differ as much as scenarios do, 22 % had one. Verdicts of three trainings with a p just below 0.05 are thus weak. Intervals are not corrected. It is *not resolved* otherwise, or with fewer than three trainings of a trained arm or six scenarios.

This page is made from stored rows: `python -m dohyo.agents.ablations --out docs/ablations.md`."""  # noqa: E501


def _counts(found: Sequence[Decided]) -> str:
    claims = Counter(one.verdict for each in found for one in each.judged)
    open_ = sum(not each.judged for each in found)
    pooled = sum(map(_pooled, found))
    reproduced, contradicted, unresolved = (claims[one] for one in ("reproduced", "contradicted", "not resolved"))
    return (
        f"Of {claims.total()} claims that stored rows judge, {reproduced} are reproduced, {contradicted} contradicted "
        f"and {unresolved} not resolved. {open_} ablations have no judged claim so far. {pooled} of the claims are "
        "on all drives together, and counted beside the same claims on parts of them."
    )


def _pooled(one: Decided) -> int:
    """Number of claims on all drives whose comparison is also judged on some of them."""
    compared = [(replace(each.claim, where="", told=""), each.claim.where) for each in one.judged]
    parts = {claim for claim, where in compared if where}
    return sum(claim in parts for claim, where in compared if not where)


def _overview(found: Iterable[Decided]) -> str:
    lines = [
        [
            f"[{one.ablation.number}](#{anchor(_heading(one.ablation))})",
            one.ablation.system,
            one.ablation.told,
            one.verdict,
        ]
        for one in found
    ]
    return markdown(["", "system", "the thesis says", "here"], lines)


def _heading(ablation: Ablation) -> str:
    return f"{ablation.number}. {ablation.system}"


def _section(one: Decided) -> str:
    ablation = one.ablation
    told = f"{ablation.asks} The thesis: {ablation.told}"
    lines = [[str(each.claim), _where(each), bracketed(each.difference), _p(each), each.verdict] for each in one.judged]
    table = markdown(["claim", "on", "paired difference", "p (Holm)", "verdict"], lines) if lines else ""
    commands = [_command(name) for name in ablation.studies if _judged(name)]
    links = f"[All results]({ablation.page}). {', '.join(commands if lines else [])}".strip()
    sections = [_table(name) for name in ablation.tables]
    parts = (f"### {_heading(ablation)}", told, table, *sections, ablation.found, ablation.because, links)
    return "\n\n".join(part for part in parts if part)


def _table(name: str) -> str:
    """A section of a study, from its stored rows."""
    study, _, section = name.partition(":")
    found = study_named(study)
    return found.tables[section](found.read(found.stored))


def _command(name: str) -> str:
    """What prints the tables of a study, and with which versions of dohyo its rows were made."""
    study = study_named(name)
    versions = study.read(study.stored).versions
    return f"`python -m dohyo.agents.studies {name} table` (rows of dohyo {' and '.join(versions)})"


def _where(one: Judgement) -> str:
    return ", ".join(part for part in (one.claim.where, one.claim.measure) if part)


def _p(one: Judgement) -> str:
    return f"{MISSING} ({one.too_few})" if one.too_few else probability(one.adjusted)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="file of the page; default: print it")
    given = parser.parse_args(arguments)
    text = page(decided())
    if given.out is None:
        print(text)
    else:
        write_atomically(given.out, text.encode())


if __name__ == "__main__":
    main()
