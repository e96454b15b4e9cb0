"""Tables of the forecasters' study beside the thesis's, and its claims."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product
from typing import Final

import numpy as np

from dohyo.agents.forecasting.data.windows import HORIZON
from dohyo.agents.forecasting.quantiles import Quantiles
from dohyo.agents.forecasting.registry import SIMPLE
from dohyo.agents.studies.claims import Claim, Judgement, of_ablation
from dohyo.agents.studies.crossed_bootstrap import Matched, dense_estimate
from dohyo.agents.studies.rows import matched
from dohyo.agents.studies.study import Results, judging
from dohyo.agents.studies.tables import bracketed, claims_table
from dohyo.evaluation.report.style import MISSING, markdown, number

SETS: Final = ("easy", "hard")
AHEAD: Final = range(1, HORIZON + 1)
NAMES = {"lstm": "LSTM", "convlstm": "ConvLSTM", "sa-convlstm": "SA-ConvLSTM", "transformer": "Transformer"}
NAMES |= {"sa-lstm": "SA-LSTM"}
THESIS_63 = {
    "lstm": (0.66, 5.71, 0.61, 4.09, 0.2),
    "convlstm": (0.63, 5.15, 0.68, 5.13, 3.7),
    "sa-convlstm": (0.72, 4.19, 0.76, 3.94, 4.1),
    "transformer": (0.65, 5.03, 0.64, 4.71, 1.8),
    "sa-lstm": (0.64, 4.52, 0.63, 3.58, 0.5),
}
"""Easy and Hard without Lap3, Easy and Hard with it, ms."""
THESIS_62 = {"easy": (0.64, 0.64, 0.63, 0.63, 0.65), "hard": (4.48, 4.31, 3.94, 3.59, 4.12)}
WAYS = {
    "recursive": ("sa-lstm-lap3", "sa-lstm, 3", ((0.63, 0.83, 1.24), (3.58, 6.51, 10.67)), 1.8),
    "all-at-once": (
        "sa-lstm-all-at-once-lap3", "sa-lstm-all-at-once, 3", ((0.70, 0.82, 0.96), (4.31, 5.58, 7.43)), 0.5
    ),
    "n-step": ("sa-lstm-n-step-lap3", "sa-lstm-n-step, 3", ((0.63, 0.83, 1.03), (3.58, 5.41, 7.56)), 0.9),
}  # fmt: skip


def values(results: Results, arm: str, kind: str, measure: str) -> Matched:
    """A measure of an arm on the days of a set."""
    return matched((row for row in results.rows if row["benchmark"] == kind), arm, measure)


def scale(results: Results) -> str:
    """Data and scale of the study, in a sentence."""
    facts = results.facts
    days, windows = facts["stretches"], facts["windows"]
    sets = ", ".join(f"{name} {days[name]} ({windows[name]:,} windows)".replace(",", " ", 1) for name in days)
    return (
        f"Days, or sets of Hard: {sets}. Seeds {', '.join(map(str, facts['seeds']))}; at most {facts['steps']} steps "
        f"of 256 windows in each phase; {facts['training_s'] / 60:.0f} minutes of one core for all trainings. A "
        f"normalised speed of 1 is {facts['free_kmh']:.1f} km/h. MSE x 10^3 of what was measured; in brackets 95 % "
        "over seeds and days."
    )


def networks(results: Results) -> str:
    """Tables 6.1 and 6.3."""
    rows = []
    for name, thesis in THESIS_63.items():
        ms = results.facts["latency_ms"][f"{name}, 1"]
        times = [f"{thesis[4]}", f"{ms['torch']:.2f}", f"{ms['onnx']:.3f}"]
        for loss, said, shown in (("mse", "no", thesis[:2]), ("lap3", "yes", thesis[2:4])):
            easy, hard = (cell(results, f"{name}-{loss}", kind) for kind in SETS)
            rows.append([NAMES[name], said, f"{shown[0]:.2f}", easy, f"{shown[1]:.2f}", hard, *times])
    for name in ("persistence", "linear", "tsmixer-mse"):
        easy, hard = (cell(results, name, kind) for kind in SETS)
        rows.append([name.removesuffix("-mse"), "no", "", easy, "", hard, "", "", ""])
    head = ["t+1 (tables 6.1, 6.3)", "Lap3", "Easy, thesis", "Easy, ours", "Hard, thesis", "Hard, ours"]
    return markdown([*head, "ms, thesis", "ms, torch", "ms, ONNX"], rows)


def depths(results: Results) -> str:
    """Table 6.2."""
    arms = ["sa-lstm-mse", *(f"sa-lstm-lap{depth}" for depth in range(5)), "sa-lstm-lap3-balanced"]
    rows = []
    for kind, thesis in THESIS_62.items():
        rows.append([f"{kind.capitalize()}, thesis", "", *(f"{one:.2f}" for one in thesis), ""])
        rows.append([f"{kind.capitalize()}, ours", *(cell(results, arm, kind) for arm in arms)])
    head = ["SA-LSTM, t+1 (table 6.2)", "MSE alone", *(f"depth {depth}" for depth in range(5)), "depth 3, balanced"]
    return markdown(head, rows)


def lengths(results: Results) -> str:
    """Whether the loss as printed needs longer training."""
    steps = results.facts["steps"]
    rows = [
        [label, f"{times * steps}", *(cell(results, f"sa-lstm-{loss}{suffix}", kind) for kind in SETS)]
        for loss, label in (("mse", "MSE alone"), ("lap3", "MSE + Lap3"))
        for suffix, times in (("", 1), ("-long", 10))
    ]
    return markdown(["SA-LSTM, t+1", "steps", "Easy, ours", "Hard, ours"], rows)


def ways(results: Results) -> str:
    """Table 6.4."""
    rows = []
    for name, (arm, timed, thesis, thesis_ms) in WAYS.items():
        ms = results.facts["latency_ms"][timed]
        took = f"{thesis_ms} / {ms['torch']:.2f} / {ms['onnx']:.3f}"
        for kind, shown in zip(SETS, thesis, strict=True):
            theirs = " / ".join(f"{one:.2f}" for one in shown)
            for loss, suffix in (("as printed", ""), ("balanced", "-balanced")):
                cells = [cell(results, f"{arm}{suffix}", kind, row) for row in AHEAD]
                rows.append([name, kind.capitalize(), theirs, loss, *cells, took])
    head = ["table 6.4", "set", "thesis: t+1 / 2 / 3", "Lap3", "ours: t+1", "t+2", "t+3"]
    return markdown([*head, "ms: thesis / torch / ONNX"], rows)


def others(results: Results) -> str:
    """Comparison beyond the thesis."""
    shown = ("persistence", "historical-mean", "linear", "tsmixer-mse", "tsmixer-lap3", "sa-lstm-n-step-lap3-balanced")
    rows = []
    for name, kind in product(shown, SETS):
        kmh = [results.facts["free_kmh"] * np.sqrt(_mean(results, name, kind, f"mse_{row}") / 1e3) for row in AHEAD]
        true = [_mean(results, name, kind, f"mse_true_{row}") for row in AHEAD]
        cells = [cell(results, name, kind, row) for row in AHEAD]
        cells += [" / ".join(number(float(one)) for one in some) for some in (kmh, true)]
        rows.append([name.removesuffix("-mse"), kind.capitalize(), *cells])
    head = ["beyond the thesis", "set", "t+1", "t+2", "t+3", "RMSE, km/h, t+1 / 2 / 3"]
    return markdown([*head, "MSE x 10^3 of all vehicles' speed"], rows)


def intervals(results: Results, kinds: Sequence[str] = SETS, arm: str = Quantiles.name) -> str:
    """Coverage of the intervals on some sets: as calibrated and, where rows have it, as they follow the traffic."""
    tracked = any("coverage_tracked_1" in row for row in results.rows)
    told = {"": "as calibrated", "_tracked": "tracked"} if tracked else {"": "as calibrated"}
    rows = []
    for kind, row in product(kinds, AHEAD):
        cells = [
            bracketed(dense_estimate(values(results, arm, kind, f"{measure}{way}_{row}")))
            for way, measure in product(told, ("coverage", "width_kmh"))
        ]
        rows.append([kind.capitalize(), f"t+{row}", *cells])
    heads = [head for name in told.values() for head in (f"{name}: hold, %", "width, km/h")]
    return markdown([f"intervals meant to hold 90 % ({arm})", "row", *heads], rows)


def claims(results: Results) -> str:
    """Verdict on each claim."""
    return verdicts(results, judged(results))


def verdicts(results: Results, found: Sequence[Judgement]) -> str:
    """A row per claim, with the difference as a share of the right arm's error."""

    def shown(one: Judgement) -> str:
        right = _mean(results, one.claim.right, one.claim.where, one.claim.measure)
        apart, n = one.difference, len(one.trainings)
        mean, low, high = (_signed(value or 0.0) for value in (apart.mean, apart.low, apart.high))
        relative = 100.0 * (apart.mean or 0.0) / right
        return f"{mean} [{low}, {high}] ({relative:+.0f} %, {n} seed{'s' * (n > 1)})"

    return claims_table(found, ("claim", "set"), shown, {"set": lambda one: one.claim.where.capitalize()})


