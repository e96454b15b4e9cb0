"""Broadcast: what the spectators of a live world are told: its frames, its state, and the plans of its drivers."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import msgspec

from dohyo.service.running.channel import Kind
from dohyo.service.spectating.audience import Audience
from dohyo.service.spectating.plans import Plans


class Broadcast:
    """What the spectators of a live world are told.

    Attributes:
        audience: The spectators.
        plans: Last plans of the drivers.
    """

    def __init__(self, send: Callable[[Kind, bytes], None], most: int) -> None:
        """Begins without spectators.

        Args:
            send: Sends a frame to the world's process.
            most: Most spectators at once.
        """
        self.audience, self.plans = Audience(self._watch, most), Plans()
        self._send, self._begun, self._state = send, False, b""

    def begin(self) -> None:
        """The process has its order: it may be asked for scenes from now on."""
        self._begun = True
        if self.audience.watching:
            self._watch(True)

    def _watch(self, watched: bool) -> None:
        if self._begun:  # else the process would take it for its order
            self._send(Kind.WATCH, bytes([watched]))

    def show(self, kind: Kind, payload: bytes) -> None:
        """Tells a frame of the process, before a scene also the plans that have changed."""
        if kind is Kind.SCENE and (plans := self.plans.news()) is not None:
            self.audience.tell("plans", plans)
        self.audience.tell(kind.name.lower(), payload)

    def tell_state(self, state: Any) -> None:
        """Tells the status and the drivers, where they have changed."""
        if (encoded := msgspec.json.encode(state)) != self._state:
            self._state = encoded
            self.audience.tell("state", encoded)
