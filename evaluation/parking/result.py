"""Results of parking: rates with intervals from the records of one agent, and the comparison of two agents."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from dohyo.evaluation.parking.record import KartRecord, ParkingRecord
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
        touched: Number of karts in contact, by what they touched.
    """

    agent: str
    estimates: dict[str, Estimate]
    endings: dict[str, int]
    touched: dict[str, int]

    def document(self) -> dict[str, Any]:
        """The result as plain JSON."""
        return dataclasses.asdict(self)


def summarise_parking(records: Sequence[ParkingRecord]) -> ParkingResult:
    """Result of the records of one agent on one benchmark."""
    karts = [one for record in records for one in record.karts]
    return ParkingResult(
        agent=records[0].agent.name,
        estimates={
            "success": _share(records, lambda one: one.parked),
            "aligned": _share(records, lambda one: one.aligned, lambda one: one.parked),
            "time_s": mean_estimate([one.time_s for one in karts if one.parked]),
            "contacts": _share(records, lambda one: one.touched != "nothing"),
            "timed_out": _share(records, lambda one: one.ending == "timed_out"),
        },
        endings=dict(Counter(one.ending for one in karts).most_common()),
        touched=dict(Counter(one.touched for one in karts if one.touched != "nothing").most_common()),
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


def _share(
    records: Sequence[ParkingRecord],
    counts: Callable[[KartRecord], bool],
    among: Callable[[KartRecord], bool] = lambda one: True,
) -> Estimate:
    """Percentage of the karts for which something holds, among some karts."""
    chosen = [some for record in records if (some := [one for one in record.karts if among(one)])]
    found, sizes = [sum(map(counts, some)) for some in chosen], [len(some) for some in chosen]
    if sum(found) in (0, sum(sizes)) or all(size == 1 for size in sizes):
        # Resampling shows no spread where all karts are alike; a lot then counts as one.
        estimate = share_estimate([count > 0 for count in found])
        return dataclasses.replace(estimate, n=sum(sizes))
    ratio = ratio_estimate([100.0 * count for count in found], sizes, floor=1.0)
    return dataclasses.replace(ratio, n=sum(sizes))