def directions() -> Iterator[Claim]:
    """The claims: architectures, the loss, ways to forecast further, and ours; the smaller error is on the left."""
    yield from of_ablation(10, *_architectures())
    yield from of_ablation(11, *_losses())
    yield from of_ablation(12, *_ways())
    ours = f"{WAYS['n-step'][0]}-balanced"
    for kind in SETS:
        for other, arm in (("persistence", "persistence"), ("linear", "linear"), ("TSMixer", "tsmixer-mse")):
            yield Claim(ours, "<", arm, "mse_3", kind, f"ours, not the thesis's: n-step < {other} at t+3, balanced")
    for name in ("convlstm", "sa-convlstm"):
        told = f"ours, not the thesis's: n-step < {NAMES[name]}, a quarter of its steps, at t+3, balanced"
        yield Claim(ours, "<", f"{name}-mse", "mse_3", "easy", told)
    # The n-step's four phases have 800 steps; the longer recursion has 2,000.
    for arm, longer, loss in ((WAYS["n-step"][0], "sa-lstm-lap3-long", ""), (ours, "sa-lstm-mse-long", ", balanced")):
        told = f"ours, not the thesis's: n-step < recursive, 2.5 x its steps, at t+3{loss}"
        yield Claim(arm, "<", longer, "mse_3", "easy", told)


