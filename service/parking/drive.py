"""Drives a parking lot: in this process by built-in and ONNX agents, or in lockstep with a policy worker."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache

from dohyo.agents.registry import resolve
from dohyo.evaluation.agent import agent_info
from dohyo.evaluation.parking.agent import FailedAgent, ParkingAgent, ParkingSpec
from dohyo.evaluation.parking.benchmark import LotScenario
from dohyo.evaluation.parking.deadlines import Call, Deadlines, Limit, unlimited
from dohyo.evaluation.parking.drive import drive_lot
from dohyo.evaluation.parking.lot_files import write_lot
from dohyo.evaluation.parking.running import close_agents, make_agents
from dohyo.evaluation.records.specifications import Status
from dohyo.service.parking.interface import ACTION_SHAPE, check_action, state_of
from dohyo.service.running.channel import SEEN, Channel
from dohyo.service.running.faults import FaultWatch, keep_fault
from dohyo.service.running.gauge import Gauge, watched
from dohyo.service.running.order import EpisodeOrder, check_unchanged
from dohyo.service.running.remote import Bridge
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.parking import kart
from dohyo.sumo_networks.parking.rows import LotView
from dohyo.sumo_networks.parking.world import ParkingWorld


def park(order: EpisodeOrder, scenario: LotScenario, channel: Channel, gauge: Gauge) -> bytes:
    """Drives an order's lot and writes its record.

    Args:
        order: Order to drive.
        scenario: The order's lot.
        channel: Channel to the server.
        gauge: Times that the server reads.

    Returns:
        The last tick of a worker, as `SEEN`; nothing without a worker.

    Raises:
        InvalidInputError: The agent cannot be made, or differs from the submitted one.
    """
    if order.verdict is not None:
        _drive(order, scenario, [FailedAgent(order.verdict[1])] * scenario.benchmark.karts)
        return b""
    if order.remote:
        return _park_remotely(order, scenario, channel, gauge)
    gauge.begin()
    agents = make_agents(scenario.benchmark, resolve(order.info.entry), order.info.settings)
    try:
        there = agent_info(agents[0], order.info.entry, order.info.settings)  # type: ignore[arg-type]  # it reads the spec alone
        check_unchanged(order.info, there)
        _drive(order, scenario, agents, limit=Deadlines(order.act_deadline_s, gauge.watch).limit)
    finally:
        close_agents(agents)
    return b""


def _park_remotely(order: EpisodeOrder, scenario: LotScenario, channel: Channel, gauge: Gauge) -> bytes:
    bridge = Bridge(channel, order.wire_names, ACTION_SHAPE, check_action, order.slow_policy)
    (sensor,) = order.info.sensors
    spec, tick = ParkingSpec(name=order.info.name, state=state_of(sensor)), 0

    def show(number: int, observations: Mapping[int, Float32Array]) -> None:
        nonlocal tick
        tick = number
        bridge.show(number, {order.egos[one]: {sensor: seen} for one, seen in observations.items()})

    agents = [_Remote(spec, bridge, ego, gauge.watch_worker, order.act_deadline_s) for ego in order.egos]
    _drive(order, scenario, agents, show)
    return SEEN.pack(tick + 1, round((tick + 1) * kart.TICK_S, 3), bridge.missed, bridge.clipped)


def _drive(
    order: EpisodeOrder,
    scenario: LotScenario,
    agents: Sequence[ParkingAgent],
    show: Callable[[int, Mapping[int, Float32Array]], None] = lambda tick, observations: None,
    limit: Limit = unlimited,
) -> None:
    benchmark, faults = scenario.benchmark, FaultWatch()
    noting = _noting(faults, limit)
    drive = drive_lot(_world(benchmark.karts), benchmark, scenario.seed, agents, order.info, show, noting)
    failed = [faults.of(number) for number, one in enumerate(drive.record.karts) if one.ending == "failed"]
    if failed:
        keep_fault(order.directory, order.stem, failed[0] if order.verdict is None else order.verdict[0])
    write_lot(order.directory, order.stem, drive)


def _noting(faults: FaultWatch, limit: Limit) -> Limit:
    """A limit that also notes how the calls of the karts' agents fail."""

    @contextmanager
    def limited(call: Call, kart: int, agent: ParkingAgent) -> Iterator[None]:
        setting_up = Status.AGENT_SETUP if call == "reset" else Status.AGENT_RAISED
        with faults.watching(kart, setting_up), limit(call, kart, agent):
            yield

    return limited


@cache
def _world(karts: int) -> ParkingWorld:
    return ParkingWorld(1, karts)


@dataclass(slots=True)
class _Remote:
    """A kart that a worker drives."""

    spec: ParkingSpec
    bridge: Bridge
    ego: str
    watch: Callable[[float], None]
    act_deadline_s: float

    def reset(self, seed: int) -> None:
        """See `ParkingAgent`."""

    def look(self, lot: LotView, number: int) -> None:
        """See `ParkingAgent`."""

    def close(self) -> None:
        """See `ParkingAgent`."""

    def act(self, observation: Float32Array) -> Float32Array:
        """The worker's action for the observation that it has already received."""
        with watched(self.watch, self.act_deadline_s):
            return self.bridge.decision(self.ego)
