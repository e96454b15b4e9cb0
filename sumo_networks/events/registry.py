"""Registry of event kinds, for the union type in scenarios, automatic placement and the documentation."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Union

from pydantic import Field

from dohyo.sumo_networks.events.event import BaseEvent
from dohyo.sumo_networks.events.kinds import (
    blockage,
    cross_traffic,
    crossing,
    cut_in,
    emergency,
    flow,
    lead,
    obstacle,
    oncoming,
    slow_bicycles,
)

# Automatic placement draws in this order: add new kinds at the end, so that old seeds keep their events.
_CLASSES: tuple[type[BaseEvent], ...] = (
    crossing.DynamicObjectCrossing,
    crossing.ParkingCrossingPedestrian,
    crossing.PedestrianGroupCrossing,
    crossing.CyclistAfterTurn,
    crossing.PedestrianAfterTurn,
    crossing.CrossingBicycleFlow,
    crossing.PedestrianStepsOut,
    cross_traffic.OppositeRunsRedLight,
    cross_traffic.OppositeTakesPriority,
    flow.LeftTurnSignalised,
    flow.LeftTurnUnsignalised,
    flow.RightTurnIntoFlow,
    flow.EnterActorFlow,
    flow.MergeIntoSlowTraffic,
    flow.HighwayExit,
    flow.InterurbanLeftTurn,
    obstacle.Accident,
    obstacle.Construction,
    obstacle.ParkedObstacle,
    obstacle.AccidentTwoWays,
    obstacle.ConstructionTwoWays,
    obstacle.ParkedObstacleTwoWays,
    blockage.VehicleOpensDoor,
    blockage.BlockedIntersection,
    blockage.ParkingExit,
    blockage.StoppedBehindCurve,
    blockage.VehicleAppears,
    lead.HardBrake,
    lead.LeadVehicleBrakes,
    slow_bicycles.SlowBicycles,
    cut_in.ParkingCutIn,
    cut_in.StaticCutIn,
    cut_in.HighwayCutIn,
    oncoming.OncomingInLane,
    oncoming.InvadingTurn,
    emergency.YieldToEmergencyVehicle,
)

EVENTS: Mapping[str, type[BaseEvent]] = MappingProxyType({cls.model_fields["kind"].default: cls for cls in _CLASSES})
"""Class of every kind, by name."""

if TYPE_CHECKING:
    Event = BaseEvent
else:
    Event = Annotated[Union[_CLASSES], Field(discriminator="kind")]  # noqa: UP007 - of a tuple
    """Any scripted event; its `kind` selects the class."""
