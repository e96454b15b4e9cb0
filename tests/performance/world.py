"""How fast the world turns: DrivingEnv against bare libsumo, in one run: `python -m tests.performance world`.

Both simulate the same traffic from the same seed. The bare arm only calls simulationStep; the other drives its egos
with all criteria and vector observations. Blocks of all arms alternate, so that a slow moment of the machine hits all.
Two workers are two such processes whose blocks begin together; VectorDrivingEnv keeps them in step besides. Its two
environments are compared with each of them alone, as one episode's traffic may be slower than another's.
"""

from __future__ import annotations

import multiprocessing
import statistics
import time
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection

import gymnasium
import highway_env
import libsumo
import numpy as np

from dohyo.evaluation.episode.judge import Judge
from dohyo.sumo_networks.envs.driving_env import DrivingEnv
from dohyo.sumo_networks.envs.vector_env import VectorDrivingEnv
from dohyo.sumo_networks.networks.catalog import load_network
from dohyo.sumo_networks.scenario import Mission, Place, Scenario, Traffic
from dohyo.sumo_networks.simulation import Simulation, plan_scenario
from tests.performance import localization

SENSORS = ("speedometer", "navigation", "lane", "route", "objects", "junctions_ahead")
CASES = {50: "ingolstadt", 200: "adlershof", 1000: "adlershof"}
MISSIONS = {
    "ingolstadt": ("737320747#3_2", "726514449_2"),
    "adlershof": ("46039050#0_2", "414563781_4"),
}
FLEET = (
    ("737320747#3_2", 8.0, "726514449_2"),
    ("737320747#3_2", 30.0, "726514449_2"),
    ("737320747#3_2", 52.0, "726514449_2"),
    ("737320747#4_2", 10.0, "-306431310#1_1"),
    ("29119849#1_2", 8.0, "54169280#2_2"),
    ("29119849#1_3", 8.0, "-148050455#0_1"),
    ("306431310#1_1", 5.0, "726514449_3"),
    ("-816461649_0", 5.0, "24890429#2_1"),
)
BLOCK_TICKS, BLOCKS = 20, 16  # short, so that a change of the machine's load hits both sides of a ratio
COMMAND = (5.0, 0.0)


def scenario(network: str, vehicles: int) -> Scenario:
    """One ego across the network, among so many vehicles."""
    start, goal = MISSIONS[network]
    mission = Mission(start=Place(lane=start, position_m=8.0), goal=Place(lane=goal, position_m=-15.0))
    return Scenario(network=network, missions=(mission,), traffic=Traffic(vehicles=vehicles, warm_up_s=60.0), seed=1)


def fleet(vehicles: int) -> Scenario:
    """Eight egos at once around a junction of Ingolstadt, among so many vehicles."""
    missions = tuple(
        Mission(name=f"ego-{i}", start=Place(lane=lane, position_m=at), goal=Place(lane=goal, position_m=-15.0))
        for i, (lane, at, goal) in enumerate(FLEET)
    )
    return Scenario(network="ingolstadt", missions=missions, traffic=Traffic(vehicles=vehicles, warm_up_s=60.0), seed=1)


def bare(pipe: Connection, case: Scenario) -> None:
    """Steps the same traffic, without egos, subscriptions or reads.

    Who arrives is replaced, as everywhere, or it would soon simulate fewer vehicles than the other arms; untimed.
    """
    simulation = Simulation(plan_scenario(load_network(case.network), case))
    for ego in range(len(case.missions)):
        simulation.retire(ego)
    nowhere = np.empty((0, 2))
    _serve(pipe, libsumo.simulationStep, lambda: simulation.keep_population(nowhere))


def driven(pipe: Connection, case: Scenario) -> None:
    """Drives the egos along their routes at 5 m/s: control, dynamics, world, criteria, observations."""
    env = DrivingEnv(case, sensors=SENSORS, control="lane_command", reward=None)
    env.reset()
    judges = [Judge(case, ego) for ego in range(len(case.missions))]
    for judge in judges:
        judge.start(env.world)
    action = np.array(COMMAND)

    def tick() -> None:
        before = env.world
        if len(env.agents) < len(judges):
            raise RuntimeError("an ego has arrived; a tick would be cheaper than it should be")
        env.step(dict.fromkeys(env.agents, action))
        for judge in judges:
            judge.update(before, env.world)

    _serve(pipe, tick)


def vectorised(pipe: Connection, case: Scenario, seeds: Sequence[int]) -> None:
    """Drives the same, without criteria, in one process per seed; they step together."""
    env = VectorDrivingEnv([case], len(seeds), sensors=SENSORS, control="lane_command", reward=None)
    env.reset(seed=seeds)
    actions = np.tile(np.float32(COMMAND), (len(seeds), 1))
    _serve(pipe, lambda: env.step(actions))
    env.close()


def _serve(pipe: Connection, tick: Callable[[], object], between: Callable[[], object] = lambda: None) -> None:
    """Runs a block whenever asked, and answers with its ticks per second; what is done between ticks is not timed."""
    for _ in range(BLOCK_TICKS):
        tick()
        between()
    pipe.send(0.0)
    while pipe.recv():
        seconds = 0.0
        for _ in range(BLOCK_TICKS):
            began = time.perf_counter()
            tick()
            seconds += time.perf_counter() - began
            between()
        pipe.send(BLOCK_TICKS / seconds)


