"""Each planner once on a real junction, in light traffic."""

from __future__ import annotations

import pytest

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import make_agent
from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.evaluation.episode.runner import run_episode

SETTINGS = {
    "mbappe": {"predictor": "constant_velocity", "simulations": 16},
    "random-shooting": {"predictor": "constant_velocity", "simulations": 16},
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["idm", "pdm-closed", "mbappe", "random-shooting"])
def test_it_reaches_the_goal(name: str) -> None:
    scenario = next(one for one in load_benchmark("quickstart").scenarios([0]) if one.name == "right-to-east")
    agent = make_agent(resolve(name), SETTINGS.get(name, {}))
    (drive,) = run_episode(scenario, {scenario.missions[0].name: agent}).egos
    assert drive.status.completed
    assert not any(infraction.kind.startswith("collision") for infraction in drive.infractions)
