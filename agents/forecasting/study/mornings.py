"""Study `forecasting-mornings`: the thesis's comparisons on Hard, learned from mornings of the same traffic.

    dohyo dataset freeway --days 0 --easy 0 --hard 12 --mornings 28 --out DIR
    python -m dohyo.agents.studies forecasting-mornings run --set data=DIR
    python -m dohyo.agents.studies forecasting-mornings table --write

The study `forecasting` learns from days in meso, so that its Hard asks for a transfer between traffic models, too. Here
all arms have equal numbers of updates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final, Literal

from dohyo.agents.forecasting.quantiles import Quantiles
from dohyo.agents.forecasting.study import study
from dohyo.agents.forecasting.study.arms import PHASES
from dohyo.agents.forecasting.study.tables import (
    AHEAD,
    NAMES,
    THESIS_62,
    THESIS_63,
    WAYS,
    cell,
    intervals,
    scale,
    verdicts,
)
from dohyo.agents.studies.claims import Claim, of_ablation
from dohyo.agents.studies.crossed_bootstrap import dense_estimate
from dohyo.agents.studies.study import Results, judging
from dohyo.evaluation.report.style import markdown

HARD: Final = "hard"
SHIPPED: Final = {"n-step, as shipped": "sa-lstm-n-step-shipped"}
"""It learned from days in meso."""
SIMPLE: Final = {"persistence": "persistence", "linear": "linear", "TSMixer": f"tsmixer-mse-x{PHASES}"}


class Options(study.Options):
    """Options of a run: see `study.Options`."""

    models: Path = Path("out/forecasting-mornings")
    learn: Literal["mornings"] = "mornings"


def equal(arm: str) -> str:
    """The arm of a forecaster with one phase that has as many updates as the n-step, which has its own name."""
    return arm if arm.startswith("sa-lstm-n-step") else f"{arm}-x{PHASES}"


def networks(results: Results) -> str:
    """Tables 6.1 and 6.3 on Hard."""
    rows = []
    for name, thesis in THESIS_63.items():
        mse, lap3 = (cell(results, equal(f"{name}-{loss}"), HARD) for loss in ("mse", "lap3"))
        rows.append([NAMES[name], f"{thesis[1]:.2f}", mse, f"{thesis[3]:.2f}", lap3])
    rows += [[told, "", cell(results, arm, HARD), "", ""] for told, arm in SIMPLE.items()]
    return markdown(["Hard, t+1", "thesis", "ours", "thesis, Lap3", "ours, Lap3"], rows)


def depths(results: Results) -> str:
    """Table 6.2 on Hard."""
    arms = ["sa-lstm-mse", *(f"sa-lstm-lap{depth}" for depth in range(5)), "sa-lstm-lap3-balanced"]
    rows = [["thesis", "", *(f"{one:.2f}" for one in THESIS_62[HARD]), ""]]
    rows.append(["ours", *(cell(results, equal(arm), HARD) for arm in arms)])
    heads = [*(f"depth {depth}" for depth in range(5)), "depth 3, balanced"]
    return markdown(["SA-LSTM, Hard, t+1", "MSE alone", *heads], rows)


def ways(results: Results) -> str:
    """Table 6.4 on Hard, and forecasters beyond the thesis."""
    rows = []
    for name, (arm, _, thesis, _) in WAYS.items():
        for loss, suffix in (("Lap3 as printed", ""), ("balanced", "-balanced")):
            cells = [cell(results, equal(f"{arm}{suffix}"), HARD, row) for row in AHEAD]
            rows.append([name, loss, " / ".join(f"{one:.2f}" for one in thesis[1]), *cells])
    for told, arm in (SIMPLE | SHIPPED).items():
        rows.append([told, "", "", *(cell(results, arm, HARD, row) for row in AHEAD)])
    return markdown(["Hard", "loss", "thesis: t+1 / 2 / 3", *(f"ours: t+{row}" for row in AHEAD)], rows)


def claims() -> Iterator[Claim]:
    """The thesis's claims on Hard, and ours; the smaller error is on the left."""
    yield from of_ablation(10, *_architectures())
    yield from of_ablation(11, *_losses())
    yield from of_ablation(12, *_ways())
    ours = f"{WAYS['n-step'][0]}-balanced"
    for told, arm in (SIMPLE | SHIPPED).items():
        yield Claim(ours, "<", arm, "mse_3", HARD, f"ours, not the thesis's: n-step < {told} at t+3, balanced")


def _architectures() -> Iterator[Claim]:
    for name in ("lstm", "convlstm", "sa-convlstm", "transformer"):
        left, right = equal("sa-lstm-mse"), equal(f"{name}-mse")
        yield Claim(left, "<", right, "mse_1", HARD, f"SA-LSTM < {NAMES[name]}")


def _losses() -> Iterator[Claim]:
    for name, label in NAMES.items():
        left, right = equal(f"{name}-lap3"), equal(f"{name}-mse")
        yield Claim(left, "<", right, "mse_1", HARD, f"Lap3 < MSE alone, {label}")
    for depth in (0, 1, 2, 4):
        left, right = equal("sa-lstm-lap3"), equal(f"sa-lstm-lap{depth}")
        yield Claim(left, "<", right, "mse_1", HARD, f"depth 3 < depth {depth}")


def _ways() -> Iterator[Claim]:
    for told, suffix in (("", ""), (", balanced", "-balanced")):
        n_step, recursive, at_once = (
            equal(f"{WAYS[way][0]}{suffix}") for way in ("n-step", "recursive", "all-at-once")
        )
        yield Claim(n_step, "=", recursive, "mse_1", HARD, f"n-step = recursive at t+1{told}")
        for row in AHEAD[1:]:
            yield Claim(n_step, "<", recursive, f"mse_{row}", HARD, f"n-step < recursive at t+{row}{told}")
        for row in AHEAD[:2]:
            yield Claim(n_step, "<", at_once, f"mse_{row}", HARD, f"n-step < all-at-once at t+{row}{told}")
        yield Claim(at_once, "<", n_step, "mse_3", HARD, f"all-at-once <= n-step at t+3{told}")


judged = judging([*claims()], interval=dense_estimate)


def section(results: Results) -> str:
    """All tables, with a blank line between them; empty without rows."""
    if not results.rows:
        return ""
    parts = (scale(results), networks(results), depths(results), ways(results))
    ends = (intervals(results, (HARD,), f"{Quantiles.name}{suffix}") for suffix in ("", "-shipped"))
    return "\n\n".join((*parts, *ends, verdicts(results, judged(results))))


STUDY: Final = replace(
    study.STUDY,
    summary="forecasters on congested mornings, learned from mornings of the same traffic",
    options=Options,
    tables={"mornings": section},
    judged=judged,
    published="mornings",
)
