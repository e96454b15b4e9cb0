"""Red signals and green right-turn arrows: the signals that stop an ego, at the end of a lane or along its route."""

from __future__ import annotations

import numpy as np

from dohyo.sumo_networks.arrays import IntArray
from dohyo.sumo_networks.rules.right_of_way import RightOfWay, passages_within
from dohyo.sumo_networks.world import LightState, World

CLOSED = frozenset({LightState.RED, LightState.YELLOW})
"""States at which an ego must stop if it can."""


def red_signal(world: World, ego: int, lane: int) -> int:
    """Index of the signal that is red for an ego at the end of a lane, -1 if none.

    If the ego's route passes the end of the lane, the route's own signal decides; otherwise all signals must be red.
    """
    signals = _signals_of(world, ego, lane)
    if len(signals) and bool((world.signals[signals] == LightState.RED).all()):
        return int(signals[0])
    return -1


def has_stop_arrow(world: World, ego: int, lane: int) -> bool:
    """Whether a green right-turn arrow asks an ego to stop at the end of a lane.

    If the ego's route passes the end of the lane, the route's own signal decides; otherwise every signal of the lane
    must be such an arrow, or red beside one.
    """
    if not len(world.duties):
        return False
    signals = _signals_of(world, ego, lane)
    arrow = world.duties[signals] == RightOfWay.STOP
    return bool(arrow.any() and (arrow | (world.signals[signals] == LightState.RED)).all())


def _signals_of(world: World, ego: int, lane: int) -> IntArray:
    """Signals at the end of a lane: that of the ego's route if it passes there, otherwise all of the lane."""
    connections, progress = world.network.connections, world.egos.progress[ego]
    through = [p for p in world.routes[ego].passages if connections.source[p.connection] == lane]
    if through:
        signals = np.array([min(through, key=lambda p: abs(p.entry - progress)).signal])
    else:
        signals = connections.signal[world.network.connections_from(lane)]
    return signals[signals >= 0]


def next_signal(world: World, ego: int, within_m: float) -> tuple[float, LightState] | None:
    """The next signal on an ego's route.

    Returns:
        Distance from the ego's centre to the signal's stop line, m, and the signal's state; None if there is no signal.
    """
    for ahead, passage in passages_within(world.routes[ego], float(world.egos.progress[ego]), within_m):
        if passage.signal >= 0:
            return ahead, LightState(world.signals[passage.signal])
    return None


def passed_red(before: World, after: World, ego: int) -> bool:
    """Whether an ego's front passed a stop line of its route while the signal was red (state after the tick)."""
    half = float(after.egos.length[ego]) / 2
    start, end = float(before.egos.progress[ego]) + half, float(after.egos.progress[ego]) + half
    return any(
        start < passage.entry <= end and passage.signal >= 0 and after.signals[passage.signal] == LightState.RED
        for passage in after.routes[ego].passages
    )
