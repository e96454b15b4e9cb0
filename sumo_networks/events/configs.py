"""Event configs: what is to happen around an ego, and where; one model per mechanism, one `kind` per scenario.

The numbers of a kind stand in `KINDS`; a config may change each of them. Values marked "ours" in docs/reference/events.md are not
the source's. Source: CARLA Leaderboard 2.x scenarios; NHTSA pre-crash scenarios; Albilani's obstacle test.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import Field, model_validator

from dohyo.sumo_networks.config import Config, Name, Place

Metres = Annotated[float, Field(ge=0, le=1000)]
Seconds = Annotated[float, Field(ge=0, le=3600)]
Speed = Annotated[float, Field(gt=0, le=60)]
Size = Annotated[float, Field(gt=0, le=20)]
Side = Literal["left", "right"]
EVERY_M = (200.0, 300.0)
"""Smallest and largest distance between the triggers of two events that are placed automatically, m."""
VehicleType = Literal["car", "van", "truck", "bus"]
Gaps = tuple[Annotated[float, Field(gt=0, le=500)], Annotated[float, Field(gt=0, le=500)]]


class BaseEvent(Config):
    """What all events have in common.

    Attributes:
        name: Unique in its scenario.
        ego: The mission around whose ego it happens; None: the first.
        at_m: The trigger: metres along the ego's route; or
        at: a place on one of its lanes.
        timeout_s: Simulated time after which an event that is still going on ends, s.
    """

    name: Name
    ego: Name | None = None
    at_m: Annotated[float, Field(ge=0)] | None = None
    at: Place | None = None
    timeout_s: Annotated[float, Field(gt=0, le=3600)] = 240.0

    @model_validator(mode="before")
    @classmethod
    def _numbers_of_its_kind(cls, given: Any) -> Any:
        if isinstance(given, dict) and isinstance(given.get("kind"), str):
            return {**KINDS.get(given["kind"], {}), **given}
        return given

    @model_validator(mode="after")
    def _one_trigger(self) -> BaseEvent:
        if (self.at_m is None) == (self.at is None):
            raise ValueError(f"event '{self.name}': expected either at_m or at")
        gaps = getattr(self, "gap_m", None)
        if isinstance(gaps, tuple) and gaps[0] > gaps[1]:
            raise ValueError(f"event '{self.name}': expected gap_m from small to large, got {list(gaps)}")
        return self


class Crossing(BaseEvent):
    """Someone crosses the ego's lane from the side, to meet its front if it keeps its speed.

    Attributes:
        kind: Which scenario.
        ahead_m: From the trigger to the line on which they cross; unused where that lies behind a junction.
        side: Where they come from.
        actor: Who.
        count: How many.
        spacing_m: Between two of them.
        speed_mps: At which they cross.
        reaction_time_s: They set out at the latest when the ego is so near to the line in time.
        minimum_distance_m: Or so near to it in space.
        length_m: Of each.
        width_m: Of each.
        occluder: What hides them.
        pause_s: How long they stand in the ego's way.
    """

    kind: Literal[
        "dynamic_object_crossing",
        "parking_crossing_pedestrian",
        "pedestrian_group_crossing",
        "cyclist_after_turn",
        "pedestrian_after_turn",
        "crossing_bicycle_flow",
        "pedestrian_steps_out",
    ]
    ahead_m: Metres = 40.0
    side: Side = "right"
    actor: Literal["pedestrian", "bicycle"] = "pedestrian"
    count: Annotated[int, Field(ge=1, le=50)] = 1
    spacing_m: Metres = 1.0
    speed_mps: Speed = 2.0
    reaction_time_s: Seconds = 2.1
    minimum_distance_m: Metres = 6.0
    length_m: Size = 0.5
    width_m: Size = 0.5
    occluder: Literal["none", "kiosk", "parked_car"] = "none"
    pause_s: Seconds = 0.0


class Rival(BaseEvent):
    """A vehicle enters the ego's junction though it must not, to meet the ego if that keeps its speed.

    Attributes:
        kind: Which scenario.
        comes_from: Seen from the ego.
        actor: What it is.
        speed_mps: Of its own.
        reaction_time_s: It keeps pace with the ego until that is so near to their meeting point in time; then it goes.
        minimum_distance_m: Or so near to it in space.
    """

    kind: Literal["opposite_runs_red_light", "opposite_takes_priority"]
    comes_from: Literal["any", "left", "right", "opposite"] = "any"
    actor: VehicleType = "car"
    speed_mps: Speed = 60 / 3.6
    reaction_time_s: Seconds = 2.2
    minimum_distance_m: Metres = 12.0


class Flow(BaseEvent):
    """A stream of SUMO's own vehicles with gaps, through which or into which the ego must go.

    Attributes:
        kind: Which scenario.
        gap_m: Smallest and largest gap between two vehicles.
        speed_mps: Their highest speed; None: the limit's.
        source_m: How far before the meeting point they enter, at most.
        past_m: It is over when the ego is so far past the meeting point.
    """

    kind: Literal[
        "left_turn_signalised",
        "left_turn_unsignalised",
        "right_turn_into_flow",
        "enter_actor_flow",
        "merge_into_slow_traffic",
        "highway_exit",
        "interurban_left_turn",
    ]
    gap_m: Gaps = (20.0, 50.0)
    speed_mps: Speed | None = None
    source_m: Metres = 120.0
    past_m: Metres = 20.0


class Blockage(BaseEvent):
    """Something stands in the ego's lane, for a while or until the ego has passed it.

    Attributes:
        kind: Which scenario.
        ahead_m: From the trigger to its centre; unused where a junction or a bend decides.
        actor: What stands there, where it is one vehicle.
        length_m: Of the standing vehicle; None: that of its type.
        width_m: Of the standing vehicle; None: that of its type.
        stay_s: It goes so long after the trigger (blocked_intersection: after the ego has come within 25 m, or
            queues before it); None: it stays until the ego has passed.
        reaction_time_s: A door opens when the ego is so near in time.
        minimum_distance_m: Or so near in space.
        gap_m: Smallest and largest gap of the vehicles in the lane through which the ego must go round; None: there
            are none.
    """

    kind: Literal[
        "accident",
        "construction",
        "parked_obstacle",
        "accident_two_ways",
        "construction_two_ways",
        "parked_obstacle_two_ways",
        "vehicle_opens_door",
        "blocked_intersection",
        "parking_exit",
        "stopped_behind_curve",
        "vehicle_appears",
    ]
    ahead_m: Metres = 60.0
    actor: VehicleType = "car"
    length_m: Size | None = None
    width_m: Annotated[float, Field(gt=0, le=3)] | None = None
    stay_s: Seconds | None = None
    reaction_time_s: Seconds = 2.0
    minimum_distance_m: Metres = 10.0
    gap_m: Gaps | None = None


class Lead(BaseEvent):
    """A vehicle ahead of the ego, in its lane, brakes hard, stands, and drives on.

    Attributes:
        kind: Which scenario.
        appear_m: How far ahead of the ego it enters, between their centres.
        gap_m: It brakes when the ego's bumper is so near to its own.
        wait_s: Or after this time.
        deceleration_mps2: How hard.
        stop_s: How long it brakes and stands.
        actor: What it is.
    """

    kind: Literal["hard_brake", "lead_vehicle_brakes"]
    appear_m: Metres = 40.0
    gap_m: Metres = 12.0
    wait_s: Seconds = 8.0
    deceleration_mps2: Annotated[float, Field(gt=0, le=10)] = 8.0
    stop_s: Seconds = 10.0
    actor: VehicleType = "car"


class SlowBicycles(BaseEvent):
    """Bicycles ride slowly at the side of the ego's lane.

    Attributes:
        kind: Which scenario.
        ahead_m: From the trigger to the last of them.
        count: How many.
        spacing_m: Between two of them.
        speed_mps: Theirs.
        from_edge_m: Between the edge of the lane and their middle.
    """

    kind: Literal["slow_bicycles"]
    ahead_m: Metres = 50.0
    count: Annotated[int, Field(ge=1, le=20)] = 3
    spacing_m: Annotated[float, Field(ge=2, le=100)] = 9.0
    speed_mps: Speed = 10 / 3.6
    from_edge_m: Metres = 0.7


class Intruder(BaseEvent):
    """A vehicle beside the ego's lane moves into it, close ahead of the ego.

    Attributes:
        kind: Which scenario.
        ahead_m: From the trigger to where it stands, or to where one that drives enters.
        side: From where.
        actor: What it is.
        speed_mps: Of one that stands until then, after it has pulled out; of one that drives, None: 0.5 of the ego's.
        reaction_time_s: It pulls out when the ego is so near in time.
        minimum_distance_m: Or so near in space.
        merge_s: Time from its place to the middle of the ego's lane.
    """

    kind: Literal["parking_cut_in", "static_cut_in", "highway_cut_in"]
    ahead_m: Metres = 50.0
    side: Side = "right"
    actor: VehicleType = "car"
    speed_mps: Speed | None = None
    reaction_time_s: Seconds = 2.35
    minimum_distance_m: Metres = 10.0
    merge_s: Annotated[float, Field(gt=0, le=20)] = 2.0


class Oncoming(BaseEvent):
    """A vehicle comes towards the ego, partly or wholly in the ego's lane, and goes back to its own.

    Attributes:
        kind: Which scenario.
        appear_m: How far ahead of the trigger it enters.
        actor: What it is.
        count: How many, one after the other.
        spacing_m: Between two of them.
        speed_mps: Theirs.
        reaction_time_s: It leaves its lane when they would meet so soon.
        return_s: It goes back so long after.
        intrusion_m: How far its side comes past the middle of the road; None: all of it is in the ego's lane.
    """

    kind: Literal["oncoming_in_lane", "invading_turn"]
    appear_m: Metres = 100.0
    actor: VehicleType = "car"
    count: Annotated[int, Field(ge=1, le=20)] = 1
    spacing_m: Annotated[float, Field(ge=2, le=200)] = 20.0
    speed_mps: Speed = 8.0
    reaction_time_s: Seconds = 4.0
    return_s: Seconds = 4.5
    intrusion_m: Metres | None = None


class Emergency(BaseEvent):
    """An emergency vehicle with blue light comes from behind; the ego must let it pass.

    Attributes:
        kind: Which scenario.
        behind_m: How far behind the ego it enters.
        speed_mps: Its highest.
        wait_s: It is over so long after it has come within 25 m of the ego, if it has not passed.
    """

    kind: Literal["yield_to_emergency_vehicle"]
    behind_m: Metres = 140.0
    speed_mps: Speed = 20.0
    wait_s: Seconds = 20.0


Event = Annotated[
    Crossing | Rival | Flow | Blockage | Lead | SlowBicycles | Intruder | Oncoming | Emergency,
    Field(discriminator="kind"),
]
"""Any scripted happening."""

_BICYCLE: Mapping[str, Any] = {"actor": "bicycle", "length_m": 1.7, "width_m": 0.65}
_GAPS: Mapping[str, Any] = {"gap_m": (20.0, 50.0)}

KINDS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        # Crossing: speed, reaction time, minimum distance.
        "dynamic_object_crossing": {
            "speed_mps": 2.0,
            "reaction_time_s": 2.1,
            "minimum_distance_m": 6.0,
            "occluder": "kiosk",
        },
        "parking_crossing_pedestrian": {
            "speed_mps": 2.0,
            "reaction_time_s": 2.15,
            "minimum_distance_m": 6.0,
            "occluder": "parked_car",
        },
        "pedestrian_group_crossing": {
            "speed_mps": 1.3,
            "reaction_time_s": 3.5,
            "minimum_distance_m": 12.0,
            "count": 3,
        },
        "cyclist_after_turn": {**_BICYCLE, "speed_mps": 1.8, "reaction_time_s": 1.8, "minimum_distance_m": 6.0},
        "pedestrian_after_turn": {"speed_mps": 1.8, "reaction_time_s": 2.2, "minimum_distance_m": 6.0},
        "crossing_bicycle_flow": {
            **_BICYCLE,
            "speed_mps": 4.0,
            "reaction_time_s": 3.0,
            "minimum_distance_m": 12.0,
            "count": 5,
            "spacing_m": 12.0,
        },
        "pedestrian_steps_out": {
            "speed_mps": 1.5,
            "ahead_m": 30.0,
            "minimum_distance_m": 30.0,
            "pause_s": 6.0,
        },
        # Rivals at junctions.
        "opposite_runs_red_light": {"speed_mps": 60 / 3.6, "reaction_time_s": 2.2, "minimum_distance_m": 12.0},
        "opposite_takes_priority": {"speed_mps": 60 / 3.6, "reaction_time_s": 2.2, "minimum_distance_m": 12.0},
        # Streams.
        "left_turn_signalised": _GAPS,
        "left_turn_unsignalised": _GAPS,
        "right_turn_into_flow": _GAPS,
        "enter_actor_flow": _GAPS,
        "merge_into_slow_traffic": {**_GAPS, "speed_mps": 5.0},
        "highway_exit": _GAPS,
        "interurban_left_turn": _GAPS,
        # What stands in the way.
        "accident": {},
        "construction": {},
        "parked_obstacle": {},
        "accident_two_ways": _GAPS,
        "construction_two_ways": _GAPS,
        "parked_obstacle_two_ways": _GAPS,
        "vehicle_opens_door": {"reaction_time_s": 2.0, "minimum_distance_m": 10.0},
        "blocked_intersection": {"stay_s": 10.0},
        "parking_exit": {**_GAPS, "ahead_m": 9.0},
        "stopped_behind_curve": {"stay_s": 30.0},
        "vehicle_appears": {"ahead_m": 30.0, "stay_s": 10.0},
        # Who leads.
        "hard_brake": {"stop_s": 10.0, "deceleration_mps2": 8.0},
        "lead_vehicle_brakes": {"stop_s": 4.0, "deceleration_mps2": 6.0},
        "slow_bicycles": {},
        # Who moves in.
        "parking_cut_in": {"reaction_time_s": 2.35, "minimum_distance_m": 10.0, "speed_mps": 3.0},
        "static_cut_in": {"reaction_time_s": 2.7, "minimum_distance_m": 15.0, "speed_mps": 3.0},
        "highway_cut_in": {"side": "left", "reaction_time_s": 2.0, "minimum_distance_m": 15.0},
        # Who comes the other way.
        "oncoming_in_lane": {},
        "invading_turn": {"count": 3, "intrusion_m": 0.9, "reaction_time_s": 6.0, "return_s": 60.0},
        # Who comes from behind.
        "yield_to_emergency_vehicle": {"behind_m": 140.0},
    }
)
"""The numbers of every kind, where they differ from its mechanism's."""
