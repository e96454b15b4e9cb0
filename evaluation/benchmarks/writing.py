"""Benchmarks of driving written as TOML files with comments, for people to read and to change."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from dohyo.evaluation.benchmarks.benchmark import AutoEvents, Benchmark, Cell, ScriptedMission, TimeLimit
from dohyo.evaluation.output_file import write_output
from dohyo.sumo_networks.config import toml_value
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.scenario import Place, Traffic

_MEANINGS = {
    "headline": "score that ranks agents",
    "rules": "version of the CARLA Leaderboard's penalties",
    "seeds": "each seed drives every mission in other traffic",
    "stop_on_collision": "the first collision ends a drive",
    "time_limit": "time of the route at that speed, and a constant",
    "network": "a name of `dohyo networks list`, or the path of a .net.xml",
    "conditions": "dealt out to the missions in turn",
    "events": "scripted events, other ones for every seed",
}


def write_benchmark(benchmark: Benchmark, path: Path, notes: Mapping[str, str] | None = None) -> Path:
    """Writes a benchmark as TOML, whole or not at all.

    Args:
        benchmark: Benchmark whose missions have neither events of their own nor recorded traffic.
        path: File to write.
        notes: Comments of missions, by their names.

    Raises:
        InvalidInputError: The path does not end in .toml, or cannot be written.
    """
    if path.suffix != ".toml":
        raise InvalidInputError(f"'{path}': expected a .toml file")
    write_output(path, to_toml(benchmark, notes or {}).encode())
    return path


def to_toml(benchmark: Benchmark, notes: Mapping[str, str]) -> str:
    """A benchmark as the text of a TOML file; one with a single cell has the short form."""
    short = [(cell.name, cell.missions) for cell in benchmark.cells] == [("all", "all")]
    lines = [*_head(benchmark), *(_short_cell(benchmark.cells[0]) if short else _cells(benchmark.cells))]
    for name, missions in benchmark.missions.items():
        table = "missions" if short else f"missions.{name}"
        lines += [line for mission in missions for line in _mission(table, mission, notes.get(mission.name))]
    return "\n".join([*lines, ""])


def _head(benchmark: Benchmark) -> Iterator[str]:
    for key in ("name", "description", "headline", "metric", "rules"):
        yield _line(key, getattr(benchmark, key))
    yield _line("seeds", list(benchmark.seeds))
    if benchmark.stop_on_collision:
        yield _line("stop_on_collision", True)
    if benchmark.time_limit:
        yield _line("time_limit", _limit(benchmark.time_limit))


def _short_cell(cell: Cell) -> Iterator[str]:
    yield from (_line(key, value) for key, value in _parts(cell).items())
    yield from ("", "[traffic]")
    yield from (_line(key, value) for key, value in _traffic(cell.traffic).items())


def _cells(cells: Sequence[Cell]) -> Iterator[str]:
    for number, cell in enumerate(cells):
        yield from ("", "[[cells]]", _line("name", cell.name), _line("missions", cell.missions))
        yield from (_line(key, value, explained=number == 0) for key, value in _parts(cell).items())
        yield _line("traffic", _traffic(cell.traffic))


def _parts(cell: Cell) -> dict[str, Any]:
    """Network, conditions and events, so far as they are not the defaults."""
    parts: dict[str, Any] = {"network": cell.network}
    if cell.conditions != Cell.model_fields["conditions"].default:
        parts["conditions"] = list(cell.conditions)
    if cell.events is not None:
        given = cell.events.model_dump(mode="json", exclude_defaults=True)
        parts["events"] = "auto" if cell.events == AutoEvents() else given
    return parts


def _traffic(traffic: Traffic) -> dict[str, Any]:
    return traffic.model_dump(mode="json", exclude_defaults=True)


def _limit(limit: TimeLimit) -> dict[str, Any]:
    return limit.model_dump(mode="json")


def _mission(table: str, mission: ScriptedMission, note: str | None) -> Iterator[str]:
    yield from ("", f"[[{table}]]{f'  # {note}' if note else ''}", _line("name", mission.name))
    for key, place in (("start", mission.start), ("goal", mission.goal)):
        yield _line(key, _place(place))
    if mission.via:
        yield _line("via", list(mission.via))


def _place(place: Place) -> dict[str, Any]:
    return {"lane": place.lane, "position_m": place.position_m}


def _line(key: str, value: Any, explained: bool = True) -> str:
    meaning = f"  # {_MEANINGS[key]}" if explained and key in _MEANINGS else ""
    return f"{key} = {_inline(value)}{meaning}"


def _inline(value: Any) -> str:
    """A value as inline TOML."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {_inline(one)}" for key, one in value.items()) + " }" if value else "{}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return toml_value(value)
