"""Training loop shared by all learners: rounds, evaluations, checkpoints, and a run's files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
from tensordict import TensorDict

from dohyo.agents.learning.experience.collector import Collector
from dohyo.agents.learning.experience.explorers import Explorers
from dohyo.agents.learning.experience.ray_worker import RayWorker, connect_to
from dohyo.agents.learning.files.card import WEIGHTS, read_card, weights_of
from dohyo.agents.learning.files.checkpoint import random_state, restore_random_state
from dohyo.agents.learning.files.metrics import Number
from dohyo.agents.learning.files.report import Report, Reporter, no_report
from dohyo.agents.learning.files.settings import read_settings
from dohyo.agents.learning.policies.exact_export import export_exact
from dohyo.agents.learning.policies.export import Exportable
from dohyo.agents.learning.runs.config import RunConfig
from dohyo.agents.learning.runs.evaluation import columns_of, evaluate
from dohyo.agents.learning.runs.off_policy_config import OffPolicyRunConfig
from dohyo.agents.learning.runs.run import FREE, Run, RunStoppedError, Stop, TaskRun
from dohyo.agents.learning.runs.trainer import TrainRequest
from dohyo.agents.learning.tasks.environments import check_environments
from dohyo.agents.learning.tasks.task import Array, Environments, Task, check_task, named
from dohyo.sumo_networks.envs.worker_process import WorkerProcess
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

C = TypeVar("C", bound=Collector | Explorers)


class Learner(Protocol):
    """Learner. Its randomness comes from torch's global generator, or from generators in its state."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Columns of metrics.csv, beside "steps"."""

    @property
    def updates(self) -> int:
        """Gradient steps so far."""

    @property
    def policy(self) -> Exportable:
        """Module that is shipped."""

    def begin(self) -> None:
        """What comes before the first round of a run, such as the imitation of an expert."""

    def round(self) -> Mapping[str, Number]:
        """Takes the steps of one `Collector.round`, and learns; row of metrics.csv, with "return" if episodes ended."""

    def act(self, observation: TensorDict) -> Array:
        """Observations by name (N,) -> (N, ...) actions, without exploration and without any change of its state."""

    def state(self) -> dict[str, Any]:
        """State for a checkpoint, as tensors and plain values; the collector has its own."""

    def restore(self, state: Mapping[str, Any]) -> None:
        """Restores a state."""


MakeLearner = Callable[[Collector, TaskRun], Learner]
"""Makes the learner of a run, on its device and in its folder."""
MakeOffPolicyLearner = Callable[[Collector | Explorers, TaskRun], Learner]
"""The same of a learner that may learn from the steps of explorers."""


def train_task(make_learner: MakeLearner, task: Task, settings: RunConfig, request: TrainRequest) -> Path:
    """Trains in the folder that a request names; what a trainer of `dohyo train` does.

    Args:
        make_learner: See `MakeLearner`.
        task: What is learned.
        settings: Of the run.
        request: Names folder and report.

    Returns:
        The best policy's weights.

    Raises:
        InvalidInputError: The folder holds another run, or one that has taken more steps; or the task cannot be used,
            or not so many of its environments in one process.
        RunStoppedError: See `train`.
        SimulationError: See `train`.
    """
    columns_of(task)  # refuses names that another column has, before there is a folder
    if task.alone and not settings.processes and settings.environments > 1:
        raise InvalidInputError(
            f"task '{task.name}': a process can hold only one of its environments: expected processes of at least 1 "
            f"for environments = {settings.environments}, got 0"
        )
    return _in_folder(lambda run: train(make_learner, task, run, request.report), settings, request)


def train_off_policy(
    make_learner: MakeOffPolicyLearner, task: Task, settings: OffPolicyRunConfig, request: TrainRequest
) -> Path:
    """The same with explorers, if the settings have some; see `Explorers`.

    Raises:
        InvalidInputError: As from `train_task`; or there is no such cluster, or nobody for it.
    """
    if not settings.explorers:
        if settings.cluster:
            raise InvalidInputError(f"cluster = '{settings.cluster}': expected explorers of at least 1, got 0")
        return train_task(make_learner, task, settings, request)
    if settings.cluster:
        connect_to(settings.cluster)  # before anything is written
    explorers = partial(_explorers, task, settings)
    return _in_folder(lambda run: _train(explorers, make_learner, task, run, request.report), settings, request)


def train(make_learner: MakeLearner, task: Task, run: TaskRun, report: Reporter = no_report) -> dict[str, Number]:
    """Trains until the run's steps are done, from its checkpoint if there is one.

    A run that was killed at any moment, and resumed, equals one that was not, to the bit, on the same machine: a
    checkpoint falls on a number of steps, and all running episodes are cut there.

    Args:
        make_learner: See `MakeLearner`.
        task: What is learned.
        run: Its folder and configuration.
        report: Called after every round.

    Returns:
        The last row of evaluations.csv.

    Raises:
        InvalidInputError: The task cannot be used, or the run has taken more steps.
        RunStoppedError: After SIGINT or SIGTERM; the last checkpoint is where the run goes on.
        SimulationError: Simulations fail again and again.
    """
    return _train(partial(_collector, task, run.config), make_learner, task, run, report)


