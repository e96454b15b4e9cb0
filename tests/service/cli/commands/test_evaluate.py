"""`dohyo evaluate`: how its options are read, and what it shows; without driving."""

from __future__ import annotations

import pytest
from rich.console import Console

from dohyo.evaluation.statistics import Estimate
from dohyo.evaluation.summary import Summary
from dohyo.service.cli import output
from dohyo.service.cli.seeds import parse_seeds
from dohyo.sumo_networks.errors import InvalidInputError


def test_seeds_are_numbers_and_ranges() -> None:
    assert parse_seeds("0-2, 7") == [0, 1, 2, 7]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("3-1", "expected the smaller number first, got '3-1'"),
        ("0-2,1", "expected every seed once, got 1 twice"),
        ("2147483648", "expected numbers below 2^31, got 2147483648"),
        ("0-2147483647", "expected at most 1,000,000 seeds"),
        ("9" * 5000, "expected numbers such as"),
        ("one", "expected numbers such as 0,1,2 or 0-4, got 'one'"),
    ],
)
def test_impossible_seeds_say_what_is_wrong(text: str, says: str) -> None:
    with pytest.raises(InvalidInputError) as raised:
        parse_seeds(text)
    assert says in str(raised.value)


def summary(km: float) -> Summary:
    none = Estimate(None, None, None, 0)
    return Summary(
        agent="mine",
        benchmark=None,
        benchmark_hash=None,
        rules="2.0",
        irs_length="completed",
        episodes=1,
        lost=0,
        scores=dict.fromkeys(output.SCORES, none),
        scores_lost_as_zero=None,
        per_km={"red_light": Estimate(0.0, 0.0, 3689.0, 1)},
        statuses={},
        km=km,
    )


@pytest.mark.parametrize(("km", "shown"), [(0.001, False), (3.0, True)])
def test_rates_are_shown_from_some_distance_on(
    km: float, shown: bool, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(output, "console", Console(width=100))
    output.print_comparison([summary(km)])
    assert ("red light" in capsys.readouterr().out) is shown
