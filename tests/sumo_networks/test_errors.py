"""Errors: what they say, also after a way through another process."""

from __future__ import annotations

import pickle

import pytest

from dohyo.sumo_networks.errors import DohyoError, InvalidInputError, SimulationError, UnknownNameError


@pytest.mark.parametrize(
    "error",
    [UnknownNameError("network", "adlershofn", ["adlershof", "a10"]), SimulationError("SUMO failed"), DohyoError()],
)
def test_an_error_is_the_same_after_pickling(error: DohyoError) -> None:
    error.add_note("in worker 3")
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.__notes__) == (type(error), str(error), ["in worker 3"])


def test_an_unknown_name_names_the_nearest() -> None:
    found = r"^no network named 'adlershofn'; did you mean 'adlershof'\?"
    with pytest.raises(InvalidInputError, match=found) as caught:
        raise UnknownNameError("network", "adlershofn", ["adlershof", "a10"])
    assert str(caught.value).endswith("(there is a10, adlershof)")


def test_of_many_names_the_nearest_are_listed() -> None:
    known = [f"camera_{i}" for i in range(20)] + ["speedometer"]
    assert str(UnknownNameError("sensor", "speedometr", known)).startswith(
        "no sensor named 'speedometr'; did you mean 'speedometer'? (the nearest of 21 are speedometer, "
    )
