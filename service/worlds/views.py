"""Answers about worlds."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dohyo.service.simulating.order import Late, Undriven
from dohyo.service.web.views import Moment, View
from dohyo.service.worlds.live.clock import Pace
from dohyo.service.worlds.live.world import LiveWorld
from dohyo.service.worlds.model import World, WorldStatus
from dohyo.sumo_networks.units import TICK_S


class EgoView(View):
    """An ego of a world.

    Attributes:
        name: Name of its mission.
        driver: Name of the worker that drives it; null: nobody does.
        driving: Whether it still drives.
    """

    name: str
    driver: str | None
    driving: bool


class WorldInvitationView(View):
    """An invitation to a world; its code cannot be read again.

    Attributes:
        world: Identifier of the world.
        code: Sent by the guest's worker when it joins.
    """

    world: str
    code: str


class WorldGuestView(View):
    """A guest of a world: an owner who was admitted by an invitation.

    Attributes:
        owner: Name of the owner.
        admitted: Time of the first admission; null: by a version of dohyo that did not keep it.
    """

    owner: Annotated[str, Field(examples=["team-blue"])]
    admitted: Moment | None


class WorldView(View):
    """A live scenario, or how it ended. It enters no ranking.

    Attributes:
        undriven: What an ego without a driver does: the autopilot drives it, it stands, or it leaves the road.
        deadline_s: Time for one decision, s.
        late: What happens to a driver that is late: its last decision is repeated, or it loses its place.
        pace: lockstep: each tick waits for all decisions; realtime: it begins when its time has come.
        speed: Simulated seconds per second of the wall clock, in real time.
        overruns: Ticks in real time that began late, since the simulation was too slow.
        resets: How often it has begun anew.
        stays: Whether it stays when all egos have ended their drives.
        egos: Its egos.
        actors: Number of actors that other simulators have put into it.
        reason: Reason of its end; null: it is live, or all egos have ended their drives.
        finished: Time of its end; null: it is live.
        recorded: Whether there is a record at its end.
        record_hash: Hash of the record; null: there is none.
    """

    id: Annotated[str, Field(examples=["wo-9f86d081884c7d65"])]
    owner: str
    status: WorldStatus
    network: str
    scenario: str
    seed: int
    tick: int
    time_s: float
    undriven: Undriven
    deadline_s: float
    late: Late
    pace: Pace
    speed: float
    overruns: int
    resets: int
    stays: bool
    egos: list[EgoView]
    actors: int
    created: Moment
    finished: Moment | None
    reason: str | None
    recorded: bool
    record_hash: str | None


def view_world(row: World, live: LiveWorld | None) -> WorldView:
    """A world, with what only a live one knows."""
    order, scenario = row.order, row.order["scenario"]
    drivers = live.seats.drivers if live else {}
    driving = live.simulation.driving if live else ()
    names = [mission["name"] for mission in scenario["missions"]]
    tick = live.simulation.tick if live else row.tick
    return WorldView(
        id=row.id,
        owner=row.owner,
        status=live.lockstep.status if live else row.status,
        network=scenario["network"],
        scenario=scenario["name"],
        seed=live.simulation.seed if live else order.get("seed", scenario["seed"]),
        tick=tick,
        time_s=round(tick * TICK_S, 3),
        undriven=order["undriven"],
        deadline_s=order["deadline_s"],
        late=order["late"],
        pace=live.lockstep.clock.pace if live else order.get("pace", "lockstep"),
        speed=live.lockstep.clock.speed if live else order.get("speed", 1.0),
        overruns=live.lockstep.clock.overruns if live else order.get("overruns", 0),
        resets=live.simulation.resets if live else order.get("resets", 0),
        stays=order.get("stays", False),
        actors=len(live.actors) if live else 0,
        egos=[EgoView(name=name, driver=drivers.get(name), driving=name in driving) for name in names],
        created=row.created,
        finished=row.finished,
        reason=row.reason,
        recorded=order["record"],
        record_hash=row.record_hash,
    )
