"""Actions from the wire, one at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dohyo.service.wire.messages import shape_in_words, unpack
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError


def _has_bool(value: object) -> bool:
    """Whether nested lists, of the few values of an action, have a boolean, which numpy takes as a number."""
    return any(map(_has_bool, value)) if isinstance(value, list | tuple) else isinstance(value, bool)


def checked_action(
    ego: str, value: object, shape: tuple[int, ...], check: Callable[[np.ndarray], np.ndarray]
) -> tuple[np.ndarray, bool]:
    """An action within its bounds, and whether it was outside of them.

    Args:
        ego: Name of the ego in errors.
        value: Action as it was sent.
        shape: Shape of an action.
        check: Returns an action within its bounds, or raises an error for an invalid one.

    Raises:
        InvalidInputError: The action is invalid.
    """
    try:
        given = unpack(value)
        if given.shape != shape:
            raise InvalidInputError(f"expected {shape_in_words(shape)}, got {shape_in_words(given.shape)}")
        if given.dtype.kind == "b" or _has_bool(value):
            raise InvalidInputError(f"expected {shape_in_words(shape)}, got true or false among them")
        action = check(given)
    except DohyoError as error:
        raise InvalidInputError(f"action of '{ego}': {error}") from None
    return action, bool((action != given).any())
