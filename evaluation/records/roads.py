"""Roads of a record: whether a network is the one that was driven on."""

from __future__ import annotations

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.sumo_networks.errors import InvalidInputError
from dohyo.sumo_networks.networks.network import RoadNetwork


def check_roads(record: EpisodeRecord, network: RoadNetwork) -> None:
    """Refuses other roads than those of a record, on which its poses mean something else.

    Raises:
        InvalidInputError: The network is not the one that was driven on.
    """
    driven, here = record.versions.network_sha256, network.sha256
    if here != driven:
        raise InvalidInputError(
            f"scenario '{record.scenario.name}' was driven on network '{record.scenario.network}' {driven[:12]}, and"
            f" the one here is {here[:12]}"
        )
