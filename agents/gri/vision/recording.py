"""Recording: the autopilot drives, and three cameras on each ego take pictures, whose pose is drawn again and again.

    dohyo dataset affordances --out data/affordances

A part of the poses is that of an agent's cameras, the others are displaced. Town, missions, traffic, conditions and
poses of an episode follow from its number alone: an interrupted recording goes on, and the same order gives the same
arrays. Numbers from 2^30 on are held out.

Source: Chekroun 2024, section 4.4.2.1. Ours: how far, and how often, the cameras move.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from dohyo.agents.driving import decisions
from dohyo.agents.experts.autopilot import Autopilot
from dohyo.agents.gri.vision.cameras import MOUNTED, Rig, drawn_displacement
from dohyo.agents.gri.vision.labels import Labels, labels_of
from dohyo.agents.mcts.predictors import recording as motion
from dohyo.agents.perception.drives import FACTS, write_drives
from dohyo.agents.shards import claim_folder
from dohyo.sumo_networks.arrays import FloatArray
from dohyo.sumo_networks.conditions import TEST, TRAIN, Conditions, conditions_named
from dohyo.sumo_networks.config import Config
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.seeds import HELD_OUT_FROM
from dohyo.sumo_networks.units import TICK_S

SCHEMA_VERSION: Final = 2
HELD_S: Final = 5.0
"""How long the cameras keep a pose."""
MOUNTED_SHARE: Final = 0.3
"""Share of poses without displacement."""
COLUMNS: Final = ("pictures", "classes", "displacement", *Labels._fields)


class Split(NamedTuple):
    """Episodes of one kind.

    Attributes:
        network: Where they drive.
        conditions: Their names, in turn.
        first: Number of the first one.
        share: Number of them, as a share of those for training.
    """

    network: str
    conditions: tuple[str, ...]
    first: int
    share: float


_TRAIN, _TEST = tuple(sorted(TRAIN)), tuple(sorted(TEST))
SPLITS: Final[Mapping[str, Split]] = MappingProxyType(
    {
        "train": Split("town-train", _TRAIN, 0, 1.0),
        "validation": Split("town-train", _TRAIN, 1_000_000, 0.15),
        "town-train": Split("town-train", _TRAIN, HELD_OUT_FROM, 0.3),
        "town-train-test-conditions": Split("town-train", _TEST, HELD_OUT_FROM + 1_000_000, 0.3),
        "town-test": Split("town-test", _TRAIN, HELD_OUT_FROM, 0.3),
        "town-test-test-conditions": Split("town-test", _TEST, HELD_OUT_FROM + 1_000_000, 0.3),
    }
)
"""What is learned from, what is looked at meanwhile, and the four that are judged, as in NoCrash."""
JUDGED: Final = tuple(name for name, split in SPLITS.items() if split.first >= HELD_OUT_FROM)


class AffordanceRequest(Config):
    """Order of a recording.

    Attributes:
        moments: Least number for training, if no ego arrives early; each split of the others has its share more.
        seed: Of all randomness.
        egos: Number per episode.
        every_s: Time between two moments of one ego.
        episode_s: Duration of an episode.
    """

    moments: Annotated[int, Field(ge=1)] = 4000
    seed: Annotated[int, Field(ge=0)] = 0
    egos: Annotated[int, Field(ge=1)] = 8
    every_s: Annotated[float, Field(ge=TICK_S)] = 1.0
    episode_s: Annotated[float, Field(gt=0)] = 40.0

    def episodes(self) -> Iterator[tuple[str, Scenario]]:
        """Split and scenario of each episode."""
        wanted = math.ceil(self.moments / (self.egos * math.ceil(self.episode_s / self.every_s - 1e-6)))
        for name, split in SPLITS.items():
            for number in range(math.ceil(wanted * split.share)):
                conditions = split.conditions[number % len(split.conditions)]
                yield name, self._scenario(split.network, split.first + number, conditions)

    def _scenario(self, network: str, number: int, conditions: str) -> Scenario:
        """Missions and traffic as in the motion data set; its number is its seed."""
        drawn = motion.scenario(motion.MotionRequest(seed=self.seed, egos=self.egos), network, number)
        update = {"name": f"affordances-{network}-{number}", "conditions": conditions, "seed": number}
        return drawn.model_copy(update=update)


def record_affordances(
    order: AffordanceRequest, out: Path, progress: Callable[[float], None] = lambda share: None
) -> int:
    """Records the episodes that are not there yet.

    Args:
        order: What to record.
        out: Folder; see `perception.drives`.
        progress: Called with the share of episodes done, after every episode.

    Returns:
        Number of moments.

    Raises:
        InvalidInputError: The order is impossible, or the folder holds a data set of another order; it may grow.
    """
    claim_folder(out, {"schema": SCHEMA_VERSION, **order.model_dump(mode="json", exclude={"moments"})})
    episodes = list(order.episodes())
    for done, (split, scenario) in enumerate(episodes, start=1):
        folder = out / split / scenario.name
        if not folder.exists():
            folder.parent.mkdir(parents=True, exist_ok=True)
            write_drives(folder, recorded(scenario, order))
        progress(done / len(episodes))
    return sum(int(np.load(path.with_name("light.npy"), mmap_mode="r").size) for path in out.glob(f"*/*/*/{FACTS}"))


def recorded(scenario: Scenario, order: AffordanceRequest) -> dict[str, tuple[dict[str, NDArray[Any]], dict[str, Any]]]:
    """Drives one scenario.

    Returns:
        Arrays of `COLUMNS`, each of T moments, and facts, by ego.

    Raises:
        InvalidInputError: A network or condition does not exist.
        SimulationError: SUMO failed.
    """
    names = [mission.name for mission in scenario.missions]
    agents = {name: Autopilot() for name in names}  # type: ignore[abstract]
    conditions, rng = conditions_named(scenario.conditions), np.random.default_rng([scenario.seed, order.seed])
    poses = {name: _Poses(conditions, one) for name, one in zip(names, rng.spawn(len(names)), strict=True)}
    rows: dict[str, list[tuple[Any, ...]]] = {name: [] for name in names}
    stride = max(round(order.every_s / TICK_S), 1)
    with closing(DrivingEnv(scenario, Autopilot.spec.sensors, Autopilot.spec.control, reward=None)) as env:
        for now in decisions(env, agents, round(order.episode_s / TICK_S)):
            for name in now.actions if now.tick % stride == 0 else ():
                rig, displacement = poses[name].at(now.tick)
                colours, classes = rig.read(env.world, names.index(name))
                told = labels_of(now.observations[name], displacement)
                rows[name].append((colours, classes, displacement.astype(np.float32), *told))
    facts = {"network": scenario.network, "scenario": scenario.name, "seed": scenario.seed}
    told_facts = {**facts, "conditions": scenario.conditions}
    return {name: (_arrays(rows[name]), told_facts) for name in names}


class _Poses:
    """Cameras of one ego, with another pose every `HELD_S`."""

    def __init__(self, conditions: Conditions, rng: np.random.Generator) -> None:
        self._conditions, self._rng, self._number = conditions, rng, -1

    def at(self, tick: int) -> tuple[Rig, FloatArray]:
        """The cameras, and their displacement."""
        if (number := tick // round(HELD_S / TICK_S)) != self._number:
            self._number, mounted = number, self._rng.random() < MOUNTED_SHARE
            self._displacement = np.array(MOUNTED) if mounted else drawn_displacement(self._rng)
            self._rig = Rig(self._displacement, self._conditions, self._rng)
        return self._rig, self._displacement


def _arrays(rows: list[tuple[Any, ...]]) -> dict[str, NDArray[Any]]:
    """Columns of rows; floats are float32, numbers int64."""
    columns = (np.stack([np.asarray(value) for value in column]) for column in zip(*rows, strict=True))
    return {
        name: column.astype(np.float32) if column.dtype == np.float64 else column
        for name, column in zip(COLUMNS, columns, strict=True)
    }
