"""A clock that goes wrong: the service's time, shifted."""

from __future__ import annotations

from datetime import datetime, timedelta, tzinfo

import pytest

from dohyo.service.database import base


class WrongClock:
    """The time that the service believes, from its making to the end of the test.

    Attributes:
        shift: By which it is ahead.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.shift = timedelta()
        clock = self

        class Shifted(datetime):
            @classmethod
            def now(cls, tz: tzinfo | None = None) -> datetime:  # type: ignore[override]
                return datetime.now(tz) + clock.shift

        monkeypatch.setattr(base, "datetime", Shifted)
