"""Manifest: what a result folder says of itself."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, ValidationError

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.records.foreign_files import read_limited
from dohyo.evaluation.records.record import AgentInfo
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.faults import describe_fault
from dohyo.sumo_networks.scenario import Config

MANIFEST = "evaluation.json"
RECORDS = "records"
MANIFEST_LIMIT_BYTES = 50_000_000


class ResultManifest(Config):
    """Description of a result folder.

    Attributes:
        agent: Description of the agent.
        benchmark: Whole benchmark, so that the folder needs no other file; each family of benchmarks has its type.
        benchmark_sha256: Content hash of the benchmark.
    """

    agent: AgentInfo
    benchmark: Any
    benchmark_sha256: str


AnyManifest = TypeVar("AnyManifest", bound=ResultManifest)


class Manifest(ResultManifest):
    """Description of a result folder of drives. In a mixed run, `agent` drives all missions but those of `others`.

    Attributes:
        others: Agents of single missions, by the name of the mission; empty: `agent` drives all of them.
        missions: Names of the scenarios that are driven; None: all of the benchmark.
        seeds: Seeds that were ordered, by all runs into the folder; None: unknown, in folders of before.
    """

    benchmark: Benchmark
    others: dict[str, AgentInfo] = Field(default_factory=dict, exclude_if=lambda agents: not agents)
    missions: Annotated[tuple[str, ...] | None, Field(min_length=1, exclude_if=lambda names: names is None)] = None
    seeds: Annotated[tuple[int, ...] | None, Field(exclude_if=lambda seeds: seeds is None)] = None

    def agent_of(self, mission: str) -> AgentInfo:
        """Agent that drives a mission."""
        return self.others.get(mission, self.agent)

    @property
    def part(self) -> str:
        """What is to be driven of the benchmark, in words for people; "" if everything is."""
        return self.part_where(0, 0)

    def part_where(self, done: int, ordered: int) -> str:
        """What is there of the benchmark, in words for people; "" if everything is.

        Args:
            done: Number of episodes with a record.
            ordered: Number of all episodes that were ordered, see `count_ordered`.
        """
        words = []
        if self.missions is not None:
            words.append(f"{len(self.missions)} of {self.benchmark.size} missions")
        if done < ordered:
            words.append(f"{done} of {ordered} episodes")
        return f"part of {self.benchmark.name}: {', '.join(words)}" if words else ""

    def count_ordered(self, found: Iterable[int]) -> int:
        """Number of episodes that were ordered; the seeds of those found were ordered, too.

        Args:
            found: Seeds of the records in the folder.
        """
        missions = self.benchmark.size if self.missions is None else len(self.missions)
        return missions if self.benchmark.excerpts else missions * len({*(self.seeds or ()), *found})

    def with_seeds_of(self, earlier: Manifest) -> Manifest:
        """The manifest with the seeds that an earlier run into the folder ordered before its own."""
        seeds = tuple(dict.fromkeys((*(earlier.seeds or ()), *(self.seeds or ()))))
        return self.model_copy(update={"seeds": seeds or None})


def manifest_of(
    infos: Mapping[str, AgentInfo],
    benchmark: Benchmark,
    benchmark_sha256: str,
    missions: tuple[str, ...] | None = None,
    seeds: Iterable[int] | None = None,
) -> Manifest:
    """Manifest of a run.

    Args:
        infos: Agent of each mission, by its name in the benchmark's order; the first one becomes `agent`.
        benchmark: Benchmark.
        benchmark_sha256: Its content hash.
        missions: Names of the scenarios that are driven; None: all of the benchmark.
        seeds: Seeds that are ordered; None: unknown.
    """
    first, *_ = infos.values()
    return Manifest(
        agent=first,
        others={name: info for name, info in infos.items() if info != first},
        benchmark=benchmark,
        benchmark_sha256=benchmark_sha256,
        missions=missions,
        seeds=None if seeds is None else tuple(dict.fromkeys(seeds)),
    )


def read_manifest(out: Path) -> Manifest:
    """Reads the manifest of a result folder.

    Raises:
        InvalidInputError: It is none, or its benchmark has another content hash.
    """
    path = out / MANIFEST
    if not path.exists():
        raise InvalidInputError(f"'{out}' is no result folder: expected {MANIFEST} in it (dohyo evaluate --out)")
    return parse_manifest(read_limited(path, "a manifest", MANIFEST_LIMIT_BYTES), str(path), Manifest)


def parse_manifest(content: bytes, path: str, kind: type[AnyManifest]) -> AnyManifest:
    """Parses the content of a result folder's manifest.

    Args:
        content: Content of the file.
        path: Name of the file in messages.
        kind: Its type: drives, parking lots or freeway mornings.

    Raises:
        InvalidInputError: It is no such manifest, or its benchmark has another content hash.
    """
    try:
        manifest = kind.model_validate_json(content)
    except ValidationError as error:
        raise InvalidInputError(f"{path}: {describe_fault(error, kind)}") from error
    if manifest.benchmark_sha256 != manifest.benchmark.sha256:
        raise InvalidInputError(f"{path}: expected benchmark_sha256 {manifest.benchmark.sha256}, got another hash")
    return manifest


def manifest_of_record(path: Path) -> Manifest | None:
    """Manifest of the result folder in which a record lies; None outside one.

    Raises:
        InvalidInputError: As for `read_manifest`.
    """
    folder = path.absolute().parent.parent
    return read_manifest(folder) if (folder / MANIFEST).exists() else None


def part_of_record(path: Path) -> str:
    """Part of the benchmark that was driven with a record, see `Manifest.part_where`; "" outside a result folder."""
    manifest = manifest_of_record(path)
    if manifest is None:
        return ""
    stems = [one.stem for one in (path.absolute().parent.parent / RECORDS).glob("*.json")]
    seeds = {int(seed) for stem in stems if (seed := stem.rpartition("-s")[2]).isdecimal()}
    return manifest.part_where(len(stems), manifest.count_ordered(seeds))
