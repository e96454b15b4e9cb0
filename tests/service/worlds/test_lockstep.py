"""The lockstep of a world at moments that a test chooses: its process is a script."""

from __future__ import annotations

import asyncio
from typing import Any

import pytest

from dohyo.service.errors import BusyError, ConflictError, TooLargeError, TooManyRequestsError
from dohyo.service.running.channel import Kind
from dohyo.service.simulating.actors import ActorChange, ActorRow
from dohyo.service.worlds.live.seats import MOST_WITHOUT_EGOS
from dohyo.service.worlds.model import WorldStatus
from dohyo.sumo_networks.errors import InvalidInputError
from tests.service.worlds.scripted import ScriptedWorld, place, step


def test_the_process_gets_its_order_before_anything_else() -> None:
    async def early() -> None:
        world = ScriptedWorld()
        watching = world.audience.events()
        await anext(watching)
        for refused in (world.join(place("sim", "front")), world.reset(None)):
            with pytest.raises(BusyError, match="has not begun yet"):
                await refused
        assert (world.kinds(), list(world.seats), world.simulation.resets) == ([], [], 0)
        world.show(0)
        assert world.kinds() == [Kind.WATCH]
        await world.seat(place("sim", "front"))
        await watching.aclose()
        assert world.process.sent[-1] == (Kind.WATCH, b"\0")

    asyncio.run(early())


DEADLINE_S = 10.0
GHOST = {"name": "ghost", "kind": "car", "x_m": 40.0, "y_m": 0.0}


def at(x_m: float, speed_mps: float = 10.0) -> list[float]:
    """A pose on the x-axis."""
    return [x_m, 0.0, 0.0, speed_mps, 0.0]


async def after(awaited: Any, world: ScriptedWorld, tick: int) -> Any:
    """The answer that the next tick gives."""
    waiting = asyncio.create_task(awaited)
    await asyncio.sleep(0)
    world.show(tick)
    return await waiting


@pytest.mark.parametrize("ticks", [0, 3])
def test_a_step_that_comes_while_a_reset_runs_enters_nothing_into_the_new_run(ticks: int) -> None:
    async def reset() -> None:
        world = ScriptedWorld()
        world.show(0)
        seat = await world.seat(place("sim", "front", control="pose"))
        for tick in range(ticks):
            await after(step(world, seat, tick, at(1.0 + tick)), world, tick + 1)
        resetting = asyncio.create_task(world.reset(None))
        await asyncio.sleep(0)
        old = step(world, seat, ticks, at(1.0 + ticks), actors={"put": [GHOST]}, plans={"front": [(1.0, 0.0)]})
        answer = await after(old, world, 0)
        await resetting
        assert (answer.tick, answer.resets, len(world.actors), len(world.decided)) == (0, 1, 0, ticks)
        assert (await after(step(world, seat, 0, at(0.0, 0.0)), world, 1)).tick == 1
        assert world.decided[-1].actors.put == []

    asyncio.run(reset())


def test_a_step_that_is_refused_changes_nothing() -> None:
    async def refuse() -> None:
        world = ScriptedWorld()
        world.show(0)
        seat = await world.seat(place("sim", "front", control="pose"))
        world.put_actors(ActorChange([ActorRow("of-the-owner", "car", 80.0, 0.0)]))
        plan, foreign = {"front": [(1.0, 0.0)]}, GHOST | {"name": "of-the-owner"}
        for fault, refusal in [
            ({"action": at(50.0), "actors": {"put": [GHOST]}, "plans": plan}, InvalidInputError),
            ({"action": at(1.0), "actors": {"put": [GHOST]}, "plans": {"back": []}}, InvalidInputError),
            ({"action": at(1.0), "actors": {"put": [GHOST, foreign]}, "plans": plan}, ConflictError),
            ({"action": [[[]]] * 50_000, "actors": {"put": [GHOST]}, "plans": plan}, TooLargeError),
        ]:
            with pytest.raises(refusal):
                await step(world, seat, 0, **fault)
        assert (len(world.actors), seat.clipped, world.decided) == (1, 0, [])
        await after(step(world, seat, 0, at(-0.5, -10.0)), world, 1)  # no pose was taken to compare this one with
        assert [row.name for row in world.decided[0].actors.put] == ["of-the-owner"]
        spectators = world.audience.events()
        await anext(spectators)
        world.process.seen(Kind.SCENE, b"{}")
        assert b"plans" not in await anext(spectators)
        await spectators.aclose()

    asyncio.run(refuse())


