"""Drives a freeway morning in lockstep with a policy worker, which is its planner.

The worker decides once a minute, before each publication. The rest is simulated here: the forecast is the last report,
and connected vehicles drive the plan's speed at their place, except near their leader, where the driver controls them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

import numpy as np

from dohyo.agents.speed_planning.benchmark import morning_of
from dohyo.agents.speed_planning.env import FASTEST_MPS, FORECASTER, PLANNER, DissipationEnv
from dohyo.evaluation.freeway.morning import MorningRecord, MorningScenario, write_morning
from dohyo.evaluation.scores.traffic import OBSERVED_EVERY_S, Outcome, OutcomeWatch
from dohyo.service.freeway.planner import DECIDES_EVERY_S, STATE
from dohyo.service.running.channel import SEEN, Channel
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.running.remote import Bridge
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import AgentError, InvalidInputError
from dohyo.sumo_networks.freeway.process import TICK_S

NEAR_M, NEAR_S = 3.0, 0.6
"""Constant and speed-dependent part of the gap below which the driver controls the vehicle."""


def drive_morning(
    order: EpisodeOrder, scenario: MorningScenario, channel: Channel, watch: Callable[[float], None]
) -> bytes:
    """Drives a morning and writes its record.

    Args:
        order: Order to drive.
        scenario: The order's morning.
        channel: Channel to the server.
        watch: Called before and after every decision; see `Gauge.watch_worker`.

    Returns:
        The last tick, as `SEEN`.
    """
    env = DissipationEnv(morning_of(scenario.benchmark), scenario.seed)
    space = env.action_space(PLANNER)
    bridge = Bridge(channel, {PLANNER: PLANNER}, space.shape, lambda action: checked(action, space.shape), "wait")
    effects, tick, began = OutcomeWatch(), 0, time.monotonic()
    record = MorningRecord(scenario=scenario, benchmark=order.benchmark, agent=order.info)
    try:
        seen, _ = env.reset()
        while env.agents:
            bridge.show(tick, {PLANNER: {STATE: seen[PLANNER]}}, env.world.time_s)
            watch(order.act_deadline_s)
            plan = {PLANNER: bridge.decision(PLANNER)}
            watch(0.0)
            for _ in range(round(DECIDES_EVERY_S / TICK_S)):
                seen, *_ = env.step(plan | {FORECASTER: last_report(seen[FORECASTER])} | vehicles(seen))
                if env.world.time_s % OBSERVED_EVERY_S < 1e-6:
                    effects.observe(env.world)
                if not env.agents:
                    break
            tick += 1
        facts: dict[str, object] = {"outcome": as_json(effects.outcome())}
    except AgentError as error:
        facts = {"failure": str(error)}
    finally:
        env.close()
    facts |= {"plans": tick, "wall_s": round(time.monotonic() - began, 3)}
    write_morning(order.directory, order.stem, record.model_copy(update=facts))
    return SEEN.pack(tick, env.world.time_s, bridge.missed, bridge.clipped)


def as_json(outcome: Outcome) -> dict[str, float | None]:
    """An outcome as JSON: None where no vehicle gave a value; without SUMO's fuel, which is not read."""
    values = {name: float(value) for name, value in outcome.as_dict().items() if name != "fuel_sumo_g_km"}
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def checked(action: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """A plan's target speeds.

    Raises:
        InvalidInputError: A wrong shape, or impossible speeds.
    """
    if action.shape != shape or not np.isfinite(action).all():
        raise InvalidInputError(f"expected finite target speeds {shape}, m/s, got shape {action.shape}")
    if action.min() < 0.0 or action.max() > FASTEST_MPS:
        raise InvalidInputError(f"expected target speeds of 0 to {FASTEST_MPS:g} m/s, got {action.min():g} to "
                                f"{action.max():g}")  # fmt: skip
    return action.astype(np.float32)


def last_report(history: Float32Array) -> Float32Array:
    """(S,), m/s: last reported speed of each segment; the speed of free traffic without a report."""
    out = np.full(history.shape[1], FASTEST_MPS, dtype=np.float32)
    for row in history:
        out = np.where(row >= 0.0, row, out)
    return out


def vehicles(seen: Mapping[str, Float32Array]) -> dict[str, Float32Array]:
    """Target speeds of connected vehicles: the plan's speed at their place, unless they are near their leader."""
    out = {}
    for name, own in seen.items():
        if name not in (FORECASTER, PLANNER) and own[1] > NEAR_M + NEAR_S * own[0] and own[3] > 0.0:
            out[name] = own[3:4]
    return out
