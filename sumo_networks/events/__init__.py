"""Scripted events around the egos. `manager` performs them, `auto_events` finds places for them."""

from __future__ import annotations

from dohyo.sumo_networks.events.registry import EVENTS, Event

__all__ = ["EVENTS", "Event"]