def _in_folder(train_in: Callable[[TaskRun], object], settings: RunConfig, request: TrainRequest) -> Path:
    run = Run(request.name, request.out, settings, request.resume, FREE | {"cluster"})
    try:
        train_in(run)
    finally:
        run.close()
    return run.folder / "best.safetensors"


def _collector(task: Task, config: RunConfig, open_: ExitStack) -> Collector:
    environments = task.make_environments(config.processes or config.environments, processes=config.processes > 0)
    open_.callback(environments.close)
    check_environments(environments)
    return Collector(environments, task, config.seed, config.begin_after)


def _explorers(task: Task, config: OffPolicyRunConfig, open_: ExitStack) -> Explorers:
    make_worker = partial(RayWorker, config.cluster) if config.cluster else WorkerProcess
    explorers = Explorers(task, config.seed, config.explorers, config.stretch, make_worker)
    open_.callback(explorers.close)
    return explorers


def _train(
    open_collector: Callable[[ExitStack], C],
    make_learner: Callable[[C, TaskRun], Learner],
    task: Task,
    run: TaskRun,
    report: Reporter,
) -> dict[str, Number]:
    check_task(task)
    _check_steps(run)
    torch.set_num_threads(1)
    torch.manual_seed(run.config.seed)
    with ExitStack() as open_:
        collector = open_collector(open_)
        held_out = task.make_environments(task.judged_at_once, processes=run.config.processes > 0 or task.alone)
        open_.callback(held_out.close)
        session = _Session(run, task, make_learner(collector, run), collector, held_out)
        with Stop().listening() as stop:
            return session.train(stop, report)


def _check_steps(run: TaskRun) -> None:
    """Raises InvalidInputError if the steps of a resumed run are lowered below those that it has taken."""
    if run.config.steps >= run.steps_before:
        return
    # A run may end a few steps beyond its own number, with a round; that number stays valid.
    if run.config.steps < read_settings(type(run.config), run.folder / "config.toml").steps:
        raise InvalidInputError(
            f"the run in '{run.folder}' has taken {run.steps_before} steps: "
            f"expected steps of at least {run.steps_before}, got {run.config.steps}"
        )


