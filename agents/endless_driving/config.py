"""Settings of endless driving: the town, what the ego sees of it, and the expert.

Apart from the task, so that an agent that drives reads them without the task's simulation and experts.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from dohyo.sumo_networks.config import Config

View = Literal["picture", "state"]
"""What a policy sees: a camera's picture, or the exact state."""
Roads = Literal["one-route", "empty", "traffic"]
"""The same short route every time; the town without traffic; the town with a random amount of traffic."""


class TownConfig(Config):
    """Settings of the task: the table [town].

    Attributes:
        roads: See `Roads`.
        view: "picture", or "state" for the twin without pixels.
        side: Of the picture, pixels: 64, or 256 as in the thesis.
        frames: Pictures in a stack.
        history: Decisions whose speed and steering are seen.
        max_speed: Target speed of an action of 1, and of the reward on a free road, m/s.
        stand_below: Target speed below which the ego stands, m/s; 0: it stands at a target of 0 alone, as released.
        obey_lights: Whether reward, endings and rule expert know lights and stop signs; NoCrash ignores them.
        held_out: Episodes of an evaluation.
    """

    roads: Roads = "traffic"
    view: View = "picture"
    side: Literal[64, 256] = 64
    frames: Annotated[int, Field(gt=0)] = 3
    history: Annotated[int, Field(gt=0)] = 3
    max_speed: Annotated[float, Field(gt=0, le=15)] = 6.0
    stand_below: Annotated[float, Field(ge=0, le=2)] = 0.0
    obey_lights: bool = True
    held_out: Annotated[int, Field(gt=0, le=1000)] = 10

    @property
    def shift_px(self) -> int:
        """Largest random shift of a picture in training: the thesis's 8 pixels of 256."""
        return round(8 / 256 * self.side)


class ExpertConfig(Config):
    """Settings of the expert: the table [expert].

    Attributes:
        name: "rules", or a registered agent.
        noise: Share of its decisions that are random.
    """

    name: str = "rules"
    noise: Annotated[float, Field(ge=0, le=1)] = 0.0