def test_a_reset_that_takes_long_costs_no_driver_its_place() -> None:
    async def reset() -> None:
        world = ScriptedWorld(pace="realtime", deadline_s=DEADLINE_S)
        world.show(0)
        seat = await world.seat(place("sim", "front"))
        await after(step(world, seat, 0), world, 1)
        resetting = asyncio.create_task(world.reset(None))
        await asyncio.sleep(0)
        world.time.now_s += 1.5 * DEADLINE_S
        world.sweep()
        world.show(0)
        await resetting
        world.sweep()
        assert list(world.seats) == [seat]

    asyncio.run(reset())


def test_a_reset_forgets_the_ticks_that_a_paused_world_had_left() -> None:
    async def reset() -> None:
        world = ScriptedWorld()
        world.show(0)
        seat = await world.seat(place("sim", "front"))
        world.lockstep.pause()
        world.lockstep.allow(10)
        await after(step(world, seat, 0), world, 1)
        await after(world.reset(None), world, 0)
        waiting = asyncio.create_task(step(world, seat, 0))
        await asyncio.sleep(0)
        assert (world.lockstep.status, len(world.decided)) == (WorldStatus.PAUSED, 1)
        world.lockstep.allow(1)
        world.show(1)
        assert (await waiting).tick == 1

    asyncio.run(reset())


@pytest.mark.parametrize("shown", [False, True])
def test_a_step_that_was_repeated_still_moves_its_actors(shown: bool) -> None:
    async def repeat() -> None:
        world = ScriptedWorld(deadline_s=DEADLINE_S)
        world.show(0)
        seat = await world.seat(place("sim", "front"))
        await after(step(world, seat, 0, actors={"put": [GHOST]}), world, 1)
        world.time.now_s += 1.5 * DEADLINE_S
        world.sweep()  # repeats its decision
        late = {"put": [GHOST | {"x_m": 41.0}]}
        if shown:
            world.show(2)
            answers = [await step(world, seat, 1, actors=late) for _ in range(2)]  # a step may be sent again
        else:
            answers = [await after(step(world, seat, 1, actors=late), world, 2)]
        assert {(one.tick, one.missed) for one in answers} == {(2, 1)}
        await after(step(world, seat, 2), world, 3)
        again = await step(world, seat, 2, actors={"remove": ["ghost"]})  # was taken: its repetition has no effect
        assert (again.tick, len(world.actors)) == (3, 1)
        assert [[row.x_m for row in one.actors.put] for one in world.decided] == [[40.0], [], [41.0]]

    asyncio.run(repeat())


@pytest.mark.parametrize("pace", ["realtime", "lockstep"])
def test_a_world_that_runs_in_real_time_before_spectators_is_not_idle(pace: str) -> None:
    async def watch() -> None:
        world = ScriptedWorld(pace=pace)
        world.show(0)
        world.lockstep.resume()

        def is_heard() -> bool:
            before = world.heard
            world.time.now_s += 1.0
            world.sweep()
            return world.heard > before

        assert not is_heard()
        spectators = world.audience.events()
        await anext(spectators)
        assert is_heard() == (pace == "realtime")
        world.lockstep.pause()
        assert not is_heard()
        await spectators.aclose()

    asyncio.run(watch())


def test_an_owner_has_a_few_places_without_an_ego() -> None:
    async def join() -> None:
        world = ScriptedWorld()
        world.show(0)
        for number in range(MOST_WITHOUT_EGOS):
            await world.seat(place(f"sim-{number}", owner="guest"))
        with pytest.raises(TooManyRequestsError, match="at most 8 places without an ego"):
            await world.join(place("one-more", owner="guest"))
        await world.seat(place("sim-0", owner="guest"))  # it joins again
        await world.seat(place("driver", "front", owner="guest"))
        await world.seat(place("other"))
        assert len(world.seats) == MOST_WITHOUT_EGOS + 2

    asyncio.run(join())