class _Session:
    """Training from its present state to its end."""

    def __init__(
        self,
        run: TaskRun,
        task: Task,
        learner: Learner,
        collector: Collector | Explorers,
        held_out: Environments,
    ) -> None:
        self._run, self._task, self._learner = run, task, learner
        self._collector, self._held_out = collector, held_out
        self._last_return: float | None = None
        self._saved = run.steps_before
        # Rows of evaluations.csv with their "steps": the last one, and that of the best policy.
        self._last: dict[str, Number] = {}
        self._best: dict[str, Number] = {}

    def train(self, stop: Stop, report: Reporter) -> dict[str, Number]:
        """See `train` of the module."""
        run, total = self._run, self._run.config.steps
        run.add_table("metrics", self._learner.columns)
        # An evaluation at the checkpoint's own step may be later than it, and is then repeated.
        evaluated = int(run.state["last"].get("steps", -1)) if run.state is not None else None
        run.add_table("evaluations", columns_of(self._task), evaluated)
        run.add_table("timing", ("wall_s", "steps_per_s"))
        self._start()
        while True:
            if self._evaluation_due():
                self._evaluate(stop)
            if self._collector.steps >= total:
                break
            self._round(report)
            if self._collector.cut:
                self._save()
            if stop.requested:
                raise self._stopped()
        self._save()
        self._write_result(finished=True)
        return self._last

    def _start(self) -> None:
        state = self._run.state
        if state is None:
            self._learner.begin()
            return
        self._collector.restore(state["collector"])
        self._learner.restore(state["learner"])
        self._last, self._best = state["last"], state["best"]
        self._put_back(state.get("best_files"))
        self._write_result(finished=False)
        restore_random_state(state["random"])  # last: the calls above draw from it

    def _put_back(self, files: Mapping[str, torch.Tensor] | None) -> None:
        """Puts back the policies that a checkpoint knows where the folder has those of later steps.

        The later steps may not come again: the run may have fewer of them now, or another machine.
        """
        folder, steps = self._run.folder, self._collector.steps
        if not _has_model(folder, "best", self._best.get("steps")):
            for name, content in (files or {}).items():
                write_atomically(folder / name, content.numpy().tobytes())
            if files:
                self._write_card("best", self._best)
            elif steps < self._run.config.steps:  # a checkpoint of dohyo 0.2.0 has no files
                self._best = {}  # the policy of the next evaluation is the best
        if steps == self._last.get("steps") and not _has_model(folder, "policy", steps):
            self._ship(best=False)

    def _round(self, report: Reporter) -> None:
        run, began, before = self._run, self._run.wall_s, self._collector.steps
        every = run.config.checkpoint_every
        self._collector.cut_at = min((before // every + 1) * every, run.config.steps)
        row = self._learner.round()
        steps, elapsed = self._collector.steps, max(run.wall_s - began, 1e-9)
        run.log("metrics", steps, row)
        run.log("timing", steps, {"wall_s": run.wall_s, "steps_per_s": (steps - before) / elapsed})
        self._last_return = row["return"] if row.get("return") is not None else self._last_return
        report(Report(steps, run.config.steps, self._last_return))

    def _evaluation_due(self) -> bool:
        config, steps = self._run.config, self._collector.steps
        before = int(self._last.get("steps") or 0) if self._last else -1
        return steps // config.evaluate_every > before // config.evaluate_every or before < config.steps <= steps

    def _evaluate(self, stop: Stop) -> None:
        """Drives the held-out episodes without any change of the learner's state."""
        steps = self._collector.steps
        try:
            evaluation = evaluate(self._task, self._held_out, self._learner.act, lambda: stop.requested)
        except RunStoppedError as error:
            raise self._stopped() from error
        row = {"updates": self._learner.updates, **evaluation.values()}
        self._run.log("evaluations", steps, row)
        self._last = {"steps": steps, **row}
        best = not self._best or evaluation.better_than(self._best, self._run.config.best_by)
        self._best = self._last if best else self._best
        self._ship(best)
        self._write_result(finished=False)

    def _ship(self, best: bool) -> None:
        """Writes the policy of the last evaluation as `policy`, and as `best` where none was better, with cards."""
        folder, spaces = self._run.folder, (named(self._task.observation_space), self._task.action_space)
        export_exact(self._learner.policy, spaces, folder / "policy", self._facts(self._last))
        for suffix in WEIGHTS if best else ():
            write_atomically(folder / f"best{suffix}", (folder / f"policy{suffix}").read_bytes())
        for model in ("policy", "best") if best else ("policy",):
            self._write_card(model, self._last)

    def _write_card(self, model: str, evaluation: Mapping[str, Number]) -> None:
        metrics = {name: value for name, value in evaluation.items() if name != "steps"}
        self._run.write_card(model, self._task.name, int(evaluation["steps"] or 0), metrics)

    def _save(self) -> None:
        self._saved = self._collector.steps
        self._run.save(
            self._saved,
            {
                "collector": self._collector.state(),
                "learner": self._learner.state(),
                "last": self._last,
                "best": self._best,
                "best_files": self._best_files(),
                "random": random_state(),
            },
        )

    def _best_files(self) -> dict[str, torch.Tensor]:
        """Bytes of the best policy's files, by name; none where somebody has removed or replaced them."""
        folder = self._run.folder
        names = weights_of(folder, "best") if _has_model(folder, "best", self._best.get("steps")) else ()
        return {name: torch.frombuffer(bytearray((folder / name).read_bytes()), dtype=torch.uint8) for name in names}

    def _stopped(self) -> RunStoppedError:
        kept = f"the checkpoint of step {self._saved}" if self._saved else "step 0, since there is no checkpoint yet"
        return RunStoppedError(f"stopped at step {self._collector.steps}; it will go on from {kept}")

    def _facts(self, evaluation: Mapping[str, Number]) -> dict[str, str]:
        """Facts about the training that every result holds."""
        run = self._run
        names = ("steps", "updates", "return", "return_low", "return_high", "success")
        numbers = {name: "" if (value := evaluation[name]) is None else f"{value:.6g}" for name in names}
        numbers |= {name: str(evaluation[name]) for name in ("steps", "updates")}
        origin = {"trainer": run.trainer, "task": self._task.name, "seed": run.config.seed, "tier": run.config.tier}
        return numbers | {name: str(value) for name, value in origin.items()} | {"device": str(run.device)}

    def _write_result(self, finished: bool) -> None:
        run = self._run
        self._run.write_json(
            "result.json",
            {
                "trainer": run.trainer,
                "task": self._task.name,
                "finished": finished,
                "steps": self._collector.steps,
                "updates": self._learner.updates,
                "episodes": self._collector.finished_count,
                "lost": self._collector.lost_count,
                "seed": run.config.seed,
                "device": str(run.device),
                "tier": run.config.tier,
                "wall_s": round(run.wall_s, 1),
                "last": self._last,
                "best": self._best,
            },
        )


def _has_model(folder: Path, model: str, steps: Number) -> bool:
    """Whether the files of a model in a folder are those of its card, and have been trained for so many steps."""
    try:
        return all(read_card(folder / f"{model}{suffix}").steps == steps for suffix in WEIGHTS)
    except (InvalidInputError, OSError):
        return False
