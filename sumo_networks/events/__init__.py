"""Scripted events around the egos. `manager` runs them, `auto_events` places them along any route."""

from __future__ import annotations

from dohyo.sumo_networks.events.registry import EVENTS, Event

__all__ = ["EVENTS", "Event"]
