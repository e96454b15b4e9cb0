"""The lockstep of a world at moments that a test chooses: its process is a script."""

from __future__ import annotations

import asyncio

import pytest

from dohyo.service.errors import BusyError
from dohyo.service.running.channel import Kind
from tests.service.worlds.scripted import ScriptedWorld, place


def test_the_process_gets_its_order_before_anything_else() -> None:
    async def early() -> None:
        world = ScriptedWorld()
        watching = world.audience.events()
        await anext(watching)
        for refused in (world.join(place("sim", "front")), world.reset(None)):
            with pytest.raises(BusyError, match="has not begun yet"):
                await refused
        assert (world.kinds(), list(world.seats), world.resets) == ([], [], 0)
        world.show(0)
        assert world.kinds() == [Kind.WATCH]
        await world.seat(place("sim", "front"))
        await watching.aclose()
        assert world.process.sent[-1] == (Kind.WATCH, b"\0")

    asyncio.run(early())
