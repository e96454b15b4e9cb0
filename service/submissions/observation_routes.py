"""Description of observations and actions, for authors of policies."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter, Query

from dohyo.evaluation.agent import AgentSpec
from dohyo.service.accounts.access import Reader
from dohyo.service.policies.interface import observation_spec, published_spec
from dohyo.service.submissions.observation_views import ChosenInterfaceView, InterfaceView
from dohyo.service.web.documents import problems

router = APIRouter(prefix="/v1", tags=["agents"], responses=problems(404))

Track = Literal["sensors", "map", "privileged"]


@router.get("/observations")
def list_observations(
    caller: Reader,
    track: Track | None = None,
    sensors: Annotated[list[str] | None, Query(max_length=50, examples=[["speedometer", "route"]])] = None,
    control: Annotated[str | None, Query(max_length=100, examples=["target_speed_steering"])] = None,
) -> InterfaceView | ChosenInterfaceView:
    """Names, shapes, types, units and frames of an agent's inputs and output; without arguments, of all that exist.

    `sensors` may be repeated, or one list with commas. A sensor above the track is refused by name.
    """
    if track is None and sensors is None and control is None:
        return InterfaceView.model_validate(published_spec())
    given: dict[str, Any] = {"name": "yours"}
    if track is not None:
        given["track"] = track
    if sensors is not None:
        given["sensors"] = [name for some in sensors for name in some.split(",") if name]
    if control is not None:
        given["control"] = control
    return ChosenInterfaceView.model_validate(observation_spec(AgentSpec.model_validate(given)))
