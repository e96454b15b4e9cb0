"""Hesitation: where an ego that PRIBOOT drives loses its time, on a network that it was trained on.

    python -m dohyo.agents.priboot.study.hesitation --missions 0 3
    python -m dohyo.agents.priboot.study.hesitation --policy out/priboot/full/seed-0/priboot.onnx

The autopilot is asked in every tick what it would do in PRIBOOT's place, and drives the same missions by itself. No
network that judges is driven, so that what is found may be mended.
"""

from __future__ import annotations

import argparse
from collections import Counter
from contextlib import closing
from pathlib import Path
from typing import Final, Literal

import numpy as np

from dohyo.agents.experts.autopilot import Autopilot
from dohyo.agents.priboot.priboot import Priboot
from dohyo.agents.studies.samples import Sample
from dohyo.evaluation.agent import Agent, Observation
from dohyo.evaluation.report.style import markdown
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.units import TICK_S
from dohyo.sumo_networks.world import LightState

MISSIONS: Final = Sample("nocrash", ("town-train.regular.train",))
STANDS_M_S, GOES, LONGEST_S = 0.3, 0.3, 400.0
"""Speed of an ego that stands, acceleration from which on the autopilot would go [m/s^2], and longest drive."""
COLUMNS: Final = ("time", "stands", "stands though it could go", "of these before a red light", "brakes by a rule")
Driver = Literal["autopilot", "priboot"]


def lost_time(scenario: Scenario, driver: Driver, policy: Path | None) -> tuple[float, Counter[str]]:
    """Drives one mission.

    Returns:
        Metres driven, and the number of ticks of each of `COLUMNS`.
    """
    mission, ticks = scenario.missions[0], Counter[str]()
    asked, driving = Autopilot(), Priboot(policy=policy)  # type: ignore[abstract]
    agents: tuple[Agent, ...] = (asked, driving) if driver == "priboot" else (asked,)
    sensors = tuple(dict.fromkeys(sensor for agent in agents for sensor in agent.spec.sensors))
    with closing(DrivingEnv(scenario, sensors, agents[-1].spec.control, reward=None)) as env:
        observations, _ = env.reset()
        for agent in agents:
            agent.reset(mission, scenario.seed)
        while env.agents and ticks["time"] * TICK_S < LONGEST_S:
            seen = observations[mission.name]
            actions = [agent.act(seen) for agent in agents]
            ticks.update(_states(seen, actions[0], driving))
            observations, *_ = env.step({mission.name: actions[-1]})
        return float(env.world.egos.progress[0]), ticks


def _states(seen: Observation, asked: np.ndarray, driving: Priboot) -> list[str]:
    """Which of `COLUMNS` hold in a tick."""
    time, stands, could_go, before_red, by_rule = COLUMNS
    out = [time]
    if float(seen["speedometer"][0]) < STANDS_M_S:
        out.append(stands)
        if asked[0] > GOES:
            red = seen["junctions_ahead"][0, 2] in (LightState.RED, LightState.YELLOW)
            out += [could_go, before_red] if red else [could_go]
    told = driving.explain() or {}
    return [*out, by_rule] if told["rule"] and told["brake"] else out


def table(missions: list[int], policy: Path | None) -> str:
    """A row per mission and driver."""
    lines, scenarios = [], MISSIONS.scenarios()
    drivers: tuple[Driver, ...] = ("autopilot", "priboot")
    for number in missions:
        for driver in drivers:
            metres, ticks = lost_time(scenarios[number], driver, policy)
            moving = (ticks[COLUMNS[0]] - ticks[COLUMNS[1]]) * TICK_S
            times = [f"{ticks[column] * TICK_S:.0f}" for column in COLUMNS]
            name = scenarios[number].name
            lines.append([name, driver, f"{metres:.0f}", *times, f"{metres / max(moving, 1.0):.1f}"])
    heads = ["mission", "driver", "driven, m", *(f"{column}, s" for column in COLUMNS), "speed while it moves, m/s"]
    return markdown(heads, lines)


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    numbers = range(len(MISSIONS.scenarios()))
    parser.add_argument(
        "--missions",
        type=int,
        nargs="+",
        default=[0, 3],
        choices=numbers,
        metavar="N",
        help="numbers, from 0",
    )
    parser.add_argument("--policy", type=Path, help="ONNX file; default: the shipped one")
    options = parser.parse_args()
    print(table(options.missions, options.policy))


if __name__ == "__main__":
    main()
