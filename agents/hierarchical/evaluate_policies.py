"""Held-out exercises: evaluation of trained sub-policies, all arms on the same ones. The same command resumes.

    python -m dohyo.agents.hierarchical.evaluate_policies --runs runs/study --policies lights --arms hrl p-10 p-20 \
        --workers 2 --out out/held_out
    python -m dohyo.agents.hierarchical.evaluate_policies --table --out agents/hierarchical/results/held_out

A training chooses its best policy by thirty exercises, too few to compare arms. Here that policy drives others. A line
per exercise goes to OUT/POLICY.jsonl; intervals are those of `crossed`.
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import torch

from dohyo.agents.hierarchical.arms import ARMS, SUB_POLICIES, run_folder
from dohyo.agents.hierarchical.hierarchy import read_sub_policies
from dohyo.agents.hierarchical.manoeuvre_env import ManoeuvreEnv
from dohyo.agents.hierarchical.tasks import ManoeuvreTask
from dohyo.agents.results_page import PAGE, write_section
from dohyo.agents.studies.crossed_bootstrap import Matched, by_training, difference, estimate, of_pairs, verdict
from dohyo.evaluation.report.style import interval, markdown
from dohyo.evaluation.running.lock import held
from dohyo.evaluation.statistics import mean_estimate
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, SimulationError
from dohyo.sumo_networks.files import read_lines, write_atomically
from dohyo.sumo_networks.processes import worker_pool
from dohyo.sumo_networks.seeds import HELD_OUT_FROM

logger = logging.getLogger(__name__)

Line = dict[str, Any]
FIRST = HELD_OUT_FROM + 1000
"""First seed: a training uses at most the thousand seeds before for its own evaluations."""
MEASURES: Final[Mapping[str, str]] = {"return": "return", "success": "success, %", "infraction": "infractions, %"}
PAIRS: Final = (
    ("p-5", "hrl"), ("p-10", "hrl"), ("p-20", "hrl"), ("p-20", "p-5"), ("p-10", "p-10-sum"), ("ghrl", "p-10"),
    ("ghrl", "ghrl-pictures"),
)  # fmt: skip
"""Compared arms."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """A trained sub-policy.

    Attributes:
        policy: Of the manoeuvre.
        arm: Of `ARMS`.
        seed: Of its training.
        folder: Its run.
    """

    policy: str
    arm: str
    seed: int
    folder: Path


def examine(candidate: Candidate, episodes: Sequence[int]) -> list[Line]:
    """Drives exercises without exploration; a line for each that the simulation did not lose.

    Args:
        candidate: The driving policy.
        episodes: Numbers of exercises, from 0.

    Raises:
        InvalidInputError: The candidate is missing or damaged.
    """
    torch.set_num_threads(1)
    trained = read_sub_policies(candidate.folder.parent, (candidate.policy,))
    actor, lines = trained.policies[candidate.policy].actor, []
    exercise = ManoeuvreEnv(ManoeuvreTask(candidate.policy, trained.state, steering=trained.steering))
    try:
        for episode in episodes:
            try:
                found = _drive(exercise, actor, FIRST + episode)
            except SimulationError as error:
                logger.warning("exercise %d is lost, and in no mean: %s", episode, error)
                continue
            lines.append({"arm": candidate.arm, "training_seed": candidate.seed, "episode": episode, **found})
    finally:
        exercise.close()
    return lines


def _drive(exercise: ManoeuvreEnv, actor: torch.nn.Module, seed: int) -> Line:
    state, _ = exercise.reset(seed=seed)
    info: dict[str, Any] = {}
    total, ended = 0.0, False
    while not ended:
        state, reward, terminated, truncated, info = exercise.step(chosen(actor, state))
        total, ended = total + reward, terminated or truncated
    shares = {name: 100.0 * info[name] for name in ("success", "infraction")}
    return {"return": round(total, 3), **shares, "end": info["end"]}


def chosen(actor: torch.nn.Module, state: Float32Array) -> Float32Array:
    """(2,) pedals and steering in [-1, 1], without exploration."""
    with torch.no_grad():
        action: Float32Array = actor(torch.from_numpy(state)[None])[0].numpy()
    return action


def run(out: Path, candidates: Sequence[Candidate], episodes: int, workers: int = 1) -> None:
    """Drives what is not yet in OUT/POLICY.jsonl, and appends it, candidate by candidate.

    Raises:
        InvalidInputError: A candidate is missing or damaged, or another process drives into the same folder.
    """
    for one in candidates:
        read_sub_policies(one.folder.parent, (one.policy,))
    with held(out):
        _go_on(out, candidates, episodes, workers)


def _go_on(out: Path, candidates: Sequence[Candidate], episodes: int, workers: int) -> None:
    driven = {one.policy: read_lines(out / f"{one.policy}.jsonl") for one in candidates}
    for policy, lines in driven.items():  # without a torn last line
        write_atomically(out / f"{policy}.jsonl", "".join(json.dumps(line) + "\n" for line in lines).encode())
    done = {(name, line["arm"], line["training_seed"], line["episode"]) for name in driven for line in driven[name]}
    jobs = {
        one: left
        for one in candidates
        if (left := [n for n in range(episodes) if (one.policy, one.arm, one.seed, n) not in done])
    }
    pool = worker_pool(workers, examine)
    try:
        futures = {pool.submit(examine, one, left): one for one, left in jobs.items()}
        for future in as_completed(futures):
            with (out / f"{futures[future].policy}.jsonl").open("a") as file:
                file.writelines(json.dumps(line) + "\n" for line in future.result())
    finally:
        pool.shutdown(cancel_futures=True)


def tables(results: Mapping[str, Sequence[Line]]) -> str:
    """Results of each arm, and differences between arms, as Markdown.

    Args:
        results: Lines by policy.
    """
    sums = [[policy, arm, *_told(lines, arm)] for policy, lines in results.items() for arm in _arms(lines)]
    pairs = [row for policy, lines in results.items() for row in _pairs(policy, lines)]
    heads = ["policy", "arm", "trainings", *MEASURES.values()]
    found = [markdown(heads, sums)]
    if pairs:
        found.append(markdown(["policy", "difference", "of", "mean", "each training", "significant"], pairs))
    return "\n\n".join(found)


def values(lines: Iterable[Line], arm: str, measure: str) -> Matched:
    """Measure of every exercise driven by an arm's trainings."""
    found: dict[tuple[Any, ...], dict[int | None, float]] = {}
    for line in lines:
        if line["arm"] == arm:
            found.setdefault((line["episode"],), {})[line["training_seed"]] = float(line[measure])
    return found


