"""Tables of the study beside the thesis's, and a verdict on each of its claims.

    python -m dohyo.agents.forecasting.tables

writes RESULTS.md from the stored results.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from dohyo.agents.forecasting.registry import SIMPLE
from dohyo.agents.forecasting.scores import crossed
from dohyo.agents.forecasting.study import LONG
from dohyo.agents.results_page import PAGE, write_section
from dohyo.evaluation.report.style import MISSING, number
from dohyo.sumo_networks.arrays import FloatArray

RESULTS = Path(__file__).with_name("results") / "study.json"
ENOUGH_SEEDS = 3
Result = Mapping[str, Any]

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


def write_results(result: Result) -> None:
    """Writes the tables into RESULTS.md beside this file."""
    write_section(Path(__file__).with_name(PAGE), "study", markdown(result))


def markdown(result: Result) -> str:
    """All tables, with a blank line between them."""
    return "\n\n".join([scale(result), networks(result), depths(result), lengths(result), ways(result), others(result),
                        intervals(result), claims(result)])  # fmt: skip


def values(
    result: Result, arm: str, kind: str, row: int = 0, measure: str = "mse", seeds: frozenset[int] | None = None
) -> FloatArray:
    """(seeds, stretches) of one set and one row ahead; of all seeds, or of some."""
    runs = [run for run in result["arms"].get(arm, []) if seeds is None or run["seed"] in seeds]
    return np.array([[one[row] for one in run["sets"][kind][measure]] for run in runs])


def scale(result: Result) -> str:
    """Data and scale of the study, in a sentence."""
    days, windows = result["stretches"], result["windows"]
    sets = ", ".join(f"{name} {days[name]} ({windows[name]:,} windows)".replace(",", " ", 1) for name in days)
    seconds = sum(run["seconds"] for runs in result["arms"].values() for run in runs)
    return (
        f"Days, or sets of Hard: {sets}. Seeds {', '.join(map(str, result['seeds']))}; at most {result['steps']} steps "
        f"of 256 windows in each phase; {seconds / 60:.0f} minutes of one core for all trainings. A normalised speed "
        f"of 1 is {result['free_kmh']} km/h. MSE x 10^3 of what was measured; in brackets 95 % over seeds and days."
    )


def networks(result: Result) -> str:
    """Tables 6.1 and 6.3."""
    rows = []
    for name, thesis in THESIS_63.items():
        for loss, shown in (("mse", thesis[:2]), ("lap3", thesis[2:4])):
            arm = f"{name}-{loss}"
            ms = result["latency_ms"][f"{name}, 1"]
            cells = [_cell(result, arm, kind) for kind in ("easy", "hard")]
            rows.append([NAMES[name], "yes" if loss == "lap3" else "no", f"{shown[0]:.2f}", cells[0], f"{shown[1]:.2f}",
                         cells[1], f"{thesis[4]}", f"{ms['torch']:.2f}", f"{ms['onnx']:.3f}"])  # fmt: skip
    for name in ("persistence", "linear", "tsmixer-mse"):
        cells = [_cell(result, name, kind) for kind in ("easy", "hard")]
        rows.append([name.removesuffix("-mse"), "no", "", cells[0], "", cells[1], "", "", ""])
    head = ["t+1 (tables 6.1, 6.3)", "Lap3", "Easy, thesis", "Easy, ours", "Hard, thesis", "Hard, ours"]
    return _table([*head, "ms, thesis", "ms, torch", "ms, ONNX"], rows)


def depths(result: Result) -> str:
    """Table 6.2."""
    rows = []
    for kind, thesis in THESIS_62.items():
        rows.append([f"{kind.capitalize()}, thesis", "", *(f"{one:.2f}" for one in thesis), ""])
        arms = ["sa-lstm-mse", *(f"sa-lstm-lap{depth}" for depth in range(5)), "sa-lstm-lap3-balanced"]
        rows.append([f"{kind.capitalize()}, ours", *(_cell(result, arm, kind) for arm in arms)])
    head = ["SA-LSTM, t+1 (table 6.2)", "MSE alone", *(f"depth {depth}" for depth in range(5)), "depth 3, balanced"]
    return _table(head, rows)


def lengths(result: Result) -> str:
    """Whether the loss as printed needs longer training."""
    rows = [
        [label, shown, *(_cell(result, f"sa-lstm-{loss}{suffix}", kind) for kind in ("easy", "hard"))]
        for loss, label in (("mse", "MSE alone"), ("lap3", "MSE + Lap3"))
        for suffix, shown in (("", f"{result['steps']}"), ("-long", f"{LONG * result['steps']}"))
    ]
    return _table(["SA-LSTM, t+1", "steps", "Easy, ours", "Hard, ours"], rows)


def ways(result: Result) -> str:
    """Table 6.4."""
    rows = []
    for name, (arm, timed, thesis, thesis_ms) in WAYS.items():
        ms = result["latency_ms"][timed]
        for kind, shown in zip(("easy", "hard"), thesis, strict=True):
            theirs = " / ".join(f"{one:.2f}" for one in shown)
            for loss, suffix in (("as printed", ""), ("balanced", "-balanced")):
                cells = [_cell(result, f"{arm}{suffix}", kind, row) for row in range(3)]
                took = f"{thesis_ms} / {ms['torch']:.2f} / {ms['onnx']:.3f}"
                rows.append([name, kind.capitalize(), theirs, loss, *cells, took])
    head = ["table 6.4", "set", "thesis: t+1 / 2 / 3", "Lap3", "ours: t+1", "t+2", "t+3"]
    return _table([*head, "ms: thesis / torch / ONNX"], rows)


def others(result: Result) -> str:
    """Comparison beyond the thesis."""
    rows = []
    shown = ("persistence", "historical-mean", "linear", "tsmixer-mse", "tsmixer-lap3", "sa-lstm-n-step-lap3-balanced")
    for name in shown:
        for kind in ("easy", "hard"):
            cells = [_cell(result, name, kind, row) for row in range(3)]
            runs = result["arms"].get(name, [])
            if not runs:
                continue
            kmh = np.sqrt(np.mean([np.square(run["sets"][kind]["rmse_kmh"]) for run in runs], axis=0))
            true = [values(result, name, kind, row, "mse_true").mean() for row in range(3)] if _has_truth(runs) else []
            cells += [" / ".join(number(float(one)) for one in kmh), " / ".join(number(float(one)) for one in true)]
            rows.append([name.removesuffix("-mse"), kind.capitalize(), *cells])
    head = [
        "beyond the thesis",
        "set",
        "t+1",
        "t+2",
        "t+3",
        "RMSE, km/h, t+1 / 2 / 3",
        "MSE x 10^3 of all vehicles' speed",
    ]
    return _table(head, rows)


def intervals(result: Result) -> str:
    """Coverage of the calibrated intervals."""
    rows = []
    for kind in ("easy", "hard"):
        for row in range(3):
            inside = 100.0 * values(result, "sa-lstm-quantiles", kind, row, "coverage")
            width = values(result, "sa-lstm-quantiles", kind, row, "width_kmh")
            rows.append([kind.capitalize(), f"t+{row + 1}", _interval(inside), _interval(width)])
    return _table(["intervals meant to hold 90 %", "row", "hold, %", "width, km/h"], rows)


def claims(result: Result) -> str:
    """Verdicts on the thesis's directions: the smaller error is on the left."""
    rows = []
    for what, *arms in _directions():
        difference, said = verdict(result, *arms)
        if " = " in what[0]:
            said = "no difference found" if said == "not resolved" else said.replace("reproduced", "contradicted")
        elif what[0].startswith("not the thesis's"):
            said = {"reproduced": "yes", "contradicted": "no"}.get(said.split(",")[0], "not resolved")
        rows.append([*what, difference, said])
    return _table(["direction in the thesis", "set", "ours: difference, x 10^3", "verdict"], rows)


