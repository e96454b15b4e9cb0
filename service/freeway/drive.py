"""Drives a freeway morning, whose planner is a policy worker or an ONNX policy.

The planner decides once a minute, before each publication. The rest is simulated here: the forecast is the last report,
and connected vehicles drive the plan's speed at their place, except near their leader, where the driver controls them.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

import numpy as np

from dohyo.agents.speed_planning.benchmark import morning_of
from dohyo.agents.speed_planning.env import FASTEST_MPS, FORECASTER, PLANNER, DissipationEnv, last_reports
from dohyo.evaluation.blame import RAISED, is_blameless
from dohyo.evaluation.episode.guarded_agent import WARM_UP_DEADLINE_S
from dohyo.evaluation.freeway.morning import MorningRecord, MorningScenario
from dohyo.evaluation.scores.traffic import OBSERVED_EVERY_S, Outcome, OutcomeWatch
from dohyo.service.freeway.planner import DECIDES_EVERY_S, STATE
from dohyo.service.policies.agent import OnnxPolicy
from dohyo.service.running.channel import SEEN, Channel
from dohyo.service.running.faults import fault_of, keep_fault
from dohyo.service.running.gauge import Gauge, watched
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.running.remote import Bridge
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.ego.control import InvalidActionError
from dohyo.sumo_networks.errors import AgentError, InvalidInputError
from dohyo.sumo_networks.freeway.process import TICK_S

NEAR_M, NEAR_S = 3.0, 0.6
"""Constant and speed-dependent part of the gap below which the driver controls the vehicle."""


Plan = Callable[[int, Float32Array, float], np.ndarray]
"""From the number of the plan, (lanes, cells) speeds and the time of day, m/s and s, to target speeds, m/s."""


def drive_morning(order: EpisodeOrder, scenario: MorningScenario, channel: Channel, gauge: Gauge) -> bytes:
    """Drives a morning and writes its record.

    Args:
        order: Order to drive.
        scenario: The order's morning.
        channel: Channel to the server.
        gauge: Times that the server reads.

    Returns:
        The last tick of a worker, as `SEEN`; nothing without a worker.

    Raises:
        InvalidInputError: The policy cannot be read.
    """
    env = DissipationEnv(morning_of(scenario.benchmark), scenario.seed)
    if not order.remote:
        gauge.begin()
        policy = OnnxPolicy(**order.info.settings)
        try:
            _drive(order, scenario, env, _planned_by(policy, gauge.watch))
        finally:
            policy.close()
        return b""
    shape = env.action_space(PLANNER).shape
    bridge = Bridge(channel, {PLANNER: PLANNER}, shape, lambda action: checked(action, shape), "wait")

    def plan(number: int, speeds: Float32Array, time_s: float) -> np.ndarray:
        bridge.show(number, {PLANNER: {STATE: speeds}}, time_s)
        with watched(gauge.watch_worker, order.act_deadline_s):
            return bridge.decision(PLANNER)

    plans, time_s = _drive(order, scenario, env, plan)
    return SEEN.pack(plans, time_s, bridge.missed, bridge.clipped)


def _planned_by(policy: OnnxPolicy, watch: Callable[[float], None]) -> Plan:
    """Plans of a policy; its process starts with the first, so that a model which cannot be loaded has failed."""

    def plan(number: int, speeds: Float32Array, time_s: float) -> np.ndarray:
        try:
            with watched(watch, policy.limits.decision_s if number else WARM_UP_DEADLINE_S):
                if number == 0:
                    policy.start()
                return checked(policy.act({STATE: speeds}), speeds.shape)
        except InvalidInputError as error:
            raise InvalidActionError(str(error)) from error
        except RAISED as error:
            if isinstance(error, AgentError) or is_blameless(error, policy):
                raise
            raise AgentError(f"the policy raised {type(error).__name__}: {error}") from error

    return plan


def _drive(order: EpisodeOrder, scenario: MorningScenario, env: DissipationEnv, plan: Plan) -> tuple[int, float]:
    """Drives and writes the record; returns the number of plans and the time of day at the end, s."""
    effects, tick, began = OutcomeWatch(), 0, time.monotonic()
    record = MorningRecord(scenario=scenario, benchmark=order.benchmark, agent=order.info)
    try:
        seen, _ = env.reset()
        while env.agents:
            # The environment's own state has the forecast of the step before.
            state = env.state_of(last_reports(seen[FORECASTER])).astype(np.float32)
            published = {PLANNER: plan(tick, state, env.world.time_s)}
            for _ in range(round(DECIDES_EVERY_S / TICK_S)):
                seen, *_ = env.step(
                    published | {FORECASTER: last_reports(seen[FORECASTER]).astype(np.float32)} | vehicles(seen)
                )
                if env.world.time_s % OBSERVED_EVERY_S < 1e-6:
                    effects.observe(env.world)
                if not env.agents:
                    break
            tick += 1
        facts: dict[str, object] = {"outcome": as_json(effects.outcome())}
    except AgentError as error:
        facts = {"failure": str(error)}
        keep_fault(order.directory, order.stem, fault_of(error))
    finally:
        env.close()
    facts |= {"plans": tick, "wall_s": round(time.monotonic() - began, 3)}
    record.model_copy(update=facts).write(order.directory, order.stem)
    return tick, env.world.time_s


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


def vehicles(seen: Mapping[str, Float32Array]) -> dict[str, Float32Array]:
    """Target speeds of connected vehicles: the plan's speed at their place, unless they are near their leader."""
    out = {}
    for name, own in seen.items():
        if name not in (FORECASTER, PLANNER) and own[1] > NEAR_M + NEAR_S * own[0] and own[3] > 0.0:
            out[name] = own[3:4]
    return out