class Arm:
    """Processes that run blocks together; their rates add up."""

    def __init__(self, work: Callable[..., None], *arguments: object, copies: int = 1) -> None:
        context = multiprocessing.get_context("spawn")
        self.rates: list[float] = []
        self._pipes, self._processes = [], []
        for _ in range(copies):
            ours, theirs = context.Pipe()
            process = context.Process(target=work, args=(theirs, *arguments))
            process.start()
            theirs.close()
            self._pipes.append(ours)
            self._processes.append(process)
        for pipe in self._pipes:
            pipe.recv()

    def block(self) -> None:
        """Runs one."""
        for pipe in self._pipes:
            pipe.send(True)
        self.rates.append(sum(pipe.recv() for pipe in self._pipes))

    def end(self) -> None:
        """Ends the processes."""
        for pipe, process in zip(self._pipes, self._processes, strict=True):
            pipe.send(False)
            process.join()


def compare(*arms: Arm) -> list[tuple[float, float]]:
    """Of each arm, the median of its rates and of their ratios to the first arm's, block by block."""
    for _ in range(BLOCKS):
        for arm in arms:
            arm.block()
    for arm in arms:
        arm.end()
    first = arms[0].rates
    return [
        (
            round(statistics.median(arm.rates), 1),
            round(statistics.median(b / a for a, b in zip(first, arm.rates, strict=True)), 3),
        )
        for arm in arms
    ]


def one_ego() -> dict[str, dict[str, float]]:
    """DrivingEnv with one ego against bare libsumo."""
    results = {}
    print(f"{'network':<12}{'vehicles':>9}{'bare ticks/s':>14}{'env ticks/s':>13}{'ratio':>8}")
    for vehicles, network in CASES.items():
        case = scenario(network, vehicles)
        (bare_rate, _), (env_rate, ratio) = compare(Arm(bare, case), Arm(driven, case))
        results[f"{network}-{vehicles}"] = {"bare_ticks_per_s": bare_rate, "env_ticks_per_s": env_rate, "ratio": ratio}
        print(f"{network:<12}{vehicles:>9}{bare_rate:>14}{env_rate:>13}{ratio:>8}")
    return results


def eight_egos() -> dict[str, float]:
    """Steps of single egos per second, against bare libsumo's steps."""
    case = fleet(50)
    (bare_rate, _), (env_rate, ratio) = compare(Arm(bare, case), Arm(driven, case))
    egos = len(case.missions)
    result = {"bare_ticks_per_s": bare_rate, "agent_steps_per_s": egos * env_rate, "ratio": round(egos * ratio, 3)}
    print(f"8 egos, 50 vehicles: {egos * env_rate:.0f} agent-steps/s, bare {bare_rate:.0f} ticks/s: {result['ratio']}")
    return result


def two_workers() -> dict[str, float]:
    """Two processes against one, each on its own and in step."""
    case = scenario("ingolstadt", 50)
    alone = (Arm(vectorised, case, [1]), Arm(vectorised, case, [2]))
    both = Arm(vectorised, case, [1, 2])
    (one, _), (two, apart), *vector = compare(Arm(driven, case), Arm(driven, case, copies=2), *alone, both)
    (first, _), (second, _), (pair, _) = vector
    rates = zip(alone[0].rates, alone[1].rates, both.rates, strict=True)
    together = statistics.median(c * (1.0 / a + 1.0 / b) for a, b, c in rates)
    vector_one, vector_two = 2.0 / (1.0 / first + 1.0 / second), pair
    result = {
        "one_ticks_per_s": one,
        "two_ticks_per_s": two,
        "ratio": apart,
        "vector_one_ticks_per_s": vector_one,
        "vector_two_ticks_per_s": 2 * vector_two,
        "vector_ratio": round(together, 3),
    }
    print(f"2 workers / 1: {apart} ({two:.0f} / {one:.0f} ticks/s)")
    print(f"VectorDrivingEnv of 2 / of 1: {together:.3f} ({2 * vector_two:.0f} / {vector_one:.0f} ticks/s)")
    return result


def peer(pipe: Connection, vehicles: int) -> None:
    """Steps highway-env's highway among so many vehicles; its policy runs at 15 Hz here, ours at 10 Hz."""
    gymnasium.register_envs(highway_env)
    config = {"vehicles_count": vehicles, "duration": 10_000, "policy_frequency": 15, "simulation_frequency": 15}
    env = gymnasium.make("highway-v0", config=config)
    env.reset(seed=1)

    def tick() -> None:
        _, _, ended, cut, _ = env.step(1)
        if ended or cut:
            env.reset(seed=1)

    _serve(pipe, tick)


def against_a_peer() -> dict[str, float]:
    """Our rate over that of another environment, both with one ego and 50 vehicles."""
    (peer_rate, _), (env_rate, ratio) = compare(Arm(peer, 50), Arm(driven, scenario("ingolstadt", 50)))
    print(f"highway-env, 50 vehicles: {peer_rate:.1f} steps/s, DrivingEnv {env_rate:.0f}: {ratio:.0f} times")
    return {"highway_env_steps_per_s": peer_rate, "env_ticks_per_s": env_rate, "ratio": ratio}


def one_by_one() -> dict[str, float]:
    """Microseconds per reading of radar, IMU and GNSS, and per step of the localization filters."""
    env = DrivingEnv(scenario("ingolstadt", 50), reward=None)
    env.reset()
    results = localization.report(env.world)
    env.close()
    return results
