"""Creeping: what a smallest target speed costs the expert of rules, who knows everything else.

    python -m dohyo.agents.endless_driving.study.creeping --out agents/rlad/results/creeping.json    # 3 minutes

A squashed Gaussian never asks for a target of 0. Before a red line a small one is enough to cross it.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

from dohyo.agents.endless_driving.config import ExpertConfig, TownConfig
from dohyo.agents.endless_driving.study.ceiling import drives
from dohyo.agents.endless_driving.task import EndlessDriving
from dohyo.agents.studies.tables import bracketed
from dohyo.evaluation.report.style import markdown
from dohyo.evaluation.statistics import Estimate, mean_estimate, share_estimate
from dohyo.sumo_networks.files import write_atomically

SLOWEST_M_S: Final = (0.0, 0.15, 0.3)
MISSIONS: Final = 20


@dataclass(frozen=True, slots=True)
class Creeping:
    """The expert with a smallest target speed.

    Attributes:
        slowest_m_s: Its smallest target speed.
        stand_below_m_s: Target speed below which the ego stands.
        episode_return: Sum of rewards of a mission.
        success: Share of goals, %.
        red_lights: Share of missions that end at a red line, %.
    """

    slowest_m_s: float
    stand_below_m_s: float
    episode_return: Estimate
    success: Estimate
    red_lights: Estimate


def creeping(slowest_m_s: float, stand_below_m_s: float, missions: int = MISSIONS) -> Creeping:
    """Drives held-out missions of the training town.

    Raises:
        SimulationError: A simulation failed.
    """
    town = TownConfig(view="state", held_out=missions, stand_below=stand_below_m_s)
    task = EndlessDriving(town, ExpertConfig())
    found = drives(task, slowest_m_s)
    returns = [one.total for one in found]
    goals, reds = [bool(one.info["success"]) for one in found], [one.info["red_lights"] > 0.0 for one in found]
    return Creeping(slowest_m_s, stand_below_m_s, mean_estimate(returns), share_estimate(goals), share_estimate(reds))


def table(found: Sequence[Creeping]) -> str:
    """A row per smallest target speed."""
    rows = []
    for one in found:
        values = [bracketed(value) for value in (one.episode_return, one.success, one.red_lights)]
        rows.append([f"{one.slowest_m_s:g}", f"{one.stand_below_m_s:g}", *values])
    return markdown(["slowest, m/s", "stands below, m/s", "return", "success, %", "red light, %"], rows)


def main() -> None:
    """Command-line entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="JSON file")
    given = parser.parse_args()
    found = [creeping(slowest, 0.0) for slowest in SLOWEST_M_S] + [creeping(SLOWEST_M_S[-1], 0.4)]
    if given.out:
        write_atomically(given.out, (json.dumps([asdict(one) for one in found], indent=1) + "\n").encode())
    print(table(found))


if __name__ == "__main__":
    main()
