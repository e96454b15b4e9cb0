"""Answers of the benchmark routes."""

from __future__ import annotations

from datetime import datetime
from typing import Annotated

from pydantic import Field

from dohyo.evaluation.benchmarks.headline import Headline
from dohyo.service.web.views import Version, View


class BenchmarkView(View):
    """The current version of a benchmark; the version is a content hash."""

    name: Annotated[str, Field(examples=["quickstart"])]
    version: Version
    description: str
    headline: Annotated[Headline, Field(description="The score that ranks agents.")]
    metric: Annotated[str, Field(description="How that score is computed, in words.")]
    rules: Annotated[str, Field(description="Of the driving score.")]
    networks: list[str]
    cells: list[str]
    scenarios: Annotated[int, Field(description="Per seed.")]
    seeds: Annotated[list[int], Field(description="Driven by default.")]


class BenchmarkVersionView(View):
    """A version of a benchmark that was or can be evaluated on this server."""

    version: Version
    current: Annotated[bool, Field(description="Whether new evaluations use it.")]
    first_evaluated: datetime | None
    evaluations: int
