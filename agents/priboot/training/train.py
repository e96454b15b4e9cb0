"""Training of PRIBOOT: configuration, data, loss and loop, from top to bottom.

    dohyo dataset priboot --out out/priboot/demonstrations
    dohyo train priboot --config agents/priboot/configs/priboot.toml --out out/priboot/full [--resume]

A training may begin from the weights of another, and tune the trunk, too.

Source: Coelho 2024, section 5.3: L1 loss of the waypoints, Adam, half of the samples displaced, the speed's loss
with a weight of 0.05. It has batches of 256, and a rate of 1e-4 and a decay of 1e-7 for the whole network; ours are for
the head alone, and the decay is that of AdamW.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import closing
from pathlib import Path
from typing import Annotated

import numpy as np
import torch
from pydantic import Field
from safetensors import SafetensorError
from safetensors.torch import load_file
from torch import Tensor

from dohyo.agents.learning.files.report import Report
from dohyo.agents.learning.policies.exact_export import export_running
from dohyo.agents.learning.runs.config import Share
from dohyo.agents.learning.runs.run import Run
from dohyo.agents.learning.runs.supervised import FREE, Cosine, Fit, SupervisedConfig, fit, shuffled
from dohyo.agents.learning.runs.trainer import Trainer, TrainRequest
from dohyo.agents.priboot.fixed_point import ExactPriboot
from dohyo.agents.priboot.measurements import SPEED, SPEED_SCALE, TARGET, TARGET_M, TARGET_SCALE
from dohyo.agents.priboot.network import PictureKind, Priboot
from dohyo.agents.priboot.training.seen import Seen, seen_of
from dohyo.agents.priboot.training.views import Split, load_split
from dohyo.sumo_networks.errors import InvalidInputError

MEASURES = ("validation_loss", "displaced_loss", "validation_ade_m", "starts", "false_starts")
STANDS_M_S, GOES_M, STARTS_M, STAYS_M = 0.3, 2.0, 1.0, 0.1
"""Speed of an ego that stands; how far ahead the last waypoint is where the expert goes, the network starts, and the
expert stays."""
STRAIGHT_M, ASIDE_M = 1.5, 0.5
"""How far the route 30 m ahead is from straight on, and the expert in two seconds from that."""


class TrainConfig(SupervisedConfig):
    """Settings of the training, on recorded demonstrations.

    Attributes:
        added: Folders of further moments to learn from, such as those after takeovers; they validate nothing.
        steps: Updates.
        batch: Moments per update.
        learning_rate: Highest, after the warm-up; then it falls to zero along a cosine.
        warm_up_steps: Steps over which it rises.
        weight_decay: Of AdamW.
        gradient_norm: Upper bound.
        displaced: Share of the moments that are seen from a displaced pose; 0: no augmentation.
        speed_weight: Weight of the speed's loss.
        share: Of the drives.
        leaving: How often a moment counts in which the expert leaves a straight way, since these are one in thirty.
        starting: The same where it does so from a standstill, since these are one in several hundred.
        picture: What the trunk reads: colours, with ImageNet's weights, or masks, from scratch.
        tuned: Whether the trunk of colours learns, too; that of masks always does.
        begin: Weights of another training of such a network to begin from, a .safetensors file; None: none.
        validate_every: Steps.
        validation_moments: Number used during training, evenly spread.
    """

    added: tuple[Path, ...] = ()
    steps: Annotated[int, Field(gt=0)] = 3000
    batch: Annotated[int, Field(gt=0)] = 128
    learning_rate: Annotated[float, Field(gt=0)] = 1e-3
    warm_up_steps: Annotated[int, Field(ge=0)] = 100
    weight_decay: Annotated[float, Field(ge=0)] = 1e-2
    gradient_norm: Annotated[float, Field(gt=0)] = 5.0
    displaced: Share = 0.5
    speed_weight: Annotated[float, Field(ge=0)] = 0.05
    share: Annotated[float, Field(gt=0, le=1)] = 1.0
    leaving: Annotated[int, Field(gt=0)] = 1
    starting: Annotated[int, Field(gt=0)] = 1
    picture: PictureKind = "colours"
    tuned: bool = False
    begin: Path | None = None
    validate_every: Annotated[int, Field(gt=0)] = 500
    validation_moments: Annotated[int, Field(gt=0)] = 3000
    device: str = "cpu"


def losses_of(
    network: Priboot, seen: tuple[Tensor, Tensor], measurements: Tensor, waypoints: Tensor, weight: float
) -> dict[str, Tensor]:
    """Parts of the loss, and their weighted sum.

    Args:
        network: Its head learns.
        seen: See `Seen`.
        measurements: (B, 11).
        waypoints: (B, 4, 2) those of the expert, m.
        weight: Of the speed's loss.

    Returns:
        "waypoints": sum of the absolute errors of the four waypoints' coordinates [m]; "speed" and "loss".
    """
    points, speed = network.head(*seen, measurements)
    apart = (points - waypoints).abs().sum((1, 2)).mean()
    told = (speed - measurements[:, SPEED]).abs().mean()
    return {"loss": apart + weight * told, "waypoints": apart, "speed": told}


def train(config: TrainConfig, order: TrainRequest) -> Path:
    """Trains, and writes the policy.

    Returns:
        The ONNX file.

    Raises:
        InvalidInputError: There are no data or no weights to begin from, or the folder holds another training.
        RunStoppedError: The training was stopped, and has written a checkpoint.
    """
    with closing(Run(order.name, order.out, config, order.resume, FREE | {"validation_moments"})) as run:
        torch.set_num_threads(1)
        torch.manual_seed(config.seed)
        moments, held_out = load_split(config.data, "train", config.added), load_split(config.data, "validation")
        network = network_of(config)
        seen, held_out_seen = (seen_of(network, config.data, some) for some in (moments, held_out))
        chosen = some_drives(moments, config)
        index = torch.linspace(0, len(held_out) - 1, min(config.validation_moments, len(held_out))).long()

        def losses(rows: Tensor) -> Mapping[str, Tensor]:
            moment = chosen[rows]
            view = (torch.rand(rows.shape) < config.displaced).long()
            at = (moment, view)
            numbers, points = moments.measurements[at], moments.waypoints[at]
            return losses_of(network, seen(moments.row[at]), numbers, points, config.speed_weight)

        job = Fit(
            network=network,
            optimizer=torch.optim.AdamW(
                [parameter for parameter in network.parameters() if parameter.requires_grad],
                lr=config.learning_rate,
                weight_decay=config.weight_decay,
            ),
            losses=losses,
            batches=shuffled(len(chosen), config.batch, config.seed),
            rate=Cosine(config.learning_rate, config.steps, config.warm_up_steps),
            steps=config.steps,
            validate=lambda: validate(network, held_out, held_out_seen, index, config),
            validate_every=config.validate_every,
            gradient_norm=config.gradient_norm,
            columns=("loss", "waypoints", "speed", *MEASURES),
        )
        measures = fit(job, run, lambda step, row: order.report(Report(step, config.steps, row["loss"], "loss")))
        facts = {"steps": str(config.steps)}
        export_running(network, ExactPriboot(network), network.space(), run.folder / "priboot", facts)
        measures = {**measures, "moments": len(np.unique(chosen.numpy())), "leaving": int(leaves(moments).sum())}
        run.write_card("priboot", PRIBOOT.summary, config.steps, measures, config.data / "train")
        return run.folder / "priboot.onnx"


def network_of(config: TrainConfig) -> Priboot:
    """The network before the first step.

    Raises:
        InvalidInputError: The file to begin from is missing, or of another network.
    """
    network = Priboot(config.picture)
    if config.begin is not None:
        try:
            network.load_state_dict(load_file(config.begin))
        except (OSError, SafetensorError, RuntimeError) as error:
            raise InvalidInputError(
                f"begin: expected weights of a network that reads {config.picture}, '{config.begin}' has none: "
                f"{str(error).splitlines()[0]}"
            ) from error
    if config.tuned:
        network.trunk.requires_grad_()
    return network


def some_drives(moments: Split, config: TrainConfig) -> Tensor:
    """Numbers of the moments of a share of the drives, drawn from the seed."""
    drives = np.unique(moments.drive)
    wanted = max(round(config.share * len(drives)), 1)
    kept = np.random.default_rng(config.seed).permutation(drives)[:wanted]
    rows = torch.from_numpy(np.flatnonzero(np.isin(moments.drive, kept)))
    leaving = rows[leaves(moments)[rows]]
    starts = stands(moments)[leaving]
    return torch.cat([rows, leaving[~starts].repeat(config.leaving - 1), leaving[starts].repeat(config.starting - 1)])


def leaves(moments: Split) -> Tensor:
    """(M,) whether the expert goes aside where the route goes straight on."""
    target, end = moments.measurements[:, 0, TARGET] * TARGET_SCALE, moments.waypoints[:, 0, -1]
    return (target[:, 1].abs() < STRAIGHT_M) & (target[:, 0] > TARGET_M - STRAIGHT_M) & (end[:, 1].abs() > ASIDE_M)


def stands(moments: Split) -> Tensor:
    """(M,) whether the ego stands."""
    return moments.measurements[:, 0, SPEED] * SPEED_SCALE < STANDS_M_S


def validate(network: Priboot, moments: Split, seen: Seen, index: Tensor, config: TrainConfig) -> dict[str, float]:
    """Measures of the waypoints on some moments.

    Returns:
        Losses from the own and from a displaced pose, the mean distance to the expert's waypoints [m], and the shares
        of the standing moments at which the network starts: where the expert goes, and where it stays.
    """
    network.eval()
    with torch.no_grad():
        found = [_predicted(network, moments, seen, index, view, config.batch) for view in (0, 1)]
    network.train()
    own, displaced = (
        float((points - moments.waypoints[index, view]).abs().sum((1, 2)).mean()) for view, points in enumerate(found)
    )
    wanted, still = moments.waypoints[index, 0], stands(moments)[index]
    apart = float((found[0] - wanted).norm(dim=2).mean())
    starts, far = (found[0][:, -1, 0] > STARTS_M).float(), wanted[:, -1, 0]
    shares = [_mean(starts[still & (far > GOES_M)]), _mean(starts[still & (far < STAYS_M)])]
    return dict(zip(MEASURES, (own, displaced, apart, *shares), strict=True))


def _predicted(network: Priboot, moments: Split, seen: Seen, index: Tensor, view: int, batch: int) -> Tensor:
    """(N, 4, 2) waypoints from one view of some moments, m."""
    parts = torch.split(index, batch)
    return torch.cat([network.head(*seen(moments.row[at, view]), moments.measurements[at, view])[0] for at in parts])


def _mean(values: Tensor) -> float:
    return float(values.mean()) if len(values) else 0.0


PRIBOOT = Trainer("waypoints of PRIBOOT, from recorded demonstrations", TrainConfig, train)
