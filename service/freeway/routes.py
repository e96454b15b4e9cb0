"""Freeway mornings of the benchmark `dissipation` in which a policy worker is the speed planner."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from fastapi import APIRouter
from fastapi.concurrency import run_in_threadpool
from pydantic import BaseModel, ConfigDict, Field

from dohyo.evaluation.freeway.benchmark import TrafficBenchmark, load_freeway_benchmark
from dohyo.service.accounts.access import Caller, Reader, Submitter
from dohyo.service.errors import BusyError, NotFoundError
from dohyo.service.state import Services, ServicesOf
from dohyo.service.submissions.agent_routes import owned_agent
from dohyo.service.web.documents import Identifier, problems
from dohyo.service.web.strict_json import StrictRoute

router = APIRouter(prefix="/v1/freeway/mornings", tags=["workers"], route_class=StrictRoute)


class MorningOrder(BaseModel):
    """The order of a morning: the planning agent, the benchmark and the seed."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"agent": "my-planner", "seed": 0, "minutes": 25}]}
    )

    agent: Annotated[str, Field(min_length=1, max_length=100)]
    seed: Annotated[int, Field(ge=0, le=2**31 - 1)] = 0
    minutes: Annotated[
        float | None, Field(ge=1, le=600, description="Of control and measurement; default: the benchmark's.")
    ] = None


class MorningView(BaseModel):
    """A morning.

    `outcome` is of all vehicles: throughput, speeds and their deviation, fuel, headways.
    """

    id: str
    agent: str
    benchmark: str
    version: str
    seed: int
    status: Literal["waiting", "running", "finished", "failed", "lost"]
    detail: str
    outcome: dict[str, float | None] | None


@router.post("", status_code=201, responses=problems(403, 404, 413))
async def start_freeway_morning(order: MorningOrder, caller: Submitter, services: ServicesOf) -> MorningView:
    """Starts a morning with an agent's policy worker as planner, once a worker asks for an episode.

    The worker sees `{"planner": {"speeds": (lanes, cells)}}`, m/s, once a simulated minute, and answers target speeds
    of the same shape as `{"planner": ...}`. The result is not ranked.
    """
    if services.draining:
        raise BusyError("the service is ending", retry_s=5)
    owner = await run_in_threadpool(_owner, order.agent, caller, services)
    benchmark = load_freeway_benchmark("dissipation")
    assert isinstance(benchmark, TrafficBenchmark)
    if order.minutes is not None:
        benchmark = benchmark.model_copy(update={"duration_s": 60.0 * order.minutes})
    name = services.freeway.begin(benchmark, order.seed, order.agent, owner)
    return _view(name, services.freeway.read(name))


@router.get("/{name}", responses=problems(404))
async def get_freeway_morning(name: Identifier, caller: Reader, services: ServicesOf) -> MorningView:
    """Status and outcome of a morning."""
    document = services.freeway.read(name)
    if not caller.may_see(document["owner"]):
        raise NotFoundError(f"no morning '{name}'")
    return _view(name, document)


def _owner(agent: str, caller: Caller, services: Services) -> str:
    with services.database.reading() as session:
        return owned_agent(session, caller, agent).owner


def _view(name: str, document: dict[str, Any]) -> MorningView:
    return MorningView.model_validate({"id": name} | {key: document[key] for key in document if key != "owner"})
