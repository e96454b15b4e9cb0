"""Judges a day of forecasts: in this process of built-in and ONNX forecasters, or in lockstep with a policy worker."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dohyo.agents.forecasting.agent import CLOCK_SENSOR, HISTORY_SENSOR, ForecastAgent, make_forecast_agent
from dohyo.agents.forecasting.data.windows import Windows
from dohyo.agents.forecasting.judge import Forecast, day_windows, judge_day
from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import agent_info
from dohyo.evaluation.blame import RAISED, is_blameless
from dohyo.evaluation.episode.deadline import deadline
from dohyo.evaluation.episode.guarded_agent import ACT_DEADLINE_S, WARM_UP_DEADLINE_S
from dohyo.evaluation.freeway.day import FORECASTER, DayRecord, DayScenario, check_forecast
from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.forecasting.interface import POLICY, forecast_shape
from dohyo.service.forecasting.policy import OnnxForecaster
from dohyo.service.running.channel import SEEN, Channel
from dohyo.service.running.faults import FaultWatch, keep_fault
from dohyo.service.running.gauge import Gauge, watched
from dohyo.service.running.order import EpisodeOrder, check_unchanged
from dohyo.service.running.remote import Bridge
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import AgentError, InvalidInputError


def forecast_day(order: EpisodeOrder, scenario: DayScenario, channel: Channel, gauge: Gauge) -> bytes:
    """Judges the forecaster of an order on its day and writes the record.

    Args:
        order: Order to judge.
        scenario: The order's day.
        channel: Channel to the server.
        gauge: Times that the server reads.

    Returns:
        The last tick of a worker, as `SEEN`; nothing without a worker.

    Raises:
        InvalidInputError: The forecaster cannot be made, or differs from the submitted one.
        SimulationError: SUMO failed while the day was made.
    """
    if order.verdict is not None:
        failed = DayRecord(scenario=scenario, benchmark=order.benchmark, agent=order.info, failure=order.verdict[1])
        keep_fault(order.directory, order.stem, order.verdict[0])
        failed.write(order.directory, order.stem)
        return b""
    if order.remote:
        return _forecast_remotely(order, scenario, channel, gauge)
    gauge.begin()
    windows = day_windows(scenario)
    agent = _made(order.info)
    try:
        _judge(order, scenario, windows, _Watched(agent, order.act_deadline_s, gauge.watch))
    finally:
        agent.close()
    return b""


def _forecast_remotely(order: EpisodeOrder, scenario: DayScenario, channel: Channel, gauge: Gauge) -> bytes:
    windows, shape = day_windows(scenario), forecast_shape()
    bridge = Bridge(channel, order.wire_names, shape, lambda given: check_forecast(given, shape), order.slow_policy)
    tick, last_s = 0, 0.0

    def ask(history: Float32Array, time_s: float) -> ArrayLike:
        nonlocal tick, last_s
        seen = observation(history, time_s)
        bridge.show(tick, {FORECASTER: {name: seen[name] for name in order.info.sensors}}, time_s)
        tick, last_s = tick + 1, time_s
        with watched(gauge.watch_worker, order.act_deadline_s):
            return bridge.decision(FORECASTER)

    _judge(order, scenario, windows, ask)
    return SEEN.pack(tick, last_s, bridge.missed, bridge.clipped)


def judge_again(record: DayRecord, policy: Path | None = None) -> DayRecord:
    """Record of the same forecaster on the same day, judged again in this process.

    Args:
        record: Record of a built-in or ONNX forecaster.
        policy: ONNX file of the record's policy; None: it lies in the folder of uploaded policies.

    Raises:
        InvalidInputError: The forecaster cannot be made, or has changed since.
        SimulationError: SUMO failed while the day was made.
    """
    agent = _made(record.agent, policy)
    try:
        asks = _Watched(agent, ACT_DEADLINE_S, lambda seconds: None)
        return judge_day(record.scenario, day_windows(record.scenario), asks, record.agent, record.benchmark)
    finally:
        agent.close()


def observation(history: Float32Array, time_s: float) -> dict[str, Float32Array]:
    """What a forecaster sees, by sensor."""
    return {HISTORY_SENSOR: history, CLOCK_SENSOR: np.array([time_s], dtype=np.float32)}


def _judge(order: EpisodeOrder, scenario: DayScenario, windows: Windows, forecast: Forecast) -> None:
    faults = FaultWatch()

    def watched_forecast(history: Float32Array, time_s: float) -> ArrayLike:
        with faults.watching():
            return forecast(history, time_s)

    record = judge_day(scenario, windows, watched_forecast, order.info, order.benchmark)
    if record.failure is not None:
        keep_fault(order.directory, order.stem, faults.of())
    record.write(order.directory, order.stem)


def _made(info: AgentInfo, policy: Path | None = None) -> ForecastAgent:
    """The forecaster of a submission.

    Raises:
        InvalidInputError: It cannot be made, or is another one than was submitted.
    """
    if info.entry == POLICY:
        settings: dict[str, Any] = dict(info.settings) | ({} if policy is None else {"path": policy})
        agent: ForecastAgent = OnnxForecaster(**settings)
    else:
        agent = make_forecast_agent(resolve(info.entry), info.settings)
    try:
        check_unchanged(info, agent_info(agent, info.entry, info.settings))  # type: ignore[arg-type]  # it reads the spec alone
    except InvalidInputError:
        agent.close()
        raise
    return agent


class _Watched:
    """A forecaster under deadlines; the server ends this process where a call never returns."""

    def __init__(self, agent: ForecastAgent, act_deadline_s: float, watch: Callable[[float], None]) -> None:
        self._agent, self._act_deadline_s, self._watch, self._begun = agent, act_deadline_s, watch, False

    def __call__(self, history: Float32Array, time_s: float) -> ArrayLike:
        """See `Forecast`; the first call prepares the forecaster, and may compile."""
        seconds = self._act_deadline_s if self._begun else WARM_UP_DEADLINE_S
        try:
            with watched(self._watch, seconds), deadline(seconds, f"agent '{self._agent.spec.name}'"):
                if not self._begun:
                    self._agent.reset(0)
                answer = self._agent.act(observation(history, time_s))
        except RAISED as error:
            if isinstance(error, AgentError) or is_blameless(error, self._agent):
                raise
            raise AgentError(f"act raised {type(error).__name__}: {error}") from error
        self._begun = True
        return answer
