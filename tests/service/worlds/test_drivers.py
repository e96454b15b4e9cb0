"""What the record of a world says of an ego that several workers drove in turn."""

from __future__ import annotations

from typing import cast

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.simulating.drive import WorldEgo, WorldProcess, substitute_for


def test_a_drive_by_pose_is_told_as_one_whoever_drove_last() -> None:
    ego = WorldEgo(*substitute_for("stand"), cast(WorldProcess, None))
    plant = AgentSpec(name="plant", track="privileged", sensors=("objects",), control="pose")
    honest = AgentSpec(name="honest", track="sensors", sensors=("speedometer",), control="lane_command")
    for driver in (plant, honest):
        ego.hand_over(driver)
        ego.note()
    told = ego.info
    assert (told.name, told.kind, told.control) == ("plant + honest", "remote", "pose")
    assert (told.track, told.sensors) == ("privileged", ("objects", "speedometer"))
