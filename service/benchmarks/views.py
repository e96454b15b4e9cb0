"""Answers of the benchmark routes."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated, Literal

from pydantic import Field

from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.evaluation.families import Family
from dohyo.service.web.views import Version, View


class BenchmarkView(View):
    """The current version of a benchmark; the version is a content hash."""

    name: Annotated[str, Field(examples=["quickstart"])]
    version: Version
    description: str
    kind: Annotated[
        Family,
        Field(
            description="driving: agents drive cars. parking: agents park karts. freeway: planners of connected cars "
            "smooth a morning's traffic. forecasting: forecasters of the speeds of the next minutes."
        ),
    ]
    headline: Annotated[Headline | Literal["speed_std_mps", "mse"], Field(description="The score that ranks agents.")]
    metric: Annotated[str, Field(description="How that score is computed, in words.")]
    rules: Annotated[str | None, Field(description="Of the driving score; null where no car is driven.")]
    networks: list[str]
    cells: list[str]
    egos: Annotated[
        list[str], Field(description="Egos of every scenario, for mixed runs; empty where an ego drives alone.")
    ]
    scenarios: Annotated[int, Field(description="Per seed.")]
    seeds: Annotated[list[int], Field(description="Driven by default.")]


class BenchmarkVersionView(View):
    """A version of a benchmark that was or can be evaluated on this server."""

    version: Version
    current: Annotated[bool, Field(description="Whether new evaluations use it.")]
    first_evaluated: datetime | None
    evaluations: int