def _directions() -> list[tuple[Any, ...]]:
    """Claim, arm with the smaller error, other arm, set and row."""
    out: list[tuple[Any, ...]] = [
        ((f"SA-LSTM < {NAMES[name]}", "Hard"), "sa-lstm-mse", f"{name}-mse", "hard", 0)
        for name in ("lstm", "convlstm", "sa-convlstm", "transformer")
    ]
    out.append((("SA-LSTM = LSTM", "Easy"), "sa-lstm-mse", "lstm-mse", "easy", 0))
    out += [
        ((f"Lap3 < MSE alone, {label}", "Hard"), f"{name}-lap3", f"{name}-mse", "hard", 0)
        for name, label in NAMES.items()
    ]
    out += [
        ((f"Lap3 < MSE alone, SA-LSTM, {LONG} x the steps", kind.capitalize()), "sa-lstm-lap3-long", "sa-lstm-mse-long",
         kind, 0) for kind in ("hard", "easy")
    ]  # fmt: skip
    out += [
        ((f"depth 3 < depth {depth}", "Hard"), "sa-lstm-lap3", f"sa-lstm-lap{depth}", "hard", 0)
        for depth in (0, 1, 2, 4)
    ]
    for loss, suffix in (("", ""), (", balanced", "-balanced")):
        n_step, recursive, at_once = (f"{WAYS[way][0]}{suffix}" for way in ("n-step", "recursive", "all-at-once"))
        for kind in ("easy", "hard"):
            label = f"{kind.capitalize()}{loss}"
            out.append((("n-step = recursive at t+1", label), n_step, recursive, kind, 0))
            out.append((("n-step < all-at-once at t+1", label), n_step, at_once, kind, 0))
            out.append((("n-step < recursive at t+3", label), n_step, recursive, kind, 2))
            out.append((("all-at-once <= n-step at t+3", label), at_once, n_step, kind, 2))
        out.append((("n-step < recursive at t+2", f"Hard{loss}"), n_step, recursive, "hard", 1))
        out.append((("n-step < all-at-once at t+2", f"Hard{loss}"), n_step, at_once, "hard", 1))
    ours = f"{WAYS['n-step'][0]}-balanced"
    for kind in ("easy", "hard"):
        for other, arm in (("persistence", "persistence"), ("linear", "linear"), ("TSMixer", "tsmixer-mse")):
            out.append(
                ((f"not the thesis's: n-step < {other}, t+3", f"{kind.capitalize()}, balanced"), ours, arm, kind, 2)
            )
    return out


