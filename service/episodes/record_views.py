"""The records that an episode may have, as they are stored: the description of what the interface sends."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Discriminator, Field, RootModel, Tag

from dohyo.evaluation.freeway.day import DayRecord
from dohyo.evaluation.freeway.morning import MorningRecord
from dohyo.evaluation.parking.record import ParkingRecord
from dohyo.evaluation.records.record import EpisodeRecord


class DrivesRecord(EpisodeRecord):
    """The facts of one episode on roads, as they are stored.

    Attributes:
        parquet_sha256: Digest of the Parquet file's bytes, which is not in the hash.
    """

    parquet_sha256: Annotated[str, Field(description="Digest of the Parquet file's bytes, which is not in the hash.")]


def _kind(given: Any) -> str:
    """Tag of a record, by the properties that only its kind has."""
    has = given.__contains__ if isinstance(given, dict) else given.__class__.model_fields.__contains__
    marks = {"karts": "lot", "plans": "morning", "forecasts": "day"}
    return next((tag for mark, tag in marks.items() if has(mark)), "drives")


class RecordView(
    RootModel[
        Annotated[
            Annotated[DrivesRecord, Tag("drives")]
            | Annotated[ParkingRecord, Tag("lot")]
            | Annotated[MorningRecord, Tag("morning")]
            | Annotated[DayRecord, Tag("day")],
            Discriminator(_kind),
        ]
    ]
):
    """A record, of one of four kinds: drives on roads, a parking lot, a morning on the freeway, a day of forecasts."""
