"""Signals: the states of all traffic lights, read from SUMO."""

from __future__ import annotations

import math

import libsumo
import numpy as np

from dohyo.sumo_networks.arrays import IntArray
from dohyo.sumo_networks.networks.network import RoadNetwork
from dohyo.sumo_networks.rules.right_of_way import RightOfWay
from dohyo.sumo_networks.world import NO_DUTIES, LightState

_LIGHTS = dict.fromkeys("Gg", LightState.GREEN) | dict.fromkeys("yY", LightState.YELLOW)
_LIGHTS |= dict.fromkeys("ru", LightState.RED) | dict.fromkeys("oO", LightState.OFF)
_DUTIES = {"s": RightOfWay.STOP, "o": RightOfWay.YIELD}  # a green right-turn arrow, a blinking light


class SignalReader:
    """Reads the states of all signals; each light only when it may have switched.

    Attributes:
        duties: (K,) RightOfWay that each signal asks for, as `World.duties`; empty where no light can ask for any.
    """

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
        asks = any(_may_ask(light) for light, _, _ in self._lights)
        self.duties: IntArray = np.zeros(len(signals.link), dtype=np.int64) if asks else NO_DUTIES

    def read(self) -> IntArray:
        """(K,) LightState of every signal; brings `duties` up to date, too."""
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
                if len(self.duties):
                    duties = self.duties.copy()
                    duties[rows] = [_DUTIES.get(text[link], RightOfWay.MAJOR) for link in links]
                    self.duties = duties
        return self._state


def _follows_plan(light: str) -> bool:
    """Whether SUMO knows a light's next switch time; it does not for railway crossings."""
    types = {logic.type for logic in libsumo.trafficlight.getAllProgramLogics(light)}
    return types <= {libsumo.TRAFFICLIGHT_TYPE_STATIC, libsumo.TRAFFICLIGHT_TYPE_ACTUATED}


def _may_ask(light: str) -> bool:
    """Whether a light shows now, or in a phase of any program, a letter that asks for a stop or for yielding."""
    programs = libsumo.trafficlight.getAllProgramLogics(light)
    states = {phase.state for program in programs for phase in program.phases}
    states.add(libsumo.trafficlight.getRedYellowGreenState(light))
    return any(letter in state for state in states for letter in _DUTIES)
