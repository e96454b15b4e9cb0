"""The tables of a study as Markdown."""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from dohyo.agents.mcts.losses import CAUSES
from dohyo.evaluation.statistics import Estimate

EXCERPTS: Mapping[str, str] = MappingProxyType(
    {"score": "score", "collisions": "CR, %", "off_road": "DA, %", "progress": "EP, %"}
)
"""Columns of drives that end after a time: metric and head."""

ROUTES: Mapping[str, str] = MappingProxyType(
    {
        "nocrash_success": "NoCrash success, %",
        "driving_score": "DS",
        "route_completion": "RC, %",
        "perfect": "perfect, %",
        "hits": "hit somebody, %",
        "collisions": "at fault, %",
        "out_of_time": "out of time, %",
    }
)
"""Columns of drives that end at the goal."""

PLANNERS = ("autopilot", "mbappe", "pdm-closed")
"""Planners whose lost points are listed by cause."""


def tables(document: Mapping[str, Any]) -> str:
    """The study as Markdown: one row per arm, one per claim, one per cause of failures."""
    columns = EXCERPTS if document["benchmark"].startswith("val14") else ROUTES
    theirs = document["benchmark"] == "val14" and any(arm["thesis"] is not None for arm in document["arms"].values())
    heads = ["arm", *columns.values(), *(["thesis"] if theirs else []), "n"]
    rows = [_row(name, arm, columns, theirs) for name, arm in document["arms"].items()]
    lines = [f"On {_what(document)}:", "", f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *rows]
    if document["claims"]:
        lines += ["", "| claim | metric | paired difference | n | verdict |", "|---" * 5 + "|"]
    for claim in document["claims"]:
        difference = Estimate(**claim["difference"]) if claim["difference"] else Estimate(None, None, None, 0)
        lines.append(
            f"| {claim['above']} > {claim['below']} | {columns.get(claim['metric'], claim['metric'])} | "
            f"{shown(difference)} | {difference.n} | {claim['verdict']} |"
        )
    return "\n".join([*lines, *_lost(document["arms"])])


def _lost(arms: Mapping[str, Any]) -> list[str]:
    """Points that the planners lost, by cause."""
    planners = [name for name in PLANNERS if name in arms]
    causes = [cause for cause in CAUSES if any(cause in arms[name]["lost"] for name in planners)]
    if not causes:
        return []
    lines = ["", f"| points lost (in drives) | {' | '.join(planners)} |", "|---" * (1 + len(planners)) + "|"]
    for cause in causes:
        cells = [arms[name]["lost"].get(cause) for name in planners]
        told = ["0" if cell is None else f"{cell[0]:.1f} ({cell[1]})" for cell in cells]
        lines.append(f"| {CAUSES[cause]} | {' | '.join(told)} |")
    return lines


def _what(document: Mapping[str, Any]) -> str:
    half = "" if document["part"] == "all" else f", part `{document['part']}`"
    half += f", {document['per_type']} of each type" if document["per_type"] else ""
    return f"`{document['benchmark']}`{half}" + (f", cells `{document['cells']}`" if document["cells"] else "")


def _row(name: str, arm: Mapping[str, Any], columns: Mapping[str, str], theirs: bool) -> str:
    found = [Estimate(**arm["metrics"][metric]) for metric in columns]
    thesis = ["" if arm["thesis"] is None else f"{arm['thesis']}"] if theirs else []
    return f"| {' | '.join([name, *map(shown, found), *thesis, str(found[0].n)])} |"


def section(document: Mapping[str, Any]) -> str:
    """The section of RESULTS.md that holds the tables of a study."""
    return " ".join(part for part in (document["benchmark"], document["cells"]) if part)


def shown(estimate: Estimate) -> str:
    """Mean with its interval, if there is one."""
    if estimate.mean is None:
        return ""
    if estimate.low is None or estimate.high is None or not math.isfinite(estimate.mean):
        return f"{estimate.mean:.1f}"
    return f"{estimate.mean:.1f} [{estimate.low:.1f}, {estimate.high:.1f}]"
