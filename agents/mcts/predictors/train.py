"""Training of the learned predictor: configuration, data, loss and loop, from top to bottom.

    dohyo train predictor --config agents/mcts/predictors/checkpoints/motion.toml [--resume]

The order of the samples follows from the seed and the epoch, the learning rate from the step, and a checkpoint holds
the network and the optimiser: a training that was killed and resumed ends with the same weights.
"""

from __future__ import annotations

import csv
import io
import json
import math
import time
import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from pydantic import Field, ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor
from torch.nn.functional import smooth_l1_loss

from dohyo.agents.mcts.predictors.dataset import FUTURE_STEPS, Sample, load_shard, shards_of
from dohyo.agents.mcts.predictors.features import AGENTS, SHAPES, features
from dohyo.agents.mcts.predictors.network import MotionNetwork
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import write_atomically

COLUMNS = ("step", "epoch", "loss", "learning_rate", "validation_ade_m", "validation_fde_m", "wall_s")


class TrainConfig(Config):
    """Settings of the training.

    Attributes:
        data: Folder of the motion dataset.
        out: Folder that gets checkpoint.safetensors, predictor.safetensors and log.csv.
        seed: Decides the first weights and the order of the samples.
        steps: Updates.
        batch: Samples per update.
        learning_rate: Highest, after the warm-up.
        warm_up_steps: Steps over which it rises.
        decay_steps: Last steps, over which it falls to zero along a cosine; None: all after the warm-up. A
            training that has not come so far may be resumed with another number of `steps`.
        weight_decay: Of AdamW.
        gradient_norm: Upper bound.
        ego_weight: Weight of the ego, relative to a neighbour.
        heading_m: Metres that an error of one radian counts for.
        validate_every: Steps.
        validation_samples: Samples of the validation split used during training, evenly spread.
        checkpoint_s: Wall-clock time between two checkpoints, s.
        device: Of torch.
        tensorboard: Write the log there, too; needs the tensorboard package.
    """

    data: Path
    out: Path
    seed: Annotated[int, Field(ge=0)] = 0
    steps: Annotated[int, Field(gt=0)] = 2000
    batch: Annotated[int, Field(gt=0)] = 32
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    warm_up_steps: Annotated[int, Field(ge=0)] = 100
    decay_steps: Annotated[int, Field(gt=0)] | None = None
    weight_decay: Annotated[float, Field(ge=0)] = 1e-4
    gradient_norm: Annotated[float, Field(gt=0)] = 1.0
    ego_weight: Annotated[float, Field(gt=0)] = 3.0
    heading_m: Annotated[float, Field(ge=0)] = 2.0
    validate_every: Annotated[int, Field(gt=0)] = 250
    validation_samples: Annotated[int, Field(gt=0)] = 500
    checkpoint_s: Annotated[float, Field(gt=0)] = 300.0
    device: str = "cpu"
    tensorboard: bool = False


def load_config(path: Path) -> TrainConfig:
    """Reads a configuration; relative folders count from where the command runs.

    Raises:
        InvalidInputError: It is missing, no TOML, or holds a wrong field.
    """
    try:
        return TrainConfig.model_validate(tomllib.loads(path.read_text()))
    except OSError as error:
        raise InvalidInputError(f"cannot read '{path}': {error.strerror}") from error
    except tomllib.TOMLDecodeError as error:
        raise InvalidInputError(f"'{path}' is no TOML: {error}") from error
    except ValidationError as error:
        first = error.errors()[0]
        raise InvalidInputError(f"'{path}', {'.'.join(map(str, first['loc']))}: {first['msg']}") from error


@dataclass(frozen=True, slots=True)
class Batch:
    """Samples as tensors.

    Attributes:
        inputs: See `features.SHAPES`, with B in front.
        future: (B, 31, 16, 3) x, y [m], heading [rad]; row 0 is the ego.
        valid: (B, 31, 16) poses that happened and were seen.
    """

    inputs: dict[str, Tensor]
    future: Tensor
    valid: Tensor

    def __len__(self) -> int:
        return len(self.future)

    def rows(self, index: Tensor) -> Batch:
        """Selected samples, without padding that none of them needs."""
        inputs = {name: tensor[index] for name, tensor in self.inputs.items()}
        agents = int(inputs["agents_valid"].sum(dim=1).max())
        lanes = max(int(inputs["lanes_valid"].sum(dim=1).max()), 1)
        for name, tensor in inputs.items():
            inputs[name] = tensor[:, : lanes if name in ("points", "lanes", "lanes_valid") else agents]
        return Batch(inputs, self.future[index, :agents], self.valid[index, :agents])

    def to(self, device: str) -> Batch:
        """Copy on a device."""
        return Batch({k: v.to(device) for k, v in self.inputs.items()}, self.future.to(device), self.valid.to(device))