def _told(lines: Sequence[Line], arm: str) -> Iterator[str]:
    yield ", ".join(str(seed) for seed in by_training(values(lines, arm, "return")))
    for measure in MEASURES:
        yield interval(estimate(values(lines, arm, measure), mean_estimate))


def _pairs(policy: str, lines: Sequence[Line]) -> Iterator[list[str]]:
    for above, below in PAIRS:
        for measure, told in MEASURES.items():
            matched = difference(values(lines, above, measure), values(lines, below, measure))
            if matched:
                found = estimate(matched, of_pairs)
                each = ", ".join(f"{mean:+.0f}" for mean in by_training(matched).values())
                yield [policy, f"{above} - {below}", told, interval(found), each, verdict(found)]


def _arms(lines: Iterable[Line]) -> list[str]:
    there = {line["arm"] for line in lines}
    return [arm for arm in ARMS if arm in there]


def main(arguments: Sequence[str] | None = None) -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, help="folder of ARM/seed-N/POLICY")
    parser.add_argument("--policies", nargs="+", choices=SUB_POLICIES, default=SUB_POLICIES)
    parser.add_argument("--arms", nargs="+", choices=[*ARMS], default=["ghrl", "hrl"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], help="of the trainings")
    parser.add_argument("--episodes", type=int, default=100)
    parser.add_argument("--workers", type=int, default=1, help="processes")
    parser.add_argument("--out", type=Path, default=Path("out/hierarchical/held_out"))
    parser.add_argument("--table", action="store_true", help="print the tables of stored exercises; drive nothing")
    parser.add_argument("--results", metavar="SECTION", help="write the tables into that section of RESULTS.md")
    given = parser.parse_args(arguments)
    if not given.table:
        if given.runs is None:
            raise InvalidInputError("expected --runs, or --table; got neither")
        candidates = [
            Candidate(policy, arm, seed, run_folder(given.runs, arm, seed, policy))
            for policy in given.policies
            for arm in given.arms
            for seed in given.seeds
            if policy in ARMS[arm].policies
        ]
        run(given.out, candidates, given.episodes, given.workers)
    there = {policy: lines for policy in SUB_POLICIES if (lines := read_lines(given.out / f"{policy}.jsonl"))}
    if not there:
        raise InvalidInputError(f"'{given.out}': expected exercises in POLICY.jsonl, found none")
    print(tables(there))
    if given.results:
        write_section(Path(__file__).with_name(PAGE), given.results, tables(there))


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"held_out: {error}")
