"""Signals: the states of all traffic lights, read from SUMO."""

from __future__ import annotations

import math

import libsumo
import numpy as np

from dohyo.sumo_networks.arrays import IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.world import LightState

_LIGHTS = dict.fromkeys("Gg", LightState.GREEN) | dict.fromkeys("yY", LightState.YELLOW)
_LIGHTS |= dict.fromkeys("ru", LightState.RED) | dict.fromkeys("oO", LightState.OFF)


class SignalReader:
    """Reads the states of all signals; each light only when it may have switched."""

    def __init__(self, network: RoadNetwork) -> None:
        signals = network.signals
        self._lights = [
            (str(light), np.flatnonzero(signals.light == i), signals.link[signals.light == i])
            for i, light in enumerate(signals.light_ids)
        ]
        self._last = [""] * len(self._lights)
        self._plans = [_follows_plan(light) for light, _, _ in self._lights]
        self._next_switch = [-math.inf] * len(self._lights)
        self._state: IntArray = np.zeros(len(signals.link), dtype=np.int64)

    def read(self) -> IntArray:
        """(K,) LightState of every signal."""
        now = libsumo.simulation.getTime()
        for i, (light, rows, links) in enumerate(self._lights):
            if now < self._next_switch[i]:
                continue
            if self._plans[i]:
                self._next_switch[i] = libsumo.trafficlight.getNextSwitch(light)
            text = libsumo.trafficlight.getRedYellowGreenState(light)
            if text != self._last[i]:
                self._last[i] = text
                state = self._state.copy()
                state[rows] = [_LIGHTS.get(text[link], LightState.OFF) for link in links]
                self._state = state
        return self._state


def _follows_plan(light: str) -> bool:
    """Whether SUMO knows a light's next switch time; it does not for railway crossings."""
    types = {logic.type for logic in libsumo.trafficlight.getAllProgramLogics(light)}
    return types <= {libsumo.TRAFFICLIGHT_TYPE_STATIC, libsumo.TRAFFICLIGHT_TYPE_ACTUATED}
