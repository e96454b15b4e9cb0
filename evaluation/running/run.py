"""run_benchmark: one agent, or one for each ego, on a benchmark or a part of it; resumable at any moment."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dohyo.evaluation.agent import agent_info, close_agent, make_agent
from dohyo.evaluation.agent_files import note_files
from dohyo.evaluation.benchmarks.benchmark import Benchmark, load_benchmark
from dohyo.evaluation.benchmarks.part import select
from dohyo.evaluation.benchmarks.traffic_logs import prepare_logs
from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S
from dohyo.evaluation.episode.runner import versions
from dohyo.evaluation.families import OtherFamilyError
from dohyo.evaluation.records.record import AgentInfo, EpisodeRecord, Kind
from dohyo.evaluation.records.store import read_whole_record
from dohyo.evaluation.running.executors import Executor, ProcessPool
from dohyo.evaluation.running.job import Job
from dohyo.evaluation.running.lock import held
from dohyo.evaluation.running.manifest import MANIFEST, RECORDS, Manifest, manifest_of, read_manifest
from dohyo.evaluation.running.membership import check_agents, check_members
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Scenario

REST = "*"
"""Name for all missions of a mixed run that have no agent of their own."""


@dataclass(frozen=True, slots=True)
class Result:
    """Agents on one benchmark.

    Attributes:
        manifest: Manifest with the agents and the benchmark.
        records: Records, one per scenario and seed, in the benchmark's order.
        paths: Paths of the records, in the same order.
        resumed: Number of records that an earlier run had finished.
        ordered: Number of episodes that were ordered; those without a record are not driven yet, or lack their files.
    """

    manifest: Manifest
    records: tuple[EpisodeRecord, ...]
    paths: tuple[Path, ...]
    resumed: int
    ordered: int

    @property
    def part(self) -> str:
        """What was driven of the benchmark, in words for people; "" if everything was."""
        done = {(record.scenario.name, record.scenario.seed) for record in self.records}
        return self.manifest.part_where(len(done), self.ordered)


def run_benchmark(
    benchmark: str | Benchmark,
    agents: str | Mapping[str, AgentInfo],
    *,
    settings: Mapping[str, Any] | None = None,
    kind: Kind = "local",
    seeds: Sequence[int] | None = None,
    only: Sequence[str] = (),
    sample: int | None = None,
    out: Path,
    executor: Executor | None = None,
    act_deadline_s: float = ACT_DEADLINE_S,
    progress: Callable[[EpisodeRecord | None, int, int], None] = lambda record, done, total: None,
    preparing: Callable[[int, int], None] = lambda done, total: None,
    reverse: bool = False,
    note: Callable[[str], None] = lambda text: None,
) -> Result:
    """Evaluates agents; a second call with the same arguments drives only the missing episodes.

    A call with more missions than the last one, such as a larger sample or the whole benchmark, completes the results.

    Args:
        benchmark: Benchmark, or its name, or the path of a .toml file.
        agents: "module:Class" of the agent; in a mixed run the agent of each mission by its name, and that of all
            other missions under `REST`.
        settings: Keyword arguments of the constructor of "module:Class".
        kind: Origin of "module:Class", for its records.
        seeds: Seeds to drive; by default those of the benchmark.
        only: Names or patterns of the cells and missions to drive, see `part.select`; empty: all.
        sample: Number of missions to draw from those; None: all.
        out: Folder of the results.
        executor: Executor of the episodes; by default one worker process.
        act_deadline_s: Wall-clock time allowed for one decision, s.
        progress: Function called with each finished record (None at the start), the number done, and the total.
        preparing: Function called while missing logs are made, with the number done and the total.
        reverse: Whether to drive the scenarios in reverse order; the records are the same.
        note: Function called with one line for each file among the settings that the records do not name.

    Raises:
        InvalidInputError: An unknown name, an agent that cannot be made, a mission that cannot be driven, or a folder
            that another process uses, or that holds another evaluation, or missions that are not among those to drive.
            Nothing has been written then. Or a record cannot be written; those of finished episodes stay, and a second
            call continues.
    """
    if isinstance(benchmark, str):
        benchmark = load_benchmark(benchmark)
    given = {REST: _described(agents, settings, kind, benchmark, note)} if isinstance(agents, str) else agents
    seeds = seeds if seeds is not None else benchmark.seeds
    everything = benchmark.scenarios(seeds)
    infos = assign(given, (mission.name for scenario in everything for mission in scenario.missions))
    scenarios = select(everything, only, sample)
    missions = tuple(dict.fromkeys(scenario.name for scenario in scenarios))
    part = missions if len(missions) < benchmark.size else None
    with held(out, read_only=True):
        manifest = _claim(out, manifest_of(infos, benchmark, benchmark.sha256, part, seeds))
        stems = [f"{scenario.name}-s{scenario.seed}" for scenario in scenarios]
        finished = _finished(out, stems, scenarios, manifest, infos)
        resumed = len(finished)
        todo = [scenario for scenario, stem in zip(scenarios, stems, strict=True) if stem not in finished]
        prepare_logs(todo, benchmark.reference_agent, getattr(executor, "workers", None) or 1, preparing)
        progress(None, resumed, len(scenarios))
        jobs = [
            Job(
                scenario,
                {mission.name: infos[mission.name] for mission in scenario.missions},
                (benchmark.name, manifest.benchmark_sha256),
                out / RECORDS,
                stem,
                act_deadline_s,
            )
            for scenario, stem in zip(scenarios, stems, strict=True)
            if stem not in finished
        ]
        for record in (executor or ProcessPool()).run(jobs[::-1] if reverse else jobs):
            finished[f"{record.scenario.name}-s{record.scenario.seed}"] = record
            progress(record, len(finished), len(scenarios))
        return Result(
            manifest=manifest,
            records=tuple(finished[stem] for stem in stems),
            paths=tuple(out / RECORDS / f"{stem}.json" for stem in stems),
            resumed=resumed,
            ordered=len(scenarios),
        )


def read_result(out: Path) -> Result:
    """Reads the evaluation in a result folder.

    Raises:
        InvalidInputError: The folder is not a result folder, or has a damaged record, or one that is not of its
            benchmark or of its agents.
    """
    manifest = read_manifest(out)
    found = [(read_whole_record(path), path) for path in sorted((out / RECORDS).glob("*.json"))]
    if not found:
        raise InvalidInputError(f"'{out}' holds no finished episode yet")
    check_members(found, manifest.benchmark, manifest.benchmark_sha256)
    check_agents(found, manifest)
    order = {scenario.name: i for i, scenario in enumerate(manifest.benchmark.scenarios([0]))}
    found.sort(key=lambda pair: (pair[0].scenario.seed, order[pair[0].scenario.name]))
    records, paths = zip(*found, strict=True)
    ordered = manifest.count_ordered(record.scenario.seed for record in records)
    return Result(manifest, records, paths, len(records), ordered)


def assign(agents: Mapping[str, AgentInfo], missions: Iterable[str]) -> dict[str, AgentInfo]:
    """Agent of each mission.

    Args:
        agents: Agents by the name of the mission; that of `REST` drives all missions without one.
        missions: Names of all missions of the benchmark; a name may come again.

    Raises:
        InvalidInputError: A mission has no agent, or an agent is for a mission that does not exist.
    """
    names = list(dict.fromkeys(missions))
    if unknown := [name for name in agents if name not in names and name != REST]:
        raise InvalidInputError(
            f"agent of '{unknown[0]}': expected a mission of the benchmark: {', '.join(names[:20])}"
        )
    if missing := [name for name in names if name not in agents and REST not in agents]:
        raise InvalidInputError(f"expected an agent for each mission, got none for {', '.join(missing[:20])}")
    return {name: agents[name] if name in agents else agents[REST] for name in names}


def describe_driver(
    entry: str, settings: Mapping[str, Any] | None, kind: Kind, note: Callable[[str], None]
) -> AgentInfo:
    """Description of an agent that drives; it is made for it. Files that it does not name are noted.

    Raises:
        InvalidInputError: The agent cannot be made.
        OtherFamilyError: It does not drive cars.
    """
    agent = make_agent(entry, settings)
    try:
        note_files(agent, settings, note)
        return agent_info(agent, entry, settings, kind)
    finally:
        close_agent(agent)


def _described(
    entry: str,
    settings: Mapping[str, Any] | None,
    kind: Kind,
    benchmark: Benchmark,
    note: Callable[[str], None],
) -> AgentInfo:
    try:
        return describe_driver(entry, settings, kind, note)
    except OtherFamilyError as error:
        raise InvalidInputError(f"benchmark '{benchmark.name}': {error}") from error


def _claim(out: Path, manifest: Manifest) -> Manifest:
    """Writes the manifest, unless the existing one says the same; returns it with the seeds of all runs."""
    if (out / MANIFEST).exists():
        there = read_manifest(out)
        _check_continues(out, there, manifest)
        manifest = manifest.with_seeds_of(there)
        if (there.missions, there.seeds) == (manifest.missions, manifest.seeds):
            return manifest
    try:
        out.mkdir(parents=True, exist_ok=True)
        write_atomically(out / MANIFEST, manifest.model_dump_json(indent=1).encode())
    except OSError as error:
        raise InvalidInputError(f"cannot write results to '{out}': {error.strerror}") from error
    return manifest


def _check_continues(out: Path, there: Manifest, manifest: Manifest) -> None:
    """Refuses to continue results of another benchmark or agent, or results that have other missions as well."""
    if there.benchmark_sha256 != manifest.benchmark_sha256:
        raise InvalidInputError(
            f"'{out}' holds benchmark {there.benchmark.name} {there.benchmark_sha256[:8]}, not "
            f"{manifest.benchmark.name} {manifest.benchmark_sha256[:8]}; choose another --out"
        )
    if there.agent != manifest.agent or there.others != manifest.others:
        raise InvalidInputError(
            f"'{out}' holds agent '{there.agent.name}' as it was before its code or settings changed, or other "
            "agents; choose another --out"
        )
    if manifest.missions is None:
        return
    if there.missions is None:
        raise InvalidInputError(f"'{out}' holds the whole of {there.benchmark.name}, not a part; choose another --out")
    if others := [name for name in there.missions if name not in manifest.missions]:
        raise InvalidInputError(
            f"'{out}' holds {there.part}, among them {others[0]}, which is not among the {len(manifest.missions)} to "
            "drive now; choose another --out, or missions that include those"
        )


def _finished(
    out: Path,
    stems: Sequence[str],
    scenarios: Sequence[Scenario],
    manifest: Manifest,
    infos: Mapping[str, AgentInfo],
) -> dict[str, EpisodeRecord]:
    """Records whose episodes need not be driven again: whole, of this run and version, and not lost to the machine.

    Records may be older than the manifest, which somebody may have removed: what they say of themselves decides.
    """
    now = {name: versions(load_network(name)) for name in manifest.benchmark.networks}
    label, found = (manifest.benchmark.name, manifest.benchmark_sha256), dict[str, EpisodeRecord]()
    for stem, scenario in zip(stems, scenarios, strict=True):
        path = out / RECORDS / f"{stem}.json"
        if not path.exists() or (record := _usable(path)) is None:
            continue
        lost = any(ego.status.worth_another_try for ego in record.egos)
        same_world = (record.scenario, record.versions) == (scenario, now[scenario.network])
        if not lost and same_world and record.benchmark == label and _drove(record, infos):
            found[stem] = record
    return found


def _drove(record: EpisodeRecord, infos: Mapping[str, AgentInfo]) -> bool:
    """Whether the agents of this run drove all egos of a record."""
    return all(ego.agent == infos.get(ego.name) for ego in record.egos)


def _usable(path: Path) -> EpisodeRecord | None:
    try:
        return read_whole_record(path)
    except InvalidInputError:
        return None
