"""EndlessDriver: a policy of `dohyo train rlad` or `dohyo train rlfold` as an agent.

dohyo evaluate --agent dohyo.agents.rlad.agent:Rlad --set policy=out/rlad/rlad/seed-0/best.onnx --benchmark nocrash
"""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.endless_driving.observation import ACTION_REPEAT, TargetSpeed, View, make_view
from dohyo.agents.endless_driving.task import TownConfig
from dohyo.agents.learning.policies.policy_agent import PolicyAgent


class EndlessDriver(PolicyAgent):
    """See the module; it sees what its training saw, but for the light, which only losses read."""

    def __init__(self, name: str, policy: str | Path, town: TownConfig, view: View) -> None:
        """Reads the policy.

        Args:
            name: Of the agent.
            policy: ONNX file of a training, such as its best.onnx.
            town: Settings of the training's task.
            view: "state" for a policy of the twin without pixels.

        Raises:
            InvalidInputError: The file is missing, or needs other observations.
        """
        frames = town.frames if view == "picture" else 1
        seen = make_view(view, town.max_speed, town.history, town.side)
        decoder = TargetSpeed(town.max_speed)
        super().__init__(name, Path(policy), seen, decoder, frames=frames, action_repeat=ACTION_REPEAT)
