"""Records and worlds, built by hand: every argument left out has a harmless value."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version
from typing import Any, cast

import numpy as np

from dohyo.evaluation.records.record import AgentInfo, EgoRecord, EpisodeRecord, Infraction, Timing, Versions
from dohyo.evaluation.records.specifications import InfractionKind, Status
from dohyo.evaluation.records.trajectory import Trajectory, TrajectoryRecorder
from dohyo.sumo_networks.scenario import Mission, Place, Scenario
from dohyo.sumo_networks.world import ActorKind, Actors, Egos, World

AGENT = AgentInfo(name="tester", entry="tests:Tester", track="privileged", sensors=(), control="pedals_steering")
TIMING = Timing(created="2024-01-01T00:00:00Z", wall_s=1.5, ticks_per_s=400.0, decision_ms={"ego": (1.0, 2.0, 3.0)})


def infraction(kind: InfractionKind, *, time_s: float = 1.0, route_m: float = 0.0, **rest: Any) -> Infraction:
    return Infraction(kind=kind, time_s=time_s, x_m=0.0, y_m=0.0, route_m=route_m, **rest)


def ego(
    *infractions: Infraction,
    status: Status = Status.TIMED_OUT,
    progress_m: float = 800.0,
    route_length_m: float = 1000.0,
    driven_m: float | None = None,
    name: str = "ego",
    agent: AgentInfo = AGENT,
    **rest: Any,
) -> EgoRecord:
    """A drive over 80 % of a kilometre, by default without a flaw but for its end."""
    return EgoRecord(
        name=name,
        agent=agent,
        status=status,
        duration_s=60.0,
        route_length_m=route_length_m,
        progress_m=progress_m,
        driven_m=progress_m if driven_m is None else driven_m,
        infractions=infractions,
        **rest,
    )


def episode(
    *egos: EgoRecord,
    name: str = "scenario",
    seed: int = 0,
    benchmark: tuple[str, str] | None = ("nocrash", "0" * 64),
    trajectory: Trajectory | None = None,
    timing: Timing | None = TIMING,
    **rest: Any,
) -> EpisodeRecord:
    egos = egos or (ego(),)
    place = Place(lane="E_0")
    # Copies are not validated: a report must bear names that no scenario of ours could have.
    missions = tuple(Mission(start=place, goal=place).model_copy(update={"name": one.name}) for one in egos)
    one_mission = Scenario(network="hand-made", missions=missions[:1], seed=seed, **rest)
    return EpisodeRecord(
        scenario=one_mission.model_copy(update={"name": name, "missions": missions}),
        benchmark=benchmark,
        egos=egos,
        ticks=600,
        versions=Versions(dohyo=version("dohyo"), sumo="1.28.0", network_sha256="1" * 64),
        trajectory_sha256=(trajectory or drive()).sha256(),
        timing=timing,
    )


def lost(**rest: Any) -> EpisodeRecord:
    """An episode whose simulation failed."""
    return episode(ego(status=Status.SIMULATION, progress_m=0.0, failure="SUMO lost the ego"), **rest)


def world(
    tick: int, *, active: Sequence[bool] = (True,), actors: Sequence[int] = (), x: float = 0.0, lateral: float = 0.0
) -> World:
    """Egos in a row at x, and actors by key, each at its key's coordinates; without roads."""
    e, m = len(active), len(actors)
    keys = np.array(actors, dtype=np.int64)
    return World(
        tick=tick,
        time=0.1 * tick,
        network=cast(Any, None),
        routes=(),
        egos=Egos(
            names=tuple(f"ego{i}" for i in range(e)),
            active=np.array(active),
            position=np.column_stack([np.full(e, x), np.arange(e, dtype=float)]),
            heading=np.full(e, 0.5),
            speed=np.full(e, 10.0),
            acceleration=np.full(e, -1.0),
            yaw_rate=np.zeros(e),
            steering=np.full(e, 0.25),
            length=np.full(e, 4.5),
            width=np.full(e, 2.0),
            progress=np.full(e, x),
            lateral=np.full(e, lateral),
            route_heading_error=np.zeros(e),
            lane=np.zeros(e, dtype=np.int64),
            lane_offset=np.zeros(e),
            lane_heading_error=np.zeros(e),
            driven=np.full(e, x),
        ),
        actors=Actors(
            key=keys,
            kind=np.full(m, ActorKind.CAR, dtype=np.int64),
            position=np.column_stack([keys, keys]).astype(float),
            heading=np.zeros(m),
            speed=np.full(m, 8.0),
            length=np.full(m, 5.0),
            width=np.full(m, 1.8),
            lane=np.full(m, -1),
            indicator=np.zeros(m, dtype=np.int64),
        ),
        signals=np.zeros(0, dtype=np.int64),
        contacts=(),
        names=tuple(f"car{i}" for i in range(100)),
    )


def drive(ticks: int = 20) -> Trajectory:
    """One ego at 10 m/s among two cars, the second of which comes into sight at the tenth tick."""
    recorder = TrajectoryRecorder()
    for tick in range(ticks):
        recorder.append(world(tick, x=float(tick), actors=(0, 7) if tick >= 10 else (0,)))
    return recorder.finish()
