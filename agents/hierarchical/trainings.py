"""Trainings: all runs of the study's arms with one command. The same command resumes.

    python -m dohyo.agents.hierarchical.trainings --arms ghrl hrl --seeds 0 1 2 --workers 2 --out runs/study
    python -m dohyo.agents.hierarchical.trainings --arms p-5 p-20 --policies lights --out runs/study --set steps=20000

Each is a run OUT/ARM/seed-N/POLICY as `dohyo train` makes it, in a process of its own; masters come after the
sub-policies that they choose among. `curves` and `study` read that folder.
"""

from __future__ import annotations

import argparse
import json
import signal
import sys
from collections.abc import Generator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from contextlib import closing
from dataclasses import dataclass
from itertools import islice
from multiprocessing import active_children, get_context
from pathlib import Path
from types import FrameType

from dohyo.agents.hierarchical.arms import ARMS, MASTER, POLICIES, config_of, run_folder, trainer_of
from dohyo.agents.learning.registry import TrainRequest
from dohyo.agents.learning.run import RunStoppedError
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError

INTERRUPTED = 130


@dataclass(frozen=True, slots=True)
class Job:
    """One training.

    Attributes:
        runs: Folder of all.
        arm: Of `ARMS`.
        seed: Of the training.
        policy: Trained policy.
        more: Settings on top of the arm's.
    """

    runs: Path
    arm: str
    seed: int
    policy: str
    more: tuple[str, ...] = ()

    @property
    def folder(self) -> Path:
        """Folder of the run."""
        return run_folder(self.runs, self.arm, self.seed, self.policy)

    @property
    def finished(self) -> bool:
        """Whether the training is complete."""
        result = self.folder / "result.json"
        return result.exists() and bool(json.loads(result.read_text())["finished"])


def jobs_of(
    runs: Path, arms: Sequence[str], seeds: Sequence[int], policies: Sequence[str], more: Sequence[str] = ()
) -> list[Job]:
    """Every training of the arms: all seeds of one policy before the next policy.

    Raises:
        InvalidInputError: The arms have none of these policies; a setting does not exist, or its value is wrong.
    """
    found = [
        Job(runs, arm, seed, policy, tuple(more))
        for policy in sorted(policies, key=POLICIES.index)
        for seed in seeds
        for arm in arms
        if policy in ARMS[arm].policies
    ]
    if not found:
        theirs = "; ".join(f"{arm} trains {', '.join(ARMS[arm].policies)}" for arm in arms)
        raise InvalidInputError(f"expected arms that train a policy of {', '.join(policies)}, got none: {theirs}")
    for job in found:
        config_of(job.runs, job.arm, job.seed, job.policy, job.more)
    return found


def train(job: Job) -> Path:
    """Begins or resumes a training.

    Raises:
        RunStoppedError: After SIGINT or SIGTERM; a checkpoint is written.
    """
    config = config_of(job.runs, job.arm, job.seed, job.policy, job.more)
    resume = (job.folder / "config.toml").exists()
    trainer_of(job.policy).train(
        config, TrainRequest(f"hierarchical-{job.policy}", job.folder, resume, lambda report: None)
    )
    return job.folder


def train_all(jobs: Sequence[Job], workers: int) -> None:
    """Trains each in a process of its own, and reports each end; masters begin after all others.

    Raises:
        DohyoError: A training failed; the others of its kind have finished.
    """
    for some in ([job for job in jobs if job.policy != MASTER], [job for job in jobs if job.policy == MASTER]):
        failed: list[DohyoError] = []
        with closing(_trained(some, workers)) as all_ended:
            for ended in all_ended:
                try:
                    print(f"trained: {ended.result()}", flush=True)
                except RunStoppedError:
                    raise
                except DohyoError as error:
                    failed.append(error)
        if failed:
            raise failed[0]


def _trained(jobs: Sequence[Job], workers: int) -> Generator[Future[Path]]:
    """Trainings as they end; no more are submitted than there are workers, since a pool starts all it gets."""
    # A child per job: SUMO and torch's random state are global in a process.
    pool = ProcessPoolExecutor(workers, mp_context=get_context("spawn"), max_tasks_per_child=1)
    waiting, going = iter(jobs), set[Future[Path]]()
    try:
        while going := going | {pool.submit(train, job) for job in islice(waiting, workers - len(going))}:
            done, going = wait(going, return_when=FIRST_COMPLETED)
            yield from done
    finally:
        pool.shutdown()


def _stop(number: int, frame: FrameType | None) -> None:
    """Forwards SIGTERM, which unlike Ctrl-C reaches only this process: the trainings write their checkpoints."""
    for child in active_children():
        child.terminate()
    raise KeyboardInterrupt


def main(arguments: Sequence[str] | None = None) -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--arms", nargs="+", choices=[*ARMS], default=["ghrl", "hrl"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0])
    parser.add_argument("--policies", nargs="+", choices=POLICIES, default=POLICIES, help="default: all of each arm")
    parser.add_argument("--workers", type=int, default=1, help="processes, one core each")
    parser.add_argument("--out", type=Path, default=Path("runs/study"))
    parser.add_argument("--set", nargs="+", dest="more", default=[], metavar="KEY=VALUE", help="of all trainings")
    given = parser.parse_args(arguments)
    jobs = jobs_of(given.out, given.arms, given.seeds, given.policies, given.more)
    signal.signal(signal.SIGTERM, _stop)
    try:
        train_all([job for job in jobs if not job.finished], given.workers)
    except (KeyboardInterrupt, RunStoppedError):
        print("trainings: stopped; the same command goes on", file=sys.stderr)
        sys.exit(INTERRUPTED)
    print(f"all {len(jobs)} trained: {given.out}")


if __name__ == "__main__":
    try:
        main()
    except DohyoError as error:
        sys.exit(f"trainings: {error}")
