"""EndlessDriver: a policy of `dohyo train rlad` or `dohyo train rlfold` as an agent.

dohyo evaluate --agent rlad --set policy=out/rlad/rlad/seed-0/best.onnx --benchmark nocrash

The card beside the policy says what its training saw, and how fast it was: pictures or the exact state, their size and
number, the length of the history, the highest speed.
"""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar, Final

from dohyo.agents.endless_driving.config import TownConfig
from dohyo.agents.endless_driving.observation import ACTION_REPEAT, TargetSpeed, make_view
from dohyo.agents.learning.files.card import CARDS
from dohyo.agents.learning.policies.policy_agent import PolicyAgent
from dohyo.agents.learning.policies.trained import card_of, policy_file

_AGENTS: Final = Path(__file__).parents[1]


class EndlessDriver(PolicyAgent):
    """See the module; it sees what its training saw, but for the light, which only losses read.

    Attributes:
        trainer: Name of the trainer, and of the agent.
    """

    trainer: ClassVar[str]

    def __init__(self, policy: str | Path | None = None) -> None:
        """Reads the policy.

        Args:
            policy: ONNX file of a training, such as its best.onnx, with the training's card beside it; None: the
                shipped one.

        Raises:
            InvalidInputError: There is no such policy, or it is one of another trainer.
        """
        shipped = _AGENTS / self.trainer / "checkpoints" / f"{self.trainer}.onnx"
        path = policy_file(policy, shipped, self.trainer)
        town = town_of(path, self.trainer)
        frames = town.frames if town.view == "picture" else 1
        seen = make_view(town.view, town.max_speed, town.history, town.side)
        decoder = TargetSpeed(town.max_speed, town.stand_below)
        super().__init__(self.trainer, path, seen, decoder, frames=frames, action_repeat=ACTION_REPEAT)
        self.files = (*self.files, path.with_name(CARDS))


def town_of(policy: Path, trainer: str) -> TownConfig:
    """Settings of the task that a policy was trained on, from its card.

    Raises:
        InvalidInputError: There is no card of the policy, or it is one of another trainer.
    """
    config = card_of(policy, trainer).config
    assert not isinstance(config, str), "a run writes all its settings"
    return TownConfig.model_validate(config["town"])
