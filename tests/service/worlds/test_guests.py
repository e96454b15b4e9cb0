"""Guests of worlds: invited, listed, dismissed; a dismissed one is a stranger, whatever it holds and sends."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace
from typing import Any

import httpx
import pytest

from dohyo.service.accounts.access import Caller
from dohyo.service.accounts.model import Role
from dohyo.service.client.client import Client as LibraryClient
from dohyo.service.database.engine import Database
from dohyo.service.errors import NotFoundError
from dohyo.service.spectating.audience import Spectator
from dohyo.service.worlds import queries
from dohyo.service.worlds.admission import admit, dismiss
from dohyo.service.worlds.model import World
from tests.service.serving import Served
from tests.service.worlds.clients import AHEAD, PATIENCE_S, Client
from tests.service.worlds.scripted import ScriptedWorld, place

GHOST = {"name": "ghost", "kind": "car", "x_m": 0.0, "y_m": 0.0, "heading_rad": 0.0, "speed_mps": 0.0}


def of(served: Served, owner: str) -> Client:
    """A client of an owner."""
    return Client(served, served.ask("POST", "/v1/tokens", {"owner": owner, "role": "submitter"})["token"])


def invite(host: Client, world: str, **options: Any) -> str:
    answer = host.send("POST", f"/v1/worlds/{world}/invitations", options)
    assert answer.status_code == 201, answer.text
    return str(answer.json()["code"])


def guests(host: Client, world: str) -> list[str]:
    return [one["owner"] for one in host.send("GET", f"/v1/worlds/{world}/guests").json()["items"]]


def dismissed(host: Client, world: str, owner: str) -> int:
    """Status of the answer to a dismissal."""
    return host.send("DELETE", f"/v1/worlds/{world}/guests/{owner}").status_code


@contextmanager
def watching(client: Client, world: str) -> Iterator[Future[str]]:
    """A spectator who has got the first event; the result is all that follows until its stream ends."""
    begun, over = threading.Event(), threading.Event()

    def watch() -> str:
        headers = {"authorization": f"Bearer {client.token}"}
        with httpx.stream("GET", f"{client.url}/v1/worlds/{world}/events", headers=headers, timeout=PATIENCE_S) as one:
            assert one.status_code == 200
            text = ""
            for chunk in one.iter_text():
                text += chunk
                begun.set()
                if over.is_set():
                    break
            return text

    with ThreadPoolExecutor(1) as pool:
        stream = pool.submit(watch)
        try:
            assert begun.wait(PATIENCE_S)
            yield stream
        finally:
            over.set()


def test_a_dismissed_guest_loses_everything_and_no_old_code_brings_it_back(client: Client, served: Served) -> None:
    host, guest, third = of(served, "the-host"), of(served, "the-guest"), of(served, "the-third")
    world = host.world(undriven="stand", record=True, deadline_s=120)
    used, spare = (invite(host, world, egos=["back"], coupled=True) for _ in range(2))
    seat = guest.seat(world, "g", "back", coupled=True, invitation=used)
    own = host.seat(world, "h", "front", "middle")
    (listed,) = host.send("GET", f"/v1/worlds/{world}/guests").json()["items"]
    assert listed["owner"] == "the-guest"
    assert abs(datetime.fromisoformat(listed["admitted"]) - datetime.now(UTC)) < timedelta(minutes=5)
    for other, status in ((guest, 403), (third, 404)):
        assert other.send("GET", f"/v1/worlds/{world}/guests").status_code == status
        assert dismissed(other, world, "the-guest") == status
    assert dismissed(host, world, "nobody") == 404

    with watching(guest, world) as stream, watching(host, world) as kept, ThreadPoolExecutor(1) as pool:
        body = {"tick": 0, "actions": {"back": AHEAD}, "actors": {"put": [GHOST]}}
        waiting = pool.submit(guest.send, "POST", f"/v1/seats/{seat['seat']}/step", body, seat["token"])
        host.until(world, lambda found: found["actors"] == 1)
        assert dismissed(host, world, "the-guest") == 204
        assert "event: end" not in stream.result(PATIENCE_S), "the stream ends, the world does not"
        lost = waiting.result(PATIENCE_S)
        assert (lost.status_code, "dismissed" in lost.json()["detail"]) == (410, True)
        found = host.get(world)
        assert ([ego["driver"] for ego in found["egos"]], found["actors"]) == (["h", "h", None], 0)
        assert host.step(own, 0, front=AHEAD, middle=AHEAD).json()["tick"] == 1, "nobody waits for it"

        for code in (used, spare):
            assert guest.join(world, "g", "back", invitation=code).status_code == 404
        assert guest.join(world, "g", "back").status_code == 404
        assert guest.send("GET", f"/v1/seats/{seat['seat']}", token=seat["token"]).status_code == 410
        asked = [("GET", path) for path in ("", "/events", "/record", "/trajectory", "/replay", "/guests")]
        asked += [("POST", path) for path in ("/pause", "/resume", "/end", "/invitations", "/actors")]
        for method, path in asked:
            answer = guest.send(method, f"/v1/worlds/{world}{path}", {} if method == "POST" else None)
            assert answer.status_code == 404, path
        assert guest.send("GET", "/v1/worlds").json()["items"] == []
        assert (dismissed(host, world, "the-guest"), guests(host, world)) == (404, [])

        assert third.join(world, "t", "back", invitation=used).status_code == 404, "it was used"
        third.seat(world, "t", "back", invitation=spare)
        assert dismissed(host, world, "the-third") == 204
        guest.seat(world, "g", "back", invitation=invite(host, world))
        assert guests(host, world) == ["the-guest"], "a new invitation is the host's will"
        assert not kept.done(), "other spectators go on"
        host.order(world, "end")
    assert guest.send("GET", f"/v1/worlds/{world}/record").status_code == 200
    assert dismissed(host, world, "the-guest") == 204, "also from a world that has ended"
    assert guest.send("GET", f"/v1/worlds/{world}/record").status_code == 404


def test_an_owner_who_sends_a_code_of_its_own_world_uses_it_not_up(client: Client, served: Served) -> None:
    host, guest = of(served, "the-host-2"), of(served, "the-guest-2")
    world = host.world()
    code = invite(host, world)
    host.seat(world, "h", "front", invitation=code)
    client.seat(world, "a", "middle", invitation=code)  # an administrator
    assert guests(host, world) == []
    guest.seat(world, "g", "back", invitation=code)
    with LibraryClient(host.url, host.token) as library:
        assert [one["owner"] for one in library.guests(world)] == ["the-guest-2"]
        library.dismiss_guest(world, "the-guest-2")
        again = library.invite_to_world(world, ["back"])["code"]
    assert guest.join(world, "g", "front", invitation=again).status_code == 403
    host.order(world, "end")


def test_a_dismissal_that_was_answered_holds_against_a_guest_who_joins_all_the_time(
    client: Client, served: Served
) -> None:
    host, guest = of(served, "the-host-3"), of(served, "the-guest-3")
    world = host.world(undriven="stand")
    for _ in range(5):
        codes = [invite(host, world) for _ in range(3)]
        over = threading.Event()

        def insist(codes: list[str] = codes, over: threading.Event = over) -> set[int]:
            """Sends all codes again and again, as the same worker; the statuses of the answers."""
            got: set[int] = set()
            while not over.is_set():
                got |= {guest.join(world, "g", "back", invitation=code).status_code for code in codes}
                time.sleep(0.02)  # an owner has 600 requests a minute
            return got

        with ThreadPoolExecutor(2) as pool:
            insisting = [pool.submit(insist) for _ in range(2)]
            try:
                host.until(world, lambda found: found["egos"][2]["driver"] == "g")
                assert dismissed(host, world, "the-guest-3") == 204
                assert host.get(world)["egos"][2]["driver"] is None
                time.sleep(0.2)
            finally:
                over.set()
            answers = {status for one in insisting for status in one.result(PATIENCE_S)}
        assert answers <= {201, 404, 410}
        assert (host.get(world)["egos"][2]["driver"], guests(host, world)) == (None, [])
        assert guest.send("GET", f"/v1/worlds/{world}").status_code == 404
    host.order(world, "end")


HOST, GUEST = (Caller(owner, Role.SUBMITTER, f"tok-{owner}", public=False) for owner in ("lab", "guest"))


@pytest.mark.parametrize("first", ["admission", "dismissal"])
def test_an_admission_and_a_dismissal_that_meet_leave_no_guest(
    first: str, database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first one is held in its transaction, as by a slow disk, while the second one comes."""
    with database.session() as session:
        session.add(World(id="world", owner="lab", order={}))
    name = {"admission": "add_guest", "dismissal": "remove_guest"}[first]
    begun, go_on, real = threading.Event(), threading.Event(), getattr(queries, name)

    def held(*arguments: Any) -> Any:
        begun.set()
        assert go_on.wait(PATIENCE_S)
        return real(*arguments)

    async def meet() -> None:
        world = ScriptedWorld()
        world.show(0)
        worlds = SimpleNamespace(find=lambda *_, **__: world, admission=asyncio.Lock())
        services: Any = SimpleNamespace(worlds=worlds, database=database)
        used, spare = (world.guests.invite(None, coupled=True) for _ in range(2))
        await admit(services, GUEST, "world", used)
        await world.seat(place("g", "front", owner="guest"))
        monkeypatch.setattr(queries, name, held)
        admitting = [lambda: admit(services, GUEST, "world", spare), lambda: dismiss(services, HOST, "world", "guest")]
        order = admitting if first == "admission" else admitting[::-1]
        one = asyncio.create_task(order[0]())
        assert await asyncio.to_thread(begun.wait, PATIENCE_S)
        if first == "admission":
            one.cancel()  # its client is gone, its transaction is not
        other = asyncio.create_task(order[1]())
        await asyncio.sleep(0.1)
        waits_for_its_turn = not other.done()
        go_on.set()
        assert waits_for_its_turn
        if first == "admission":
            await other
        else:
            await one
            with pytest.raises(NotFoundError, match="no open invitation"):
                await other
        assert ([*world.seats], world.guests.has("guest")) == ([], False)

    asyncio.run(meet())
    with database.reading() as session:
        assert queries.list_guests(session, "world", 10, None) == []


def test_events_that_begin_after_the_dismissal_of_their_spectator_are_none() -> None:
    async def watch() -> None:
        world = ScriptedWorld()
        world.show(0)
        world.guests.admit(world.guests.invite(None, coupled=False), "guest")
        streams = [world.audience.events(Spectator("", "guest"), lambda: world.guests.has("guest")) for _ in range(2)]
        await anext(streams[0])
        world.dismiss_guest("guest")
        assert [[event async for event in one] for one in streams] == [[], []]
        assert world.audience.watching == 0

    asyncio.run(watch())
