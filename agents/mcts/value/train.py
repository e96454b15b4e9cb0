"""Training of the value network on the search's own results, from top to bottom.

    dohyo train value --config agents/mcts/checkpoints/value.toml

Every n-th scene of a motion dataset is searched once, to the horizon. The network learns the best return found from
each state with enough visits. The records are stored beside the result, and made only once.
"""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from pydantic import Field
from safetensors.numpy import save
from torch import Tensor, nn

from dohyo.agents.learning.files.report import Report
from dohyo.agents.learning.runs.run import Run
from dohyo.agents.learning.runs.supervised import FREE, Cosine, Fit, SupervisedConfig, drawn, fit
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.mcts.predictors.dataset import load_shard, shards_of
from dohyo.agents.mcts.value.mlp import FEATURES, WIDTH
from dohyo.agents.mcts.value.records import Records, records_of
from dohyo.agents.planning.scene import Scene
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.files import staged, write_atomically


class ValueConfig(SupervisedConfig):
    """Settings of the training, on a motion dataset.

    Attributes:
        every: Every n-th scene is searched.
        simulations: Per search.
        steps: Updates.
        batch: Records per update.
        learning_rate: At the start; it falls to zero along a cosine.
        weight_decay: Of AdamW.
    """

    every: Annotated[int, Field(gt=0)] = 10
    simulations: Annotated[int, Field(gt=0)] = 1024
    steps: Annotated[int, Field(gt=0)] = 6000
    batch: Annotated[int, Field(gt=0)] = 256
    learning_rate: Annotated[float, Field(gt=0)] = 3e-3
    weight_decay: Annotated[float, Field(ge=0)] = 1e-4


def train(config: ValueConfig, order: TrainRequest) -> Path:
    """Searches, trains, and writes the network with its report; stored records are used again.

    Returns:
        The network's file.

    Raises:
        InvalidInputError: There are no data, or the folder holds another training.
        RunStoppedError: The training was stopped, and has written a checkpoint.
    """
    with closing(Run(order.name, order.out, config, order.resume, FREE)) as run:
        torch.set_num_threads(1)
        torch.manual_seed(config.seed)
        records = {split: searched(config, order.out, split) for split in ("train", "validation")}
        learned = records["train"]
        features, returns = (torch.from_numpy(a).float() for a in (learned.features, learned.returns))
        if not len(returns):
            raise InvalidInputError(f"'{config.data}': expected scenes with states of enough visits, got none")
        mean, scale = features.mean(dim=0), features.std(dim=0).clamp_min(1e-3)
        network = layers()

        def losses(rows: Tensor) -> dict[str, Tensor]:
            told = network((features[rows] - mean) / scale)[:, 0]
            return {"loss": nn.functional.smooth_l1_loss(told, returns[rows])}

        job = Fit(
            network=network,
            optimizer=torch.optim.AdamW(network.parameters(), config.learning_rate, weight_decay=config.weight_decay),
            losses=losses,
            batches=drawn(len(returns), config.batch, config.seed),
            rate=Cosine(config.learning_rate, config.steps),
            steps=config.steps,
        )
        fit(job, run, lambda step, row: order.report(Report(step, config.steps, row["loss"], "loss")))
        out = run.folder / "value.safetensors"
        write_atomically(out, save(weights(network, mean, scale)))
        report = {split: judged(network, some, mean, scale, returns) for split, some in records.items()}
        run.write_json("value.json", report)
        run.write_card("value", VALUE.summary, config.steps, report["validation"], config.data)
    return out


def searched(config: ValueConfig, out: Path, split: str) -> Records:
    """Records of one split, from their file if it exists."""
    path = out / f"records-{split}.npz"
    if not path.exists():
        some = Records.of(records_of(_scenes(config, split), config.simulations))
        with staged(path) as draft, draft.open("wb") as file:
            np.savez_compressed(file, features=some.features, returns=some.returns)
    with np.load(path) as file:
        return Records(file["features"], file["returns"])


def _scenes(config: ValueConfig, split: str) -> list[Scene]:
    shards = [load_shard(path) for path in shards_of(config.data, split)]
    return [shard[i].scene for shard in shards for i in range(0, len(shard), config.every)]


def layers() -> nn.Sequential:
    """The layers of `mlp.Mlp`."""
    return nn.Sequential(nn.Linear(FEATURES, WIDTH), nn.ReLU(), nn.Linear(WIDTH, WIDTH), nn.ReLU(), nn.Linear(WIDTH, 1))


def weights(network: nn.Sequential, mean: Tensor, scale: Tensor) -> dict[str, np.ndarray]:
    """The arrays of `mlp.SHAPES`; the features' normalisation goes into the first layer."""
    arrays = [tensor.detach() for tensor in network.state_dict().values()]
    names = [name for layer in ("first", "second", "last") for name in (layer, f"{layer}_bias")]
    found = dict(zip(names, arrays, strict=True))
    found["first_bias"] = found["first_bias"] - found["first"] @ (mean / scale)
    found["first"] = found["first"] / scale
    return {name: np.ascontiguousarray(array.numpy()) for name, array in found.items()}


def judged(
    network: nn.Sequential, records: Records, mean: Tensor, scale: Tensor, learned_from: Tensor
) -> dict[str, float]:
    """Mean absolute error and share of the variance explained, beside the error of the mean return alone."""
    if not len(records):
        return {"records": 0.0}
    with torch.no_grad():
        told: FloatArray = network((torch.from_numpy(records.features).float() - mean) / scale)[:, 0].double().numpy()
    off, spread = told - records.returns, records.returns - records.returns.mean()
    return {
        "records": float(len(records)),
        "mean_absolute_error": float(np.abs(off).mean()),
        "explained": 1.0 - float((off**2).sum() / max((spread**2).sum(), 1e-9)),
        "mean_absolute_error_of_the_mean": float(np.abs(records.returns - float(learned_from.mean())).mean()),
    }


VALUE = Trainer("value network of MBAPPE, from searches of a motion data set's scenes", ValueConfig, train)