def _architectures() -> Iterator[Claim]:
    rivals = ("lstm", "convlstm", "sa-convlstm", "transformer")
    for name in rivals:
        yield Claim("sa-lstm-mse", "<", f"{name}-mse", "mse_1", "hard", f"SA-LSTM < {NAMES[name]}")
    for name in rivals:
        yield Claim("sa-lstm-mse", "=", f"{name}-mse", "mse_1", "easy", f"SA-LSTM = {NAMES[name]}")


def _losses() -> Iterator[Claim]:
    for name, label in NAMES.items():
        yield Claim(f"{name}-lap3", "<", f"{name}-mse", "mse_1", "hard", f"Lap3 < MSE alone, {label}")
    for kind in ("hard", "easy"):
        told = "Lap3 < MSE alone, SA-LSTM, 10 x the steps"
        yield Claim("sa-lstm-lap3-long", "<", "sa-lstm-mse-long", "mse_1", kind, told)
    for depth in (0, 1, 2, 4):
        yield Claim("sa-lstm-lap3", "<", f"sa-lstm-lap{depth}", "mse_1", "hard", f"depth 3 < depth {depth}")


def _ways() -> Iterator[Claim]:
    for told, suffix in (("", ""), (", balanced", "-balanced")):
        n_step, recursive, at_once = (f"{WAYS[way][0]}{suffix}" for way in ("n-step", "recursive", "all-at-once"))
        for kind in SETS:
            yield Claim(n_step, "=", recursive, "mse_1", kind, f"n-step = recursive at t+1{told}")
            yield Claim(n_step, "<", at_once, "mse_1", kind, f"n-step < all-at-once at t+1{told}")
            yield Claim(n_step, "<", recursive, "mse_3", kind, f"n-step < recursive at t+3{told}")
            yield Claim(at_once, "<", n_step, "mse_3", kind, f"all-at-once <= n-step at t+3{told}")
        yield Claim(n_step, "<", recursive, "mse_2", "hard", f"n-step < recursive at t+2{told}")
        yield Claim(n_step, "<", at_once, "mse_2", "hard", f"n-step < all-at-once at t+2{told}")


judged = judging([*directions()], interval=dense_estimate)


def _mean(results: Results, arm: str, kind: str, measure: str) -> float:
    found = values(results, arm, kind, measure)
    return float(np.mean([value for row in found.values() for value in row.values()]))


def _signed(value: float) -> str:
    return f"{value:+.2f}" if abs(value) >= 0.1 else f"{value:+.3f}"


def cell(results: Results, arm: str, kind: str, row: int = 1) -> str:
    """Mean and interval, with the number of seeds if some are missing."""
    some = values(results, arm, kind, f"mse_{row}")
    if not some:
        return MISSING
    seeds = len({seed for by_seed in some.values() for seed in by_seed})
    few = seeds < len(results.facts["seeds"]) and arm not in SIMPLE
    return bracketed(dense_estimate(some)) + (f" ({seeds} seed{'s' * (seeds > 1)})" if few else "")


def study_section(results: Results) -> str:
    """All tables, with a blank line between them."""
    parts = (scale, networks, depths, lengths, ways, others, intervals, claims)
    return "\n\n".join(part(results) for part in parts)


TABLES: Final[Mapping[str, Callable[[Results], str]]] = {"study": study_section}
