"""Obstacles: an accident, a building site or a parked vehicle that the ego must pass in another lane."""

from __future__ import annotations

from typing import ClassVar, Literal

from dohyo.sumo_networks.actors.scripted_actor import VEHICLES
from dohyo.sumo_networks.events.behavior import PlacementError
from dohyo.sumo_networks.events.event import Gaps
from dohyo.sumo_networks.events.kinds.blockage import BlockageBehavior, BlockageEvent
from dohyo.sumo_networks.events.roads import Section, need_clear_road, section
from dohyo.sumo_networks.world import ActorKind

GAPS_M = (20.0, 50.0)


class ObstacleBehavior(BlockageBehavior):
    """An obstacle stands where the ego can pass it in another lane."""

    event: ObstacleEvent

    def build(self) -> None:
        """Checks that there is a lane to pass, and adds the boxes."""
        need_clear_road(self.route, self.place - 25.0, self.place + 30.0)
        found, two_ways = section(self.network, self.route, self.place), self.event.two_ways
        if two_ways and found.left >= 0:
            raise PlacementError(f"at {self.place:.0f} m there is a lane of the same direction to pass the obstacle")
        if not two_ways and found.left < 0 and found.right < 0:
            raise PlacementError(
                f"at {self.place:.0f} m there is no other lane of the same direction to pass the obstacle"
            )
        if two_ways and found.oncoming < 0:
            raise PlacementError(f"there is no oncoming lane at {self.place:.0f} m")
        self.add_side_flow(oncoming=two_ways)
        self.add_obstacle(found)

    def add_obstacle(self, found: Section) -> None:
        """Adds the boxes of the obstacle at a cross-section of the road."""
        raise NotImplementedError


class ObstacleEvent(BlockageEvent):
    """An obstacle stands in the ego's lane until the ego has passed it.

    Attributes:
        two_ways: Whether the ego must borrow the oncoming lane.
    """

    two_ways: ClassVar[bool] = False


class AccidentBehavior(ObstacleBehavior):
    """Three crashed cars."""

    def add_obstacle(self, found: Section) -> None:
        """Adds the cars, at different angles."""
        self.add_box(*VEHICLES["car"], self.place - 8.0, skew=0.1)
        self.add_box(*VEHICLES["car"], self.place, skew=-0.35)
        self.add_box(*VEHICLES["car"], self.place + 5.8, skew=0.2)


class Accident(ObstacleEvent):
    """Three crashed cars; the ego must change lanes."""

    behavior: ClassVar = AccidentBehavior
    kind: Literal["accident"] = "accident"


class AccidentTwoWays(ObstacleEvent):
    """Three crashed cars; the ego must borrow the oncoming lane."""

    behavior: ClassVar = AccidentBehavior
    two_ways: ClassVar[bool] = True
    kind: Literal["accident_two_ways"] = "accident_two_ways"
    gap_m: Gaps | None = GAPS_M


class ConstructionBehavior(ObstacleBehavior):
    """A building site with a barrier in front."""

    def add_obstacle(self, found: Section) -> None:
        """Adds the barrier and the site."""
        self.add_box(ActorKind.STATIC, 0.4, 1.6, self.place - 5.0)
        self.add_box(ActorKind.STATIC, 6.0, min(2.4, 2 * found.half_width - 0.4), self.place)


class Construction(ObstacleEvent):
    """A building site; the ego must change lanes."""

    behavior: ClassVar = ConstructionBehavior
    kind: Literal["construction"] = "construction"


class ConstructionTwoWays(ObstacleEvent):
    """A building site; the ego must borrow the oncoming lane."""

    behavior: ClassVar = ConstructionBehavior
    two_ways: ClassVar[bool] = True
    kind: Literal["construction_two_ways"] = "construction_two_ways"
    gap_m: Gaps | None = GAPS_M


class ParkedObstacleBehavior(ObstacleBehavior):
    """A parked vehicle, a little to the right of the lane's middle."""

    def add_obstacle(self, found: Section) -> None:
        """Adds the vehicle."""
        self.add_vehicle(self.place, left=-0.2)


class ParkedObstacle(ObstacleEvent):
    """A parked vehicle; the ego must change lanes."""

    behavior: ClassVar = ParkedObstacleBehavior
    kind: Literal["parked_obstacle"] = "parked_obstacle"


class ParkedObstacleTwoWays(ObstacleEvent):
    """A parked vehicle; the ego must borrow the oncoming lane."""

    behavior: ClassVar = ParkedObstacleBehavior
    two_ways: ClassVar[bool] = True
    kind: Literal["parked_obstacle_two_ways"] = "parked_obstacle_two_ways"
    gap_m: Gaps | None = GAPS_M
