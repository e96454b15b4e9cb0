"""GRIAD: drives by a policy of the trainer `gri`, by state or by pictures.

dohyo train gri --config agents/gri/configs/griad.toml --out out/griad
dohyo evaluate --agent dohyo.agents.gri.griad:Griad --set policy=out/griad/best.onnx --benchmark nocrash
"""

from __future__ import annotations

from pathlib import Path

from dohyo.agents.gri.driving.choices import CONTROL, TABLE
from dohyo.agents.gri.driving.task import ENCODERS, REPEAT
from dohyo.agents.learning.policies.onnx_policy import OnnxPolicy
from dohyo.agents.learning.policies.policy_agent import Choices, PolicyAgent
from dohyo.sumo_networks.errors import InvalidInputError


class Griad(PolicyAgent):
    """See the module."""

    def __init__(self, policy: str = "out/griad/best.onnx") -> None:
        """Reads the policy, which says what it sees.

        Args:
            policy: ONNX file of a training.

        Raises:
            InvalidInputError: The file is missing, or no policy of the driving task.
        """
        path = Path(policy)
        inputs = set(OnnxPolicy(path).inputs)
        found = next((kind for kind in ENCODERS.values() if inputs and inputs <= set(kind.space.spaces)), None)
        if found is None:
            raise InvalidInputError(f"'{path}': expected a policy of the driving task, it sees {', '.join(inputs)}")
        super().__init__("griad", path, found(), Choices(CONTROL, TABLE), action_repeat=REPEAT)
