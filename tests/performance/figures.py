"""The figures of `make bench`: what each part measures, and what it is compared with. One function per part."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from tests.performance.calibration import kernel_ms


@dataclass(frozen=True, slots=True)
class Figure:
    """One line of the table.

    Attributes:
        name: What was measured.
        value: The number that has a goal.
        unit: Of the value; "x" for a ratio.
        goal: What it should be.
        at_most: The goal is an upper bound; else a lower one.
        peer: What the ratio is to: bare libsumo, another environment, or the calibration kernel.
        ratio: To the peer, taken in the same run.
    """

    name: str
    value: float
    unit: str
    goal: float | None
    at_most: bool
    peer: str
    ratio: float

    @property
    def met(self) -> bool | None:
        """Whether the goal is met; None without one."""
        if self.goal is None:
            return None
        return self.value <= self.goal if self.at_most else self.value >= self.goal


def ratio(name: str, value: float, peer: str, goal: float | None, *, at_most: bool = False) -> Figure:
    """A figure that is a ratio itself."""
    return Figure(name, value, "x", goal, at_most, peer, value)


def duration(name: str, value_ms: float, goal_ms: float, kernel: float) -> Figure:
    """Milliseconds, and how many calibration kernels that is."""
    return Figure(name, value_ms, "ms", goal_ms, True, "calibration kernel", value_ms / kernel)


def world() -> list[Figure]:
    """The environment against bare libsumo and a peer."""
    from tests.performance import world as parts

    goals = {50: 0.35, 200: 0.7, 1000: 0.85}
    figures = []
    for case, row in parts.one_ego().items():
        network, _, vehicles = case.rpartition("-")
        figures.append(
            ratio(f"DrivingEnv, {network}, {vehicles} vehicles", row["ratio"], "bare libsumo", goals[int(vehicles)])
        )
    figures.append(ratio("eight egos, steps of an ego", parts.eight_egos()["ratio"], "bare libsumo", 1.0))
    workers = parts.two_workers()
    figures.append(ratio("two processes", workers["ratio"], "one process", 1.5))
    figures.append(ratio("VectorDrivingEnv of two", workers["vector_ratio"], "of one", 1.8))
    figures.append(ratio("DrivingEnv, 50 vehicles", parts.against_a_peer()["ratio"], "highway-env", 10.0))
    return figures


def senses() -> list[Figure]:
    """Pictures, radar, positioning and the localization filters."""
    from tests.performance import senses as parts
    from tests.performance import world as worlds

    kernel, scenes = kernel_ms(), parts.junction(40)
    presets = {preset.name: preset for preset in parts.PRESETS}
    figures = [
        duration(f"{name}, 40 actors", parts.measure(presets[name], scenes)["median"], goal, kernel)
        for name, goal in (("birdseye", 1.0), ("camera_rgb", 5.0), ("camera_semantic", 5.0))
        if name in presets
    ]
    micro = worlds.one_by_one()
    for name, goal_us in (("radar_us", 50.0), ("es-ekf_imu_us", 10.0), ("es-ekf_fix_us", 100.0)):
        figures.append(duration(name.removesuffix("_us").replace("_", ", "), micro[name] / 1e3, goal_us / 1e3, kernel))
    return figures


def planners() -> list[Figure]:
    """Decisions of the planners among 30 actors."""
    from dohyo.agents.experts.pdm import PdmClosed
    from dohyo.agents.mcts.mbappe import Mbappe
    from tests.performance.planners import milliseconds

    kernel = kernel_ms()
    return [
        duration("MBAPPE, one decision", milliseconds(Mbappe(), 30, 300)["median_ms"], 10.0, kernel),
        duration("PDM-Closed, one decision", milliseconds(PdmClosed(), 30, 300)["median_ms"], 15.0, kernel),
    ]


def rules() -> list[Figure]:
    """Rules, RSS and the decisions of the hierarchical agents."""
    from tests.performance import rules as parts

    kernel, got = kernel_ms(), parts.measure()
    return [
        duration("rules, one critical moment solved", got["solve_ms"]["median"], 2.0, kernel),
        duration("RSS, 30 actors", got["rss_us"]["median"] / 1e3, 0.05, kernel),
        duration("rules, one decision", got["decision_ms"]["median"], 10.0, kernel),
        duration("GHRL-R, one decision", got["ghrl_ms"]["median"], 10.0, kernel),
    ]


def state() -> list[Figure]:
    """One picture encoded for GHRL."""
    from tests.performance import state as parts

    kernel = kernel_ms()
    return [duration("GHRL, one picture encoded", parts.measure()["picture"][0], 3.0, kernel)]


def forecasts() -> list[Figure]:
    """Networks that forecast speeds, batch 1."""
    from dohyo.agents.forecasting.study.latency import of_network
    from tests.performance.forecasting import GOALS_MS, SEGMENTS

    kernel = kernel_ms()
    return [
        duration(f"{name}, {where}", one.core_ms, goal, kernel)
        for (name, rows), goals in GOALS_MS.items()
        for (where, one), goal in zip(of_network(name, SEGMENTS, rows, 500, 100).items(), goals, strict=True)
    ]


def perception() -> list[Figure]:
    """Encoders and augmentations of pixel learners, 32 pictures of 9 x 64 x 64."""
    from tests.performance import perception as parts

    kernel, augmentations = kernel_ms(), parts.augmentations_ms()
    goals = {"random shift": 5.0, "colour jitter": 120.0, "Gaussian blur": 25.0}
    return [
        duration("RLAD's encoder, 32 pictures", parts.forward_ms("rlad"), 60.0, kernel),
        duration("IMPALA's encoder, 32 pictures", parts.forward_ms("impala"), 300.0, kernel),
        ratio("update of RLAD's encoder", parts.mixing_ratio(), "without A-LIX", 2.5, at_most=True),
        *(duration(f"{name}, 32 pictures", ms, goals[name], kernel) for name, ms in augmentations.items()),
    ]


def wire() -> list[Figure]:
    """Steps of a remote agent over HTTP."""
    from tests.performance import wire as parts

    kernel = kernel_ms()
    one, real = parts.measure_null(1, 1000), parts.measure_real(True)
    name = "remote step with 200 readers, 99th percentile"
    return [
        duration("remote step, 12 kB each way", one["p50_ms"], 2.0, kernel),
        ratio(name, real["p99_ratio"], "the same alone", 3.0, at_most=True),
    ]


def worlds() -> list[Figure]:
    """Live worlds by the number of workers and spectators, and a vector environment over the wire."""
    from tests.performance import worlds as parts

    kernel = kernel_ms()
    null, real, vector = parts.measure_null(400), parts.measure_real(150), parts.measure_remote_env(150)
    many = null["16 workers"]
    return [
        duration("tick of a null world with 1 worker", null["1 workers"]["p50_ms"], 4.0, kernel),
        duration("tick of a null world with 16 workers", many["p50_ms"], 16.0, kernel),
        duration("the same, 99th percentile", many["p99_ms"], 64.0, kernel),
        ratio("tick with two workers", real["two to one"], "the same with one", 1.5, at_most=True),
        ratio("ticks before 200 spectators", real["spectators"]["share"], "the same alone", 0.8),
        ratio("steps of a remote vector environment", vector["ratio"], "a local one", None),
    ]


def learning() -> list[Figure]:
    """Updates against the networks' bare passes and a peer's, the replay's bytes, the collector's own time."""
    from tests.performance import learning as parts

    sac, pixels = parts.sac_updates(), parts.pixel_updates()
    passes, environment = "bare forward and backward", "bare environment"
    return [
        ratio(f"update of SAC, {sac['ms']:.1f} ms", sac["to_bare"], passes, 1.2, at_most=True),
        ratio("updates per second of SAC", sac["to_peer"], "stable-baselines3", 1.0),
        ratio(f"update from pictures, {pixels['ms']:.0f} ms", pixels["to_bare"], passes, 1.2, at_most=True),
        ratio("bytes of a transition of 64 x 64 pixels", parts.pixel_bytes(), "one frame", 1.01, at_most=True),
        ratio("step of the collector", parts.collector_overhead()["to_bare"], environment, 1.1, at_most=True),
    ]


def pixels() -> list[Figure]:
    """Updates of RLAD, with all that it adds to SAC."""
    from tests.performance import pixels as parts

    found = parts.measure()
    name = f"update of RLAD, {found['rlad']:.0f} ms"
    return [ratio(name, found["ratio"], "bare SAC from pictures", 1.2, at_most=True)]


def parking() -> list[Figure]:
    """Karts in hundreds of lots, with observations: 50 ms are two million steps per second. And the policy."""
    from dohyo.sumo_networks.parking.generate import Scene
    from tests.performance import parking as parts

    kernel = kernel_ms()
    return [
        duration("100,000 steps of karts, one in a lot", parts.measure(Scene.COMPLEX, 1), 50.0, kernel),
        duration("100,000 steps of karts, three in a lot", parts.measure(Scene.COMPLEX, 3), 50.0, kernel),
        duration("decision of the shipped parking policy", parts.decision_ms(), 0.1, kernel),
    ]


def producers() -> list[Figure]:
    """Explorers in processes, which drive and encode."""
    from tests.performance.producers import apart_per_s, transitions_per_s

    rates, apart = transitions_per_s(), apart_per_s()
    return [
        ratio("steps per second of two explorers", rates[2] / rates[1], "one explorer", 1.8),
        ratio("the same of two processes without a learner", apart[2] / apart[1], "one of them", None),
    ]


_MEASURED = (
    world, senses, planners, rules, state, forecasts, perception, learning, pixels, wire, worlds, parking, producers,
)  # fmt: skip
PARTS: dict[str, Callable[[], list[Figure]]] = {part.__name__: part for part in _MEASURED}


def as_document(figure: Figure) -> dict[str, Any]:
    """For bench.json."""
    return {name: getattr(figure, name) for name in (*Figure.__slots__, "met")}
