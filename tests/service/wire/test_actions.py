"""Actions from the wire: numbers, and nothing that numpy takes for them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dohyo.service.wire.actions import checked_action
from dohyo.service.wire.messages import pack
from dohyo.sumo_networks.errors import InvalidInputError


@pytest.mark.parametrize("value", [[1, True], [False, 0.5], [True, True], pack(np.array([True, False]))])
def test_booleans_are_no_numbers(value: Any) -> None:
    with pytest.raises(InvalidInputError, match="action of 'ego': expected a list of 2 numbers, got true or false"):
        checked_action("ego", value, (2,), lambda given: given)


def test_numbers_are_taken() -> None:
    for value in ([1, 0], [1.5, -2], pack(np.float32([1, 0])), pack(np.array([1, 0], np.uint8))):
        assert checked_action("ego", value, (2,), lambda given: given)[0].shape == (2,)