def verdict(result: Result, better: str, worse: str, kind: str, row: int) -> tuple[str, str]:
    """Paired difference better - worse with its interval, and the verdict on the claim."""
    seeds = [frozenset(run["seed"] for run in result["arms"].get(arm, [])) for arm in (better, worse)]
    common = None if worse in SIMPLE else seeds[0] & seeds[1]
    if not seeds[0] or not seeds[1] or (common is not None and not common):
        return MISSING, "not measured"
    left, right = values(result, better, kind, row, seeds=common), values(result, worse, kind, row, seeds=common)
    difference = left - right
    mean, low, high = crossed(difference)
    said = "reproduced" if high < 0.0 else "contradicted" if low > 0.0 else "not resolved"
    if len(difference) < ENOUGH_SEEDS and said != "not resolved":
        said += ", too few seeds"
    relative, n = 100.0 * mean / right.mean(), len(difference)
    return f"{_signed(mean)} [{_signed(low)}, {_signed(high)}] ({relative:+.0f} %, {n} seed{'s' * (n > 1)})", said


def _signed(value: float) -> str:
    return f"{value:+.2f}" if abs(value) >= 0.1 else f"{value:+.3f}"


def _has_truth(runs: Sequence[Mapping[str, Any]]) -> bool:
    return all("mse_true" in one for run in runs for one in run["sets"].values())


def _cell(result: Result, arm: str, kind: str, row: int = 0) -> str:
    """Mean and interval, with the number of seeds if some are missing."""
    some = values(result, arm, kind, row)
    few = 0 < len(some) < len(result["seeds"]) and arm not in SIMPLE
    return _interval(some) + (f" ({len(some)} seed{'s' * (len(some) > 1)})" if few else "")


def _interval(some: FloatArray) -> str:
    if not len(some):
        return MISSING
    mean, low, high = crossed(some)
    return f"{number(mean)} [{number(low)}, {number(high)}]"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


if __name__ == "__main__":
    write_results(json.loads(RESULTS.read_text()))
