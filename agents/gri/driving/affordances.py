"""What the driver sees through A-VIS: four encodings of three cameras, its speed, and the command.

The encodings are implicit affordances; the same with encoders that learned less is the comparison of encoders.

Source: Chekroun 2024, section 4.4.2 and table 4.1.
"""

from __future__ import annotations

from dohyo.agents.gri.driving.pictures import LastFeatures, features_space
from dohyo.agents.gri.vision.cameras import CAMERAS, pictures
from dohyo.agents.gri.vision.frozen import FEATURES, FrozenEncoder, weights_of
from dohyo.evaluation.agent import Observation
from dohyo.sumo_networks.arrays import Float32Array


class Affordances(LastFeatures):
    """(4096,) encodings of an encoder that learned segmentation and all heads; speed and command.

    Attributes:
        files: The encoder's weights.
    """

    name = "affordances"
    sensors = (*CAMERAS, "speedometer", "navigation")
    files = (weights_of(name),)
    space = features_space(name, FEATURES)

    def __init__(self) -> None:
        """Reads the encoder's weights."""
        super().__init__()
        self._encoder = FrozenEncoder(weights_of(self.name))

    def features_of(self, observation: Observation) -> Float32Array:
        """See `LastFeatures`."""
        return self._encoder.features(pictures(observation))


class Classification(Affordances):
    """The same from an encoder that learned to classify, and nothing else."""

    name = "classification"
    files = (weights_of(name),)
    space = features_space(name, FEATURES)


class Untrained(Affordances):
    """The same from an encoder that learned nothing."""

    name = "untrained"
    files = (weights_of(name),)
    space = features_space(name, FEATURES)
