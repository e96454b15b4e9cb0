"""Created benchmarks: their protocol, cells and traffic, and the file that is read back as the same benchmark."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.benchmarks.benchmark import AutoEvents, load_benchmark
from dohyo.evaluation.benchmarks.cells import Level, Protocol
from dohyo.evaluation.benchmarks.creation import create_benchmark, estimate_capacity, fitting_lengths
from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.benchmarks.writing import write_benchmark
from dohyo.sumo_networks.errors import InvalidInputError, UnknownNameError
from dohyo.sumo_networks.networks.catalog import load_network

KINDS = AutoEvents(kinds=("lead_vehicle_brakes", "parked_obstacle"))


@pytest.mark.parametrize(
    ("protocol", "events", "levels"),
    [
        (Protocol.LEADERBOARD, AutoEvents(), (Level.REGULAR,)),
        (Protocol.NOCRASH, None, (Level.EMPTY, Level.REGULAR)),
        (Protocol.CORL2017, KINDS, (Level.EMPTY,)),
    ],
)
def test_the_file_is_the_same_benchmark(
    protocol: Protocol, events: AutoEvents | None, levels: tuple[Level, ...], tmp_path: Path
) -> None:
    made = create_benchmark(
        "mine", "town-test", missions=3, traffic=levels, conditions=("test",), protocol=protocol, events=events
    )
    path = write_benchmark(made.benchmark, tmp_path / "mine.toml", {"m02": "a note"})
    assert load_benchmark(str(path)) == made.benchmark
    assert '  # a note\nname = "m02"' in path.read_text()


def test_the_town_of_nocrash_has_the_traffic_of_nocrash() -> None:
    made = create_benchmark(
        "mine", "town-train", missions=1, traffic=tuple(Level), conditions=("train", "test"), protocol=Protocol.NOCRASH
    )
    cells = {cell.name: cell for cell in made.benchmark.cells}
    assert len(cells) == 6
    assert cells["regular.train"].traffic.vehicles == pytest.approx(20, abs=1)
    assert cells["dense.test"].traffic.vehicles == pytest.approx(100, abs=5)
    assert cells["empty.train"].traffic.vehicles == 0
    assert cells["dense.test"].conditions == ("drizzle-sunset", "wet-sunset")
    assert made.benchmark.headline is Headline.NOCRASH_SUCCESS
    assert made.benchmark.stop_on_collision


def test_traffic_that_jams_the_network_is_reduced_and_named() -> None:
    made = create_benchmark("mine", "braunschweig", missions=1)
    assert made.reduced == {Level.REGULAR: 69}
    assert made.benchmark.cells[0].traffic.vehicles < 69


def test_the_estimate_of_a_network_that_carries_dense_traffic() -> None:
    found = estimate_capacity("town-test")
    assert found.carried == found.wanted
    assert found.per_km == pytest.approx(20, abs=1)


def test_short_networks_have_shorter_missions() -> None:
    low, high = fitting_lengths(load_network("town-test"))
    assert 100 < low < high < 600
    assert fitting_lengths(load_network("district")) == (300.0, 1500.0)


def test_wrong_names_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="network named 'atlantis'"):
        create_benchmark("mine", "atlantis")
    with pytest.raises(UnknownNameError, match="condition named 'fog'"):
        create_benchmark("mine", "town-test", conditions=("fog",))
    with pytest.raises(UnknownNameError, match="kind of event named 'meteor'"):
        create_benchmark("mine", "town-test", events=AutoEvents(kinds=("meteor",)))
    with pytest.raises(InvalidInputError, match="groups"):
        create_benchmark("mine", "town-test", conditions=("test", "clear"))
    with pytest.raises(InvalidInputError, match=r"benchmark 'a b': name: expected up to 100 letters, .*, got 'a b'$"):
        create_benchmark("a b", "town-test", missions=1)
