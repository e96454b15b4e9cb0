"""The frozen encoder in onnxruntime, on one thread: what drives and what is trained see the same numbers.

encoder = FrozenEncoder(weights_of("affordances"))
encoder.features(pictures(observation))               # (1024,) float32
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from dohyo.agents.gri.vision.cameras import CAMERAS, SIDE_PX
from dohyo.agents.learning.policies.session import session_from
from dohyo.sumo_networks.arrays import Float32Array
from dohyo.sumo_networks.errors import InvalidInputError

SHIPPED: Final = Path(__file__).with_name("checkpoints")
SHAPE: Final = (len(CAMERAS), 3, SIDE_PX, SIDE_PX)
FEATURES: Final = 1024


def weights_of(name: str) -> Path:
    """File of a shipped encoder: "affordances", "classification" or "untrained", see `train.TrainConfig`."""
    return SHIPPED / f"{name}.onnx"


class FrozenEncoder:
    """Pictures of three cameras to both encodings.

    Attributes:
        path: Of the model.
    """

    def __init__(self, path: Path) -> None:
        """Loads the model.

        Raises:
            InvalidInputError: The file is missing, or holds another model.
        """
        if not path.is_file():
            raise InvalidInputError(f"no encoder '{path}' (dohyo train affordances makes one)")
        self._session = session_from(path, "encoder")
        self.path = path
        shapes = [tuple(one.shape) for one in (*self._session.get_inputs(), *self._session.get_outputs())]
        if shapes != (expected := [(1, *SHAPE), (1, FEATURES)]):
            raise InvalidInputError(f"'{path}' holds another model: expected shapes {expected}, got {shapes}")
        self._input = self._session.get_inputs()[0].name

    def features(self, pictures: NDArray[Any]) -> Float32Array:
        """(1024,) both encodings.

        Args:
            pictures: (3, 3, 64, 64) uint8 of `cameras.CAMERAS`.

        Raises:
            InvalidInputError: The pictures have another shape or type.
        """
        if pictures.shape != SHAPE or pictures.dtype != np.uint8:
            raise InvalidInputError(f"expected pictures, uint8 {SHAPE}, got {pictures.dtype} {pictures.shape}")
        (features,) = self._session.run(None, {self._input: pictures[None]})
        out: Float32Array = features[0]
        return out
