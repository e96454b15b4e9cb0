"""Server-sent events: the lines of a stream as events (WHATWG HTML, section 9.2)."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any, Final

MEDIA_TYPE: Final = "text/event-stream"
HEARTBEAT_S: Final = 15.0
"""Time between two lines of a live stream, at most."""
SILENCE_S: Final = 3 * HEARTBEAT_S
"""Silence after which a stream is dead."""


@dataclass(frozen=True, slots=True)
class Event:
    """An event with a JSON document."""

    name: str
    document: dict[str, Any]

    @property
    def has_state(self) -> bool:
        """Whether the document is the whole state of the resource, and not about a part of it."""
        return self.name in ("state", "end")


@dataclass(slots=True)
class EventParser:
    """Parses the lines of one resource's streams, and remembers how to continue them.

    Attributes:
        last_id: Identifier of the newest event, for the header `Last-Event-ID`.
        retry_s: Time before the stream is opened again, which the service may change.
    """

    retry_s: float
    last_id: str = ""
    _name: str = "message"
    _data: list[str] = field(default_factory=list)

    @property
    def headers(self) -> dict[str, str]:
        """Headers of the request that opens a stream, and begins it after the newest event."""
        self._name, self._data = "message", []  # an event that a broken stream began
        return {"accept": MEDIA_TYPE} | ({"last-event-id": self.last_id} if self.last_id else {})

    def feed(self, line: str) -> Event | None:
        """The event that ends with this line.

        Raises:
            ValueError: Its data are not JSON.
        """
        name, _, value = line.partition(":")
        value = value.removeprefix(" ")
        if name == "event":
            self._name = value
        elif name == "data":
            self._data.append(value)
        elif name == "id":
            self.last_id = value
        elif name == "retry" and value.isdecimal():
            self.retry_s = int(value) / 1000
        elif not line and self._data:
            event = Event(self._name, json.loads("\n".join(self._data)))
            self._name, self._data = "message", []
            return event
        return None
