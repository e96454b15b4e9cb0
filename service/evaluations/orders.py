"""The order of an evaluation, as it is sent, and the submissions that drive in a mixed run."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationInfo, field_validator
from sqlalchemy.orm import Session

from dohyo.evaluation.benchmarks.benchmark import Benchmark
from dohyo.evaluation.families import Family
from dohyo.service.accounts.access import Caller
from dohyo.service.benchmarks.catalog import AnyBenchmark, check_agent, family_of
from dohyo.service.errors import BodyError
from dohyo.service.submissions.model import AgentKind, Submission
from dohyo.service.submissions.queries import find_agent, find_submission
from dohyo.sumo_networks.errors import InvalidInputError

MOST_SEEDS = 100

MOST_EGOS = 100

Seed = Annotated[int, Field(ge=0, le=2**31 - 1)]
AgentName = Annotated[str, Field(min_length=1, max_length=100, description="Name of the agent.")]
AgentVersion = Annotated[int | None, Field(ge=1, le=2**31 - 1, description="Of the agent; default: the latest.")]
EgoName = Annotated[str, Field(min_length=1, max_length=100)]


class EgoOrder(BaseModel):
    """The agent of one ego in a mixed run."""

    model_config = ConfigDict(extra="forbid")

    agent: AgentName
    version: AgentVersion = None


class EvaluationOrder(BaseModel):
    """The order of a run: an agent and a benchmark; for a practice run also seeds and conditions.

    A ranked run takes seeds, deadline and slow policy from its ranking, and counts against the entrant's quota.
    """

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {"agent": "team-blue-mpc", "benchmark": "quickstart", "ranked": True},
                {"agent": "team-blue-mpc", "benchmark": "quickstart", "seeds": [0, 1, 2]},
                {"agent": "team-blue-mpc", "benchmark": "fleet", "egos": {"west-1": {"agent": "team-blue-rl"}}},
            ]
        },
    )

    agent: AgentName
    version: AgentVersion = None
    benchmark: Annotated[str, Field(min_length=1, max_length=100, description="Name of the benchmark.")]
    ranked: Annotated[
        bool, Field(description="Whether the run may enter a board; a practice run never does, whatever its score.")
    ] = False
    ranking: Annotated[
        str | None,
        Field(
            min_length=1,
            max_length=40,
            description="The phase of a challenge that a ranked run enters; default: the benchmark's open ranking.",
        ),
    ] = None
    seeds: Annotated[
        list[Seed] | None,
        Field(min_length=1, max_length=MOST_SEEDS, description="Of a practice run; default: the benchmark's."),
    ] = None
    slow_policy: Annotated[
        Literal["wait", "realtime"] | None,
        Field(
            description="Of a practice run: whether the simulation waits for a remote agent, as it always does in "
            "parking, on the freeway and in forecasting; default: wait."
        ),
    ] = None
    act_deadline_s: Annotated[
        float | None,
        Field(
            ge=0.1, le=600, description="Of a practice run: wall-clock time for one decision; default: the service's."
        ),
    ] = None

    egos: Annotated[
        dict[EgoName, EgoOrder],
        Field(
            max_length=MOST_EGOS,
            description="A mixed run, which is a practice run: the agents of single egos, by the `egos` of the "
            "benchmark; `agent` drives the others.",
            exclude_if=lambda egos: not egos,  # so that orders without it keep their idempotency keys
        ),
    ] = {}

    @field_validator("ranking")
    @classmethod
    def _only_ranked(cls, given: str | None, info: ValidationInfo) -> str | None:
        if given is not None and not info.data.get("ranked"):
            raise ValueError("expected `ranked: true` beside a ranking")
        return given

    @field_validator("seeds", "slow_policy", "act_deadline_s")
    @classmethod
    def _only_practice(cls, given: object, info: ValidationInfo) -> object:
        if given is not None and info.data.get("ranked"):
            raise ValueError("expected nothing in a ranked run, whose ranking fixes it")
        return given

    @field_validator("egos")
    @classmethod
    def _only_unranked(cls, given: dict[str, EgoOrder], info: ValidationInfo) -> dict[str, EgoOrder]:
        if given and info.data.get("ranked"):
            raise ValueError("expected nothing in a ranked run, since mixed runs are practice")
        return given


def check_slow_policy(slow_policy: str | None, benchmark: AnyBenchmark) -> None:
    """Checks that a simulation which does not wait for its agent is one of drives, whose records tell of it.

    Raises:
        BodyError: It is of another family of benchmarks.
    """
    family = family_of(benchmark)
    if slow_policy == "realtime" and family is not Family.DRIVING:
        raise BodyError(
            "slow_policy",
            f"expected 'wait' on '{benchmark.name}', got 'realtime', which is for drives on roads: records of "
            f"{family.label} do not tell of late decisions",
        )


def others_of(
    session: Session, caller: Caller, order: EvaluationOrder, own: Submission, benchmark: AnyBenchmark
) -> dict[str, Submission]:
    """Submissions of the egos that another submission drives than the run's own; none unless the run is mixed.

    Args:
        session: To read in.
        caller: Owner of the run, who may evaluate its own agents alone.
        order: Order of the run.
        own: Submission of the run's own agent.
        benchmark: To drive.

    Raises:
        BodyError: The benchmark has no such ego in every scenario, or the agent of an ego cannot drive it.
    """
    if not order.egos:
        return {}
    if not isinstance(benchmark, Benchmark) or not benchmark.shared_egos:
        raise BodyError(
            "egos", f"expected a benchmark whose egos drive together, such as fleet, got '{benchmark.name}'"
        )
    _refuse_remote(own, "agent")
    found: dict[str, Submission] = {}
    for ego, wanted in order.egos.items():
        if ego not in benchmark.shared_egos:
            names = ", ".join(benchmark.shared_egos[:20])
            raise BodyError(f"egos.{ego}", f"expected an ego of every scenario of '{benchmark.name}': {names}")
        found[ego] = _driver(session, caller, wanted, benchmark, f"egos.{ego}")
    others = {ego: submission for ego, submission in found.items() if submission.id != own.id}
    together = [benchmark.missions[cell.missions] for cell in benchmark.cells]
    if any(all(mission.name in others for mission in missions) for missions in together):
        raise BodyError("egos", f"expected an ego that is left to agent '{order.agent}', got others for all")
    return others


def _driver(session: Session, caller: Caller, wanted: EgoOrder, benchmark: AnyBenchmark, place: str) -> Submission:
    """The submission that an order names for an ego."""
    agent = find_agent(session, wanted.agent)
    if agent is None or not caller.owns(agent.owner):  # one answer, which does not tell that another owner has it
        raise BodyError(f"{place}.agent", f"expected an agent of your own, got '{wanted.agent}'")
    submission = find_submission(session, agent, wanted.version)
    if submission is None:
        which = "a submission" if wanted.version is None else f"version {wanted.version}"
        raise BodyError(f"{place}.version", f"expected {which} of agent '{wanted.agent}', and it has none")
    try:
        check_agent(submission.info, benchmark)
    except InvalidInputError as error:
        raise BodyError(f"{place}.agent", str(error)) from error
    _refuse_remote(submission, f"{place}.agent")
    return submission


def _refuse_remote(submission: Submission, place: str) -> None:
    """Refuses agents of policy workers, whose leases are of whole episodes."""
    if submission.kind is AgentKind.REMOTE:
        raise BodyError(
            place,
            f"expected an agent that the service runs (built-in or ONNX), and '{submission.agent.name}' is remote; "
            "agents of policy workers meet in a world (POST /v1/worlds)",
        )
