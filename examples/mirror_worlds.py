"""Two worlds that mirror each other's egos: each is in the other one as an actor, and both tick together.

    python examples/mirror_worlds.py http://127.0.0.1:8000 TOKEN WORLD OTHER_WORLD

Needs nothing but Python. For worlds at two services, give SERVER TOKEN WORLD twice.
"""

from __future__ import annotations

import sys
from typing import Any

from world_worker import leave, post, run, told

Reply = dict[str, Any]


class Side:
    """A place in one of the worlds."""

    def __init__(self, server: str, token: str, world: str, other: str) -> None:
        """Joins the world, by a name of this pair: a world may have several mirrors."""
        asked = {"name": f"mirror-{other}", "coupled": True}
        self.world, self.server, self.seat = world, server, post(f"{server}/v1/worlds/{world}/join", token, asked)
        self.reply: Reply = self.seat | {"done": False}
        self.there: set[str] = set()

    def __enter__(self) -> Side:
        """The place, which is left at the end."""
        return self

    def __exit__(self, *_: object) -> None:
        """Leaves the world, also at Ctrl-C: its actors go, and it does not wait for them at each tick."""
        leave(self.server, self.seat)

    def egos(self) -> list[Reply]:
        """Egos of this world as actors for the other one."""
        rows = [row for row in self.reply["actors"] if row["role"] == "ego"]
        return [row | {"name": f"mirrored:{self.world}:{row['name']}"} for row in rows]

    def step(self, egos: list[Reply]) -> None:
        """Puts the egos of the other world, and waits for the next tick."""
        names = {row["name"] for row in egos}
        actors = {"put": egos, "remove": sorted(self.there - names)}
        step = {"tick": self.reply["tick"], "resets": self.reply["resets"], "actions": {}, "actors": actors}
        self.reply = post(f"{self.server}/v1/seats/{self.seat['seat']}/step", self.seat["token"], step)
        self.there = names


def main() -> None:
    """Mirrors until the egos of one world have ended their drives, and leaves both."""
    given = told("SERVER TOKEN WORLD OTHER_WORLD", "SERVER TOKEN WORLD OTHER_SERVER OTHER_TOKEN OTHER_WORLD")
    one, other = given[:3], given[3:] if len(given) == 6 else [*given[:2], given[3]]
    if (one[0], one[2]) == (other[0], other[2]):
        sys.exit(f"expected two different worlds, got {one[2]} twice")
    with Side(*one, other[2]) as first, Side(*other, one[2]) as second:
        print("mirrored", flush=True)
        while not (first.reply["done"] or second.reply["done"]):
            seen = first.egos(), second.egos()
            first.step(seen[1])
            second.step(seen[0])


if __name__ == "__main__":
    run(main)
