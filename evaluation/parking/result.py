"""Results of parking: rates with intervals from the records of one agent, and the comparison of two agents."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.statistics import Comparison, Estimate, mean_estimate, paired, ratio_estimate, share_estimate
from dohyo.sumo_networks.errors import InvalidInputError


@dataclass(frozen=True, slots=True)
class Measure:
    """A number of a result.

    Attributes:
        key: Name in documents.
        title: Name for people.
        unit: Unit of its values.
    """

    key: str
    title: str
    unit: str


MEASURES = (
    Measure("success", "success", "%"),
    Measure("aligned", "aligned, of successes", "%"),
    Measure("time_s", "time to park", "s"),
    Measure("contacts", "contacts", "%"),
    Measure("timed_out", "out of time", "%"),
)


@dataclass(frozen=True, slots=True)
class ParkingResult:
    """Result of one agent on one benchmark.

    Attributes:
        agent: Name of the agent.
        estimates: Estimate of each of `MEASURES`, by key. Karts of one lot are not independent: with several karts the
            intervals are over lots.
        endings: Number of karts by ending.
        touched: Number of karts that ended in contact, by what they touched.
    """

    agent: str
    estimates: dict[str, Estimate]
    endings: dict[str, int]
    touched: dict[str, int]

    def document(self) -> dict[str, Any]:
        """The result as plain JSON."""
        return dataclasses.asdict(self)


@dataclass(frozen=True, slots=True)
class LotCounts:
    """The karts of one lot, counted.

    Attributes:
        karts: Number of karts.
        parked: Of these, how many parked.
        aligned: How many parked and are aligned.
        contacts: How many ended by touching something; a parked kart that is hit does not.
        timed_out: How many ran out of time.
        times_s: Times of those that parked.
    """

    karts: int
    parked: int
    aligned: int
    contacts: int
    timed_out: int
    times_s: Sequence[float]


def count_karts(record: ParkingRecord) -> LotCounts:
    """Counts of one lot."""
    karts = record.karts
    return LotCounts(
        karts=len(karts),
        parked=sum(one.parked for one in karts),
        aligned=sum(one.aligned for one in karts),
        contacts=sum(one.ending == "collided" for one in karts),
        timed_out=sum(one.ending == "timed_out" for one in karts),
        times_s=[one.time_s for one in karts if one.parked],
    )


def estimate_measure(key: str, lots: Sequence[LotCounts]) -> Estimate:
    """Estimate of one of `MEASURES` over lots."""
    match key:
        case "time_s":
            return _mean_time([lot.times_s for lot in lots if lot.times_s])
        case "aligned":
            return _share([(lot.aligned, lot.parked) for lot in lots])
        case _:
            return _share([(getattr(lot, "parked" if key == "success" else key), lot.karts) for lot in lots])


def summarise_parking(records: Sequence[ParkingRecord]) -> ParkingResult:
    """Result of the records of one agent on one benchmark."""
    karts, lots = [one for record in records for one in record.karts], [count_karts(record) for record in records]
    return ParkingResult(
        agent=records[0].agent.name,
        estimates={measure.key: estimate_measure(measure.key, lots) for measure in MEASURES},
        endings=dict(Counter(one.ending for one in karts).most_common()),
        touched=dict(Counter(one.touched for one in karts if one.ending == "collided").most_common()),
    )


def compare_parking(first: Sequence[ParkingRecord], second: Sequence[ParkingRecord]) -> Comparison:
    """Paired comparison of the success rates, in percentage points, on the lots of both.

    Raises:
        InvalidInputError: They have no lot in common.
    """
    ours, theirs = ({record.seed: _parked_share(record) for record in records} for records in (first, second))
    both = [seed for seed in ours if seed in theirs]
    if not both:
        raise InvalidInputError("expected evaluations with common lots, got none")
    return paired([ours[seed] for seed in both], [theirs[seed] for seed in both])


def _parked_share(record: ParkingRecord) -> float:
    return 100.0 * sum(one.parked for one in record.karts) / len(record.karts)


def _mean_time(times_s: Sequence[Sequence[float]]) -> Estimate:
    """Mean over the karts of lots, whose times depend on each other."""
    if all(len(some) == 1 for some in times_s):
        return mean_estimate([some[0] for some in times_s])
    ratio = ratio_estimate([sum(some) for some in times_s], [len(some) for some in times_s], floor=1.0)
    return dataclasses.replace(ratio, n=sum(map(len, times_s)))


def _share(counts: Sequence[tuple[int, int]]) -> Estimate:
    """Percentage of the karts for which something holds, from their number and the number of all karts of each lot."""
    counts = [(found, size) for found, size in counts if size]
    found, sizes = sum(found for found, _ in counts), sum(size for _, size in counts)
    if found in (0, sizes) or all(size == 1 for _, size in counts):
        # Resampling shows no spread where all karts are alike; a lot then counts as one.
        return dataclasses.replace(share_estimate([found > 0 for found, _ in counts]), n=sizes)
    ratio = ratio_estimate([100.0 * found for found, _ in counts], [size for _, size in counts], floor=1.0)
    return dataclasses.replace(ratio, n=sizes)
