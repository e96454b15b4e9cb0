"""What every test may use: simulations and environments, closed afterwards: a process has room for one."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from hypothesis import settings

from dohyo.sumo_networks import processes
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.simulation import Simulation, plan_scenario
from dohyo.sumo_networks.world import World
from tests import compile_once, forked
from tests.side_by_side import pytest_addhooks as pytest_addhooks
from tests.side_by_side import pytest_addoption as pytest_addoption
from tests.side_by_side import pytest_runtestloop as pytest_runtestloop
from tests.skips import pytest_runtest_makereport as pytest_runtest_makereport

# The same examples in every run; the first call of a kernel may compile it for seconds.
settings.register_profile("repeatable", derandomize=True, deadline=None, database=None)
settings.load_profile("repeatable")

processes.PRELOADED = "tests.preloaded"
compile_once.install()

Start = Callable[[Scenario], tuple[Simulation, World]]
MakeEnv = Callable[..., DrivingEnv]


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first, so that no process has one left when the others have ended."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


def pytest_copies() -> None:
    """Before copies of this process run the tests, see `tests.side_by_side`."""
    forked.begin()


@pytest.fixture
def start() -> Iterator[Start]:
    """Starts a scenario; the one started before is closed."""
    opened: list[Simulation] = []

    def start(scenario: Scenario) -> tuple[Simulation, World]:
        for simulation in opened:
            simulation.close()
        opened.append(Simulation(plan_scenario(load_network(scenario.network), scenario)))
        return opened[-1], opened[-1].world

    yield start
    for simulation in opened:
        simulation.close()


@pytest.fixture
def make_env() -> Iterator[MakeEnv]:
    """Makes an environment; the one made before is closed."""
    opened: list[DrivingEnv] = []

    def make_env(*arguments: object, **options: object) -> DrivingEnv:
        for env in opened:
            env.close()
        opened.append(DrivingEnv(*arguments, **options))  # type: ignore[arg-type]
        return opened[-1]

    yield make_env
    for env in opened:
        env.close()
