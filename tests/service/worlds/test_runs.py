"""Runs of worlds: a step of the run before a reset is told from one of the new run by its number of resets."""

from __future__ import annotations

import asyncio
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from dohyo.service.errors import GoneError
from dohyo.service.wire.requests import StaleRunError
from tests.service.worlds.clients import AHEAD, Client, scenario
from tests.service.worlds.scripted import ScriptedWorld, place, step

GHOST = {"name": "ghost", "kind": "car", "x_m": 40.0, "y_m": 0.0}


def send(client: Client, seat: Any, tick: int, ego: str, **more: Any) -> Any:
    body = {"tick": tick, "actions": {ego: AHEAD}} | more
    return client.send("POST", f"/v1/seats/{seat['seat']}/step", body, seat["token"])


def test_a_worker_that_has_not_noticed_a_reset_is_told_and_changes_nothing(client: Client) -> None:
    world = client.world(scenario=scenario(2).model_dump(mode="json"), deadline_s=60, stays=True)
    a, b = client.seat(world, "a", "front"), client.seat(world, "b", "middle", coupled=True)
    assert (a["resets"], b["resets"]) == (0, 0)
    with ThreadPoolExecutor(1) as pool:
        waiting = pool.submit(send, client, a, 0, "front", resets=0)
        client.order(world, "reset", {})
        waiting.result()
        told = client.now(a)
        assert (told["tick"], told["resets"]) == (0, 1)

        old = send(client, b, 0, "middle", resets=0, actors={"put": [GHOST]})
        assert old.status_code == 409, old.text
        problem = old.json()
        assert (problem["expected_resets"], problem["tick"]) == (1, 0)
        assert client.get(world)["actors"] == 0
        now = client.now(b)
        assert (now["tick"], now["resets"]) == (0, 1)

        stepping = pool.submit(send, client, a, 0, "front", resets=told["resets"])
        answer = send(client, b, now["tick"], "middle", resets=now["resets"]).json()
        assert (answer["tick"], answer["resets"], stepping.result().json()["tick"]) == (1, 1, 1)
        assert send(client, b, 0, "middle", resets=1).json() == answer, "a repeated step has the same answer"
        assert send(client, b, 0, "middle", resets=0).status_code == 409, "one of the run before has not"

        client.order(world, "reset", {})
        stepping = pool.submit(send, client, a, 0, "front", resets=2)
        answer = send(client, b, 0, "middle").json()  # an older client does not say of which run it is
        assert (answer["tick"], answer["resets"], stepping.result().json()["tick"]) == (1, 2, 1)
    assert client.send("POST", f"/v1/seats/{a['seat']}/step", {"tick": 1, "resets": -1}, a["token"]).status_code == 422


def test_a_step_of_the_run_before_moves_no_actor_takes_no_pose_and_shows_no_plan() -> None:
    async def reset() -> None:
        world = ScriptedWorld()
        world.show(0)
        a, b = await world.seat(place("a", "front")), await world.seat(place("b"))
        waiting = asyncio.create_task(step(world, a, 0, resets=0))
        await asyncio.sleep(0)
        resetting = asyncio.create_task(world.reset(None))
        await asyncio.sleep(0)
        assert world.steps.reply_to(b).resets == 0, "the tick that is shown is of the run before"
        meanwhile = asyncio.create_task(step(world, b, 0, resets=0))  # waits, as nothing of the new run is shown
        await asyncio.sleep(0)
        world.show(0)
        await resetting
        assert [(one.tick, one.resets) for one in (await waiting, await meanwhile)] == [(0, 1), (0, 1)]

        with pytest.raises(StaleRunError) as refused:
            await step(world, b, 0, resets=0, actors={"put": [GHOST]})
        assert (refused.value.expected_resets, refused.value.tick) == (1, 0)
        assert (len(world.actors), b.decision, world.decided) == (0, None, [])
        world.leave(b, "its worker left")
        with pytest.raises(GoneError, match="its worker left"):
            await step(world, b, 0, resets=0)

    asyncio.run(reset())


def test_two_resets_before_the_next_tick_are_both_counted() -> None:
    async def reset() -> None:
        world = ScriptedWorld()
        world.show(0)
        seat = await world.seat(place("a", "front"))
        resetting = [asyncio.create_task(world.reset(None)) for _ in range(2)]
        await asyncio.sleep(0)
        assert (world.steps.reply_to(seat).resets, seat.resets) == (0, 0)
        world.show(0)
        await asyncio.gather(*resetting)
        assert (world.steps.reply_to(seat).resets, seat.resets) == (2, 2)
        with pytest.raises(StaleRunError):
            await step(world, seat, 0, resets=1)

    asyncio.run(reset())