def load_split(folder: Path, split: str) -> Batch:
    """All samples of a split, in memory."""
    inputs: dict[str, list[np.ndarray]] = {name: [] for name in SHAPES}
    futures, valids = [], []
    for path in shards_of(folder, split):
        for sample in load_shard(path):
            for name, array in features(sample.scene).items():
                inputs[name].append(array)
            future, valid = targets(sample)
            futures.append(future)
            valids.append(valid)
    return Batch(
        {name: torch.from_numpy(np.stack(arrays)) for name, arrays in inputs.items()},
        torch.from_numpy(np.stack(futures)),
        torch.from_numpy(np.stack(valids)),
    )


def targets(sample: Sample) -> tuple[np.ndarray, np.ndarray]:
    """(31, 16, 3) futures, and (31, 16) whether they were seen, in the rows of `features`."""
    future, valid = np.zeros((AGENTS, FUTURE_STEPS, 3), np.float32), np.zeros((AGENTS, FUTURE_STEPS), np.bool_)
    future[0], valid[0] = sample.ego_future, sample.ego_future_valid
    seen = min(len(sample.actors_future), AGENTS - 1)
    future[1 : seen + 1], valid[1 : seen + 1] = sample.actors_future[:seen], sample.actors_future_valid[:seen]
    return future, valid


def loss_of(poses: Tensor, batch: Batch, config: TrainConfig) -> Tensor:
    """Mean error over all poses that were seen, m: Huber's of the position, and of the heading's chord.

    Args:
        poses: (B, A, 16, 3) predicted.
        batch: The true futures.
        config: Gives the weights.
    """
    place = smooth_l1_loss(poses[..., :2], batch.future[..., :2], reduction="none").sum(dim=-1)
    turn = 1.0 - torch.cos(poses[..., 2] - batch.future[..., 2])
    weight = batch.valid.to(place.dtype)
    weight[:, 0] *= config.ego_weight
    loss: Tensor = ((place + config.heading_m * turn) * weight).sum() / weight.sum().clamp_min(1.0)
    return loss


def displacement(poses: Tensor, batch: Batch) -> tuple[Tensor, Tensor]:
    """Mean displacement over the poses seen, and at 8 s, of every agent seen for 8 s, m."""
    error = torch.linalg.vector_norm(poses[..., :2] - batch.future[..., :2], dim=-1)
    whole = batch.valid.all(dim=-1)
    return error[whole].mean(dim=-1), error[whole][:, -1]


