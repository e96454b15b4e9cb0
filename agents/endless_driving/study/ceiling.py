"""Ceiling: what an expert reaches that drives the held-out missions itself, and an imitation of it hardly more.

python -m dohyo.agents.endless_driving.study.ceiling --out agents/rlfold/results/ceiling.json    # 4 minutes
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from dohyo.agents.endless_driving.config import ExpertConfig, TownConfig
from dohyo.agents.endless_driving.environment import EndlessDrivingEnv
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.studies.tables import bracketed
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import Estimate, mean_estimate, share_estimate
from dohyo.sumo_networks.files import write_atomically

MISSIONS: Final = 20
MAX_SPEED_M_S: Final = 5.0  # RLfOLD's
FULL: Final = 0.99
"""Action from which on an expert asks for the highest speed."""
EXPERTS: Final = (
    ("rules", False, 0.0), ("rules", False, 0.3), ("rules", True, 0.0), ("autopilot", True, 0.0),
    ("priboot", True, 0.0),
)  # fmt: skip
"""Name, whether lights count, and share of random seconds."""


@dataclass(frozen=True, slots=True)
class ExpertDrive:
    """A mission driven by an expert.

    Attributes:
        total: Its return.
        slower: Share of its decisions that ask for less than the highest speed, %.
        info: The last info of the episode.
    """

    total: float
    slower: float
    info: Mapping[str, Any]


def drives(task: EndlessDriving, slowest_m_s: float = 0.0) -> list[ExpertDrive]:
    """The held-out missions of a task, driven by its expert.

    Args:
        task: Has an expert.
        slowest_m_s: Smallest target speed, m/s.

    Raises:
        SimulationError: A simulation failed.
    """
    env, least = EndlessDrivingEnv(task), 2.0 * slowest_m_s / task.town.max_speed - 1.0
    found = []
    try:
        for seed in task.held_out:
            env.reset(seed=seed)
            total, speeds, over = 0.0, list[float](), False
            while not over:
                action = env.expert_action()
                assert action is not None
                speeds.append(float(action[0]))
                action[0] = max(action[0], least)
                _, reward, terminated, truncated, info = env.step(action)
                total, over = total + reward, terminated or truncated
            found.append(ExpertDrive(total, 100.0 * sum(one < FULL for one in speeds) / len(speeds), info))
    finally:
        env.close()
    return found


@dataclass(frozen=True, slots=True)
class Ceiling:
    """What one expert reaches.

    Attributes:
        expert: Its name.
        lawful: Whether lights and stop signs count, for it and for the task.
        noise: Share of its seconds whose target speed is random.
        episode_return: Mean return of a mission.
        success: Share of goals, %.
        collision: Share of missions that end in a collision, %.
        slower: Mean share of decisions that ask for less than the highest speed, %.
    """

    expert: str
    lawful: bool
    noise: float
    episode_return: Estimate
    success: Estimate
    collision: Estimate
    slower: Estimate


def ceiling(expert: str, lawful: bool, noise: float, missions: int = MISSIONS) -> Ceiling:
    """Drives held-out missions of the training town, see `drives`."""
    town = TownConfig(view="state", held_out=missions, stand_below=0.4, max_speed=MAX_SPEED_M_S, obey_lights=lawful)
    found = drives(EndlessDriving(town, ExpertConfig(name=expert, noise=noise)))
    goals = share_estimate([bool(one.info["success"]) for one in found])
    collisions = share_estimate([one.info["collision"] > 0.0 for one in found])
    returns, slower = mean_estimate([one.total for one in found]), mean_estimate([one.slower for one in found])
    return Ceiling(expert, lawful, noise, returns, goals, collisions, slower)


def table(found: Sequence[Ceiling]) -> str:
    """A row per expert."""
    rows = []
    for one in found:
        values = [bracketed(value) for value in (one.episode_return, one.success, one.collision, one.slower)]
        rows.append([one.expert, "yes" if one.lawful else "no", f"{one.noise:g}", *values])
    return markdown(
        ["expert", "lights count", "noise", "return", "success, %", "collision, %", "asks for less, %"], rows
    )


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file")
    given = parser.parse_args()
    found = [ceiling(*one) for one in EXPERTS]
    if given.out:
        write_atomically(given.out, (json.dumps([asdict(one) for one in found], indent=1) + "\n").encode())
    print(table(found))


if __name__ == "__main__":
    main()
