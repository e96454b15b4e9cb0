"""Settings of a run with explorers."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from dohyo.agents.learning.runs.config import Positive, RunConfig


class OffPolicyRunConfig(RunConfig):
    """Settings of a run whose learner may learn from the steps of explorers.

    Attributes:
        explorers: Processes that each drive by a copy of the policy; `processes`, `environments` and `begin_after` are
            then of no effect. 0: the learner chooses every action.
        stretch: Steps that an explorer drives by one copy.
        cluster: Address of a Ray cluster on which the explorers are actors, "local" for a new one on this machine, or
            "auto"; empty: processes of this machine.
    """

    explorers: Annotated[int, Field(ge=0, le=1000)] = 0
    stretch: Positive = 50
    cluster: str = ""
