"""The audience of a world: the latest events for all, and no memory for those who do not read."""

from __future__ import annotations

import asyncio
import time

import pytest

from dohyo.service.errors import TooManyRequestsError
from dohyo.service.spectating.audience import Audience, Spectator


def test_a_slow_spectator_gets_the_latest_scene_and_costs_nothing() -> None:
    watched: list[bool] = []
    audience = Audience(watched.append, most=1)
    audience.tell("state", b"{}")

    async def watch() -> None:
        events = audience.events()
        assert await anext(events) == b"retry: 3000\n\n"
        with pytest.raises(TooManyRequestsError):
            audience.check_room()
        assert await anext(events) == b"event: state\ndata: {}\n\n"
        for tick in range(10_000):
            audience.tell("scene", b"%d" % tick)
        assert await anext(events) == b"event: scene\ndata: 9999\n\n"
        audience.tell("scene", b"10000")
        audience.end(b"{}")
        assert [event async for event in events] == [b"event: end\ndata: {}\n\n"]
        assert audience.watching == 0

    asyncio.run(watch())
    assert watched == [True]


def test_the_process_is_asked_for_scenes_only_while_somebody_watches() -> None:
    watched: list[bool] = []
    audience = Audience(watched.append, most=2)

    async def watch() -> None:
        one, other = audience.events(), audience.events()
        await anext(one)
        await anext(other)
        audience.tell("scene", b"1")
        await one.aclose()
        assert watched == [True]
        await other.aclose()
        assert watched == [True, False]
        again = audience.events()
        await anext(again)
        assert await anext(again) == b": still here\n\n"  # not the old scene
        audience.beat(time.monotonic() + 60.0)
        assert await anext(again) == b": still here\n\n"  # after a minute without events
        await again.aclose()

    asyncio.run(watch())


def test_a_scene_that_came_when_nobody_was_left_is_told_behind_the_stage() -> None:
    audience = Audience(lambda watched: None, most=2)

    async def watch() -> None:
        one = audience.events()
        await anext(one)
        await one.aclose()
        audience.tell("scene", b"1")  # it was on its way
        again = audience.events()
        await anext(again)
        audience.tell("stage", b"2")
        audience.tell("scene", b"3")
        assert await anext(again) == b"event: stage\ndata: 2\n\nevent: scene\ndata: 3\n\n"
        await again.aclose()

    asyncio.run(watch())


def test_a_spectator_whose_token_is_no_longer_valid_sees_no_more() -> None:
    watched: list[bool] = []
    audience = Audience(watched.append, most=2)

    async def watch() -> None:
        revoked, kept = (audience.events(Spectator(token)) for token in ("t-1", "t-2"))
        for events in (revoked, kept):
            await anext(events)
        assert audience.token_ids == {"t-1", "t-2"}
        audience.dismiss(lambda spectator: spectator.token_id == "t-1")
        audience.tell("scene", b"1")
        assert [event async for event in revoked] == []
        assert await anext(kept) == b"event: scene\ndata: 1\n\n"
        audience.dismiss(lambda spectator: spectator.token_id == "t-2")
        assert [event async for event in kept] == []
        assert (audience.watching, watched) == (0, [True, False])

    asyncio.run(watch())