def train(
    config: TrainConfig, resume: bool = False, progress: Callable[[int, float], None] = lambda step, loss: None
) -> Path:
    """Trains, and writes the predictor.

    Args:
        config: How.
        resume: Continue from the checkpoint in the output folder.
        progress: Called with every step and its loss.

    Returns:
        The predictor's file.

    Raises:
        InvalidInputError: There are no data, or no checkpoint of the same configuration.
    """
    checkpoint = config.out / "checkpoint.safetensors"
    if checkpoint.exists() and not resume:
        raise InvalidInputError(f"'{checkpoint}' exists; continue with --resume, or choose another folder")
    torch.set_num_threads(1)
    torch.manual_seed(config.seed)
    data, validation = load_split(config.data, "train"), load_split(config.data, "validation").to(config.device)
    network = MotionNetwork().to(config.device)
    optimiser = torch.optim.AdamW(network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    config.out.mkdir(parents=True, exist_ok=True)
    step = load_checkpoint(checkpoint, network, optimiser, config) if resume else 0
    log = Log(config, keep=step)
    began = saved = time.monotonic()
    while step < config.steps:
        for group in optimiser.param_groups:
            group["lr"] = learning_rate(step, config)
        batch = data.rows(batch_indices(step, len(data), config)).to(config.device)
        loss = loss_of(network(**batch.inputs), batch, config)
        optimiser.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(network.parameters(), config.gradient_norm)
        optimiser.step()
        step += 1
        progress(step, loss.item())
        measured = validate(network, validation, config) if step % config.validate_every == 0 else None
        if measured or step % 10 == 0 or step == config.steps:
            epoch = step * config.batch / len(data)
            log.add(step, epoch, loss.item(), optimiser.param_groups[0]["lr"], measured, time.monotonic() - began)
        if time.monotonic() - saved >= config.checkpoint_s or step == config.steps:
            save_checkpoint(checkpoint, network, optimiser, config, step)
            log.write()
            saved = time.monotonic()
    out = config.out / "predictor.safetensors"
    write_atomically(out, save({k: v.contiguous() for k, v in network.state_dict().items()}, {"steps": str(step)}))
    return out


def learning_rate(step: int, config: TrainConfig) -> float:
    """Learning rate: rises, stays, then falls to zero along a cosine."""
    if step < config.warm_up_steps:
        return config.learning_rate * (step + 1) / config.warm_up_steps
    first = _decays_from(config)
    share = max(step - first, 0) / max(config.steps - first, 1)
    return 0.5 * config.learning_rate * (1.0 + math.cos(math.pi * share))


def _decays_from(config: TrainConfig) -> int:
    """The first step whose learning rate depends on how many there are."""
    return config.warm_up_steps if config.decay_steps is None else max(config.steps - config.decay_steps, 0)


def batch_indices(step: int, size: int, config: TrainConfig) -> Tensor:
    """Samples of a step: every epoch shuffles them, and leaves out an incomplete batch."""
    batch = min(config.batch, size)
    epoch, place = divmod(step, size // batch)
    order = np.random.default_rng([config.seed, epoch]).permutation(size)
    return torch.from_numpy(order[place * batch : (place + 1) * batch])


def validate(network: MotionNetwork, data: Batch, config: TrainConfig) -> tuple[float, float]:
    """Mean and final displacement over part of the validation split, m."""
    index = torch.linspace(0, len(data) - 1, min(config.validation_samples, len(data))).long()
    errors = []
    with torch.no_grad():
        for part in torch.split(index, config.batch):
            batch = data.rows(part)
            errors.append(displacement(network(**batch.inputs), batch))
    mean, final = (torch.cat(parts).mean() for parts in zip(*errors, strict=True))
    return float(mean), float(final)


def save_checkpoint(
    path: Path, network: MotionNetwork, optimiser: torch.optim.Optimizer, config: TrainConfig, step: int
) -> None:
    """Writes a checkpoint atomically."""
    tensors = {f"network.{name}": tensor for name, tensor in network.state_dict().items()}
    for number, state in optimiser.state_dict()["state"].items():
        tensors |= {f"optimiser.{number}.{name}": torch.as_tensor(value) for name, value in state.items()}
    facts = {"step": str(step), "config": _fingerprint(config, step)}
    write_atomically(path, save({name: tensor.contiguous() for name, tensor in tensors.items()}, facts))


def load_checkpoint(path: Path, network: MotionNetwork, optimiser: torch.optim.Optimizer, config: TrainConfig) -> int:
    """Puts a checkpoint into network and optimiser, and returns its step.

    Raises:
        InvalidInputError: The checkpoint is missing, damaged, or of another configuration.
    """
    try:
        with safe_open(path, "pt", device=config.device) as file:
            facts = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
    except FileNotFoundError as error:
        raise InvalidInputError(f"no checkpoint '{path}' to continue") from error
    except (OSError, SafetensorError) as error:
        raise InvalidInputError(f"checkpoint '{path}' is damaged: {error}") from error
    if facts.get("config") != _fingerprint(config, int(facts.get("step", 0))):
        raise InvalidInputError(f"checkpoint '{path}' is of another configuration: {facts.get('config')}")
    try:
        network.load_state_dict({k[8:]: v for k, v in tensors.items() if k.startswith("network.")})
    except RuntimeError as error:
        raise InvalidInputError(f"checkpoint '{path}' is of another network: {str(error).splitlines()[0]}") from error
    state: dict[int, dict[str, Tensor]] = {}
    for name, tensor in tensors.items():
        if name.startswith("optimiser."):
            _, number, key = name.split(".", 2)
            state.setdefault(int(number), {})[key] = tensor
    optimiser.load_state_dict({"state": state, "param_groups": optimiser.state_dict()["param_groups"]})
    return int(facts["step"])


class Log:
    """log.csv, and optionally TensorBoard."""

    def __init__(self, config: TrainConfig, keep: int) -> None:
        self._path = config.out / "log.csv"
        self._rows: list[list[str]] = []
        if keep and self._path.exists():
            rows = list(csv.reader(self._path.read_text().splitlines()))[1:]
            self._rows = [row for row in rows if int(row[0]) <= keep]
        self._board: Any = _board(config) if config.tensorboard else None

    def add(
        self, step: int, epoch: float, loss: float, rate: float, measured: tuple[float, float] | None, wall_s: float
    ) -> None:
        """Adds one row."""
        ade, fde = (f"{value:.4f}" for value in measured) if measured else ("", "")
        self._rows.append([str(step), f"{epoch:.3f}", f"{loss:.6f}", f"{rate:.3e}", ade, fde, f"{wall_s:.1f}"])
        if self._board is not None:
            self._board.add_scalar("loss", loss, step)
            for name, value in zip(("validation_ade_m", "validation_fde_m"), measured or (), strict=False):
                self._board.add_scalar(name, value, step)

    def write(self) -> None:
        """Writes all rows so far."""
        buffer = io.StringIO()
        csv.writer(buffer, lineterminator="\n").writerows([COLUMNS, *self._rows])
        write_atomically(self._path, buffer.getvalue().encode())


def _board(config: TrainConfig) -> Any:
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError as error:
        raise InvalidInputError("tensorboard = true needs the tensorboard package") from error
    return SummaryWriter(str(config.out / "tensorboard"))


def _fingerprint(config: TrainConfig, step: int) -> str:
    """Part of a configuration that decides the weights after some steps."""
    out = {"out", "checkpoint_s", "tensorboard", "validate_every", "validation_samples"}
    if step <= _decays_from(config):
        out |= {"steps", "decay_steps"}
    return json.dumps(config.model_dump(mode="json", exclude=out), sort_keys=True)
