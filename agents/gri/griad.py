"""GRIAD: drives by a policy of the trainer `gri`, by state, by pictures or by affordances.

dohyo train gri --config agents/gri/configs/griad.toml --out out/griad
dohyo evaluate --agent griad --set policy=out/griad/best.onnx --benchmark nocrash
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dohyo.agents.gri.driving.choices import CONTROL, TABLE
from dohyo.agents.gri.driving.task import ENCODERS, REPEAT
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.policies.policy_agent import Choices, PolicyAgent, SensorEncoder
from dohyo.agents.learning.policies.trained import policy_file
from dohyo.sumo_networks.errors import InvalidInputError

SHIPPED: Final = Path(__file__).with_name("checkpoints") / "griad.onnx"


class Griad(PolicyAgent):
    """See the module."""

    def __init__(self, policy: str | Path | None = None) -> None:
        """Reads the policy, which says what it sees.

        Args:
            policy: ONNX file of a training; None: the shipped one.

        Raises:
            InvalidInputError: The file is missing, or no policy of the driving task.
        """
        path = policy_file(policy, SHIPPED, "gri")
        super().__init__("griad", path, sight_of(path)(), Choices(CONTROL, TABLE), action_repeat=REPEAT)


def sight_of(policy: Path) -> type[SensorEncoder]:
    """What a policy of the driving task sees.

    Raises:
        InvalidInputError: The policy is missing, or one of another task.
    """
    inputs = set(OnnxPolicy(policy).inputs)
    found = next((kind for kind in ENCODERS.values() if inputs and inputs <= set(kind.space.spaces)), None)
    if found is None:
        raise InvalidInputError(f"'{policy}': expected a policy of the driving task, it sees {', '.join(inputs)}")
    return found
