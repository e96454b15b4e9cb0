"""PRIBOOT: waypoints from a coloured view from above, two PIDs, creeping, and rules that can be switched off.

    dohyo evaluate --agent priboot --benchmark leaderboard
    dohyo evaluate --agent priboot --set rules=false --benchmark nocrash

Source: Coelho 2024, chapter 5; see README.md for what is ours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.priboot import measurements, rules
from dohyo.agents.priboot.control import CREEP_AFTER_S, STRAIGHT_M, STRAIGHT_RAD, WaypointControl
from dohyo.agents.priboot.measurements import BlockTime, measured
from dohyo.agents.priboot.recording.dataset import WAYPOINTS
from dohyo.agents.priboot.rules import FREE, RUN_UP_M, standing_gap, straight_ahead
from dohyo.agents.priboot.view import SENSOR, colours_of, packed
from dohyo.evaluation.agent import Agent, AgentSpec, Explanation, Mission, Observation
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.sensors import make_sensors

CHECKPOINT = Path(__file__).with_name("checkpoints") / "priboot.onnx"


class Priboot(Agent):
    """See the module.

    Attributes:
        files: The policy, which decides its actions beside its code.
    """

    spec = AgentSpec(
        name="priboot",
        track="privileged",
        sensors=(SENSOR, *measurements.SENSORS, *rules.SENSORS),
        control="pedals_steering",
    )

    def __init__(self, rules: bool = True, policy: str | Path | None = None) -> None:
        """Reads the policy.

        Args:
            rules: Whether the rules may brake; without them the network drives alone.
            policy: ONNX file of a training; None: the shipped one.

        Raises:
            InvalidInputError: The file is missing, or no policy of this agent.
        """
        path = CHECKPOINT if policy is None else Path(policy)
        self._policy, self.files, self._rules = OnnxPolicy(path), (path,), rules
        if set(self._policy.inputs) != {"picture", "measurements"}:
            raise InvalidInputError(
                f"'{path}': expected a policy of picture and measurements, got {', '.join(self._policy.inputs)}"
            )
        self._colours = self._policy.inputs["picture"][0][0] == 3
        self._forget()

    def warm_up(self) -> None:
        """Decides once on empty arrays."""
        sensors = make_sensors(self.spec.sensors)
        self.act({sensor.name: np.zeros(sensor.space.shape, sensor.space.dtype) for sensor in sensors})
        self._forget()

    def reset(self, mission: Mission, seed: int) -> None:
        """Clears the state of the last episode."""
        self._forget()

    def _forget(self) -> None:
        self._blocked, self._control = BlockTime(), WaypointControl()
        self._waypoints, self._verdict = np.zeros((WAYPOINTS, 2)), FREE

    def act(self, observation: Observation) -> np.ndarray:
        """Throttle, brake and steering."""
        speed = float(observation["speedometer"][0])
        self._blocked.update(speed)
        masks: NDArray[np.uint8] = observation[SENSOR].astype(np.uint8, copy=False)
        seen: dict[str, NDArray[Any]] = {
            "picture": colours_of(packed(masks)) if self._colours else masks,
            "measurements": measured(observation, self._blocked.seconds),
        }
        self._waypoints = np.asarray(self._policy(seen), dtype=np.float64).reshape(WAYPOINTS, 2)
        creeps = self._blocked.seconds > CREEP_AFTER_S and self._may_creep(observation)
        pedals = self._control.pedals(self._waypoints, speed, creeps)
        self._verdict = rules.judge(observation, speed, self._waypoints) if self._rules else FREE
        throttle, brake, _ = self._verdict
        return np.array([pedals[0] * throttle, max(pedals[1], brake), pedals[2]])

    def _may_creep(self, observation: Observation) -> bool:
        """Whether the way ahead is straight, and free enough to go round what stands there after creeping."""
        straight = straight_ahead(observation["path"], STRAIGHT_M, STRAIGHT_RAD)
        return straight and (not self._rules or standing_gap(observation) > 2.0 * RUN_UP_M)

    def explain(self) -> Explanation | None:
        """Waypoints of the network, and the rule that brakes, if any."""
        return {
            "agent": self.spec.name,
            "waypoints_m": self._waypoints.round(2).tolist(),
            "rule": self._verdict.cause,
            "brake": round(self._verdict.brake, 2),
            "creeps": self._control.creeping,
            "blocked_s": round(self._blocked.seconds, 1),
        }
