"""Process of a freeway morning in which a policy worker is the planner.

Started like `dohyo.service.running.child`. The worker decides once a minute, before each publication. The rest is
simulated here: the forecast is the last report, and connected vehicles drive the plan's speed at their place, except
near their leader, where the driver controls them.
"""

from __future__ import annotations

import json
import math
import socket
import sys
import threading
import traceback
from collections.abc import Mapping
from typing import Any

import numpy as np

from dohyo.agents.speed_planning.benchmark import morning_of
from dohyo.agents.speed_planning.env import FASTEST_MPS, FORECASTER, PLANNER, DissipationEnv
from dohyo.evaluation.scores.traffic import OBSERVED_EVERY_S, Outcome, OutcomeWatch
from dohyo.service.freeway.order import FreewayOrder
from dohyo.service.running.channel import Channel, Kind
from dohyo.service.running.child import end_with_server
from dohyo.service.running.remote import SEEN, Bridge
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import AgentError, InvalidInputError
from dohyo.sumo_networks.freeway.process import TICK_S

STATE = "speeds"
"""The planner's only sensor: (L, X) lane by sub-segment, m/s."""
NEAR_M, NEAR_S = 3.0, 0.6
"""Constant and speed-dependent part of the gap below which the driver controls the vehicle."""


def main() -> None:
    """Drives mornings until the server is gone."""
    channel = Channel(socket.socket(fileno=int(sys.argv[1])))
    threading.Thread(target=end_with_server, args=(channel.fileno(),), daemon=True).start()
    while (frame := channel.receive()) is not None:
        if frame[0] is not Kind.ORDER:
            continue
        try:
            answer = Kind.FINISHED, drive_morning(FreewayOrder.model_validate_json(frame[1]), channel)
        except InvalidInputError as error:
            answer = Kind.IMPOSSIBLE, str(error).encode()
        except Exception as error:  # an internal error: the server decides whether to try again
            traceback.print_exc()
            answer = Kind.FAILED, f"{type(error).__name__}: {error}"[:1000].encode()
        channel.send(*answer)


def drive_morning(order: FreewayOrder, channel: Channel) -> bytes:
    """Drives a morning in lockstep with its planner.

    Returns:
        The last tick, as `SEEN`, then the outcome of the morning, as JSON.
    """
    env = DissipationEnv(morning_of(order.benchmark), order.seed)
    space = env.action_space(PLANNER)
    bridge = Bridge(channel, {PLANNER: PLANNER}, space.shape, lambda action: checked(action, space.shape), "wait")
    watch, tick = OutcomeWatch(), 0
    became: dict[str, Any]
    try:
        seen, _ = env.reset()
        while env.agents:
            bridge.show(tick, {PLANNER: {STATE: seen[PLANNER]}}, env.world.time_s)
            plan = {PLANNER: bridge.decision(PLANNER)}
            for _ in range(round(order.decision_s / TICK_S)):
                seen, *_ = env.step(plan | {FORECASTER: last_report(seen[FORECASTER])} | vehicles(seen))
                if env.world.time_s % OBSERVED_EVERY_S < 1e-6:
                    watch.observe(env.world)
                if not env.agents:
                    break
            tick += 1
        became = {"status": "finished", "outcome": told(watch.outcome())}
    except AgentError as error:
        became = {"status": "failed", "detail": str(error)}
    finally:
        env.close()
    return SEEN.pack(tick, env.world.time_s, bridge.missed, bridge.clipped) + json.dumps(became).encode()


def told(outcome: Outcome) -> dict[str, float | None]:
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


if __name__ == "__main__":
    main()
