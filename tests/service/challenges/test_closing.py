"""Final boards on a machine whose clock is wrong for a while."""

from __future__ import annotations

from datetime import timedelta
from typing import Any

import pytest
from sqlalchemy import select

from dohyo.service.accounts.model import Role
from dohyo.service.boards.model import Ranking
from dohyo.service.challenges.closing import close_ended
from dohyo.service.webhooks.model import Delivery
from tests.service.challenges.driving import admit, complete, enter, in_days, make_challenge
from tests.service.clock import WrongClock
from tests.service.harness import Caller, Harness


class Cup:
    """A challenge with a phase that closes in a day, and two teams, of which one has 60 points."""

    def __init__(self, service: Harness, monkeypatch: pytest.MonkeyPatch) -> None:
        self.services, self.clock = service.services, WrongClock(monkeypatch)
        self.lab = service.caller("lab", Role.ORGANISER)
        self.ranking = make_challenge(self.lab, counts="best")
        self.ann, self.eve = admit(service, self.lab, "ann"), admit(service, self.lab, "eve")
        self.ann.agent("a")
        self.eve.agent("e")
        assert self.ann.post("/v1/webhooks", {"url": "https://example.org/hook"}).status_code == 201
        self.drive(self.ann, "a", 60.0)

    def drive(self, team: Caller, agent: str, score: float) -> None:
        complete(self.services.database, enter(team, agent, self.ranking)["id"], score)

    def at(self, hours: float) -> None:
        """The service looks for ended phases while the clock is so far ahead."""
        self.clock.shift = timedelta(hours=hours)
        close_ended(self.services)

    def stored(self) -> tuple[bool, list[str]]:
        """Whether the board is final, and the agents on the stored one."""
        with self.services.database.reading() as session:
            ranking = session.get_one(Ranking, self.ranking)
            return ranking.finalised is not None, [row["agent"] for row in (ranking.final or {"rows": []})["rows"]]

    def shown(self) -> tuple[bool, list[tuple[int, str]]]:
        """The board, and whether it is final."""
        board = self.lab.get("/v1/leaderboard", params={"ranking": self.ranking}).json()
        return board["final"], [(row["rank"], row["agent"]) for row in board["rows"]]

    def winners(self) -> list[list[str]]:
        """By each announcement on the challenge's page."""
        news: list[Any] = self.lab.get("/v1/challenges/cup").json()["announcements"]
        return [[one["agent"] for one in each["winners"]] for each in news]

    def messages(self) -> list[int]:
        """Places in each message to the webhook that the phase is final."""
        with self.services.database.reading() as session:
            bodies = [one.body for one in session.scalars(select(Delivery))]
        return sorted(body["places"] for body in bodies if body["event"] == "phase.final")


@pytest.fixture
def cup(stored: Harness, monkeypatch: pytest.MonkeyPatch) -> Cup:
    return Cup(stored, monkeypatch)


def test_a_clock_that_was_ahead_once_decides_no_phase(cup: Cup) -> None:
    cup.at(26)
    assert cup.shown() == (True, [(1, "a")])
    cup.at(0)
    assert (cup.stored(), cup.shown(), cup.winners()) == ((False, ["a"]), (False, [(1, "a")]), [])
    cup.drive(cup.eve, "e", 95.0)
    assert cup.shown() == (False, [(1, "e"), (2, "a")])
    cup.at(26)
    assert (cup.shown(), cup.winners()) == ((True, [(1, "e"), (2, "a")]), [["e"]])
    assert cup.messages() == [1, 2]


def test_a_run_that_ended_while_the_clock_was_ahead_was_in_time(cup: Cup) -> None:
    """Whether or not its phase seemed to have ended at that moment."""
    run = enter(cup.eve, "e", cup.ranking)["id"]
    cup.clock.shift = timedelta(hours=26)
    complete(cup.services.database, run, 95.0)
    cup.at(0)
    assert cup.shown() == (False, [(1, "e"), (2, "a")])
    cup.at(26)
    assert (cup.shown(), cup.winners()) == ((True, [(1, "e"), (2, "a")]), [["e"]])


def test_an_order_or_a_later_closing_shows_that_the_phase_goes_on(cup: Cup) -> None:
    """Also where nobody has looked for ended phases between the two ends."""
    cup.at(26)
    cup.clock.shift = timedelta()
    assert cup.winners() == []
    enter(cup.eve, "e", cup.ranking)
    assert cup.stored() == (False, ["a"])
    cup.at(26)
    assert cup.stored() == (True, ["a"])
    cup.clock.shift = timedelta()
    lab, path = cup.lab, f"/v1/challenges/cup/phases/{cup.ranking}"
    assert lab.client.request("PATCH", path, headers=lab.headers, json={"closes": in_days(2)}).status_code == 200
    assert cup.stored() == (False, ["a"])


def test_a_clock_that_was_behind_once_changes_and_announces_nothing(cup: Cup) -> None:
    """As of a machine that starts before it has asked for the time: all phases that have ended seem to go on."""
    cup.at(26)
    with cup.services.database.session() as session:
        ranking = session.get_one(Ranking, cup.ranking)
        assert ranking.final is not None
        ranking.final = {**ranking.final, "noted": "as it was"}
    cup.at(0)
    assert cup.stored() == (False, ["a"])
    cup.at(26)
    assert (cup.stored(), cup.messages(), cup.winners()) == ((True, ["a"]), [1], [["a"]])
    with cup.services.database.reading() as session:
        assert (session.get_one(Ranking, cup.ranking).final or {})["noted"] == "as it was"
