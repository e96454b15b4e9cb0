"""Scripted happenings around the egos: their configs. `director` performs them, `auto` finds places for them."""

from __future__ import annotations

from dohyo.sumo_networks.events.configs import KINDS, Event

__all__ = ["KINDS", "Event"]
