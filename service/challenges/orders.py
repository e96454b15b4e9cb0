"""What organisers and participants may send to the challenge routes."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta
from typing import Annotated, Literal

from pydantic import AfterValidator, AwareDatetime, BaseModel, ConfigDict, Field, ValidationInfo, field_validator

from dohyo.service.boards.model import Audience, Counts
from dohyo.service.web.spelling import CHALLENGE_NAME, OWNER_NAME, TEAM_NAME

YEARS = range(2000, 2200)


def _in_utc(given: datetime) -> datetime:
    """The same moment in UTC, since SQLite drops the zone."""
    if given.year not in YEARS:
        raise ValueError(f"expected a year from {YEARS.start} to {YEARS.stop - 1}")
    return given.astimezone(UTC)


Time = Annotated[AwareDatetime, AfterValidator(_in_utc)]
Seed = Annotated[int, Field(ge=0, le=2**31 - 1)]
Owner = Annotated[str, Field(min_length=1, max_length=100, pattern=OWNER_NAME)]
TeamName = Annotated[str, Field(min_length=1, max_length=100, pattern=TEAM_NAME)]
ChallengeName = Annotated[str, Field(min_length=1, max_length=100, pattern=CHALLENGE_NAME)]
Title = Annotated[str, Field(min_length=1, max_length=200, description="Title, for people.")]
Rules = Annotated[
    str,
    Field(
        max_length=100_000,
        description="Rules, in a part of Markdown: headings, lists without levels, paragraphs, fenced code, `code`, "
        "**bold** and links to http(s) addresses; anything else, such as a table or HTML, is shown as text.",
    ),
]


class ChallengeOrder(BaseModel):
    """A new challenge."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"name": "autumn-2026", "title": "Autumn challenge 2026"}]}
    )

    name: Annotated[ChallengeName, Field(description="Name, as in its address; it can never be changed.")]
    title: Title
    rules: Rules = ""


class ChallengeChange(BaseModel):
    """New texts of a challenge; what is left out stays."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"rules": "One ranked run per team."}]})

    title: Title | None = None
    rules: Rules | None = None


class PhaseOrder(BaseModel):
    """A new phase: a ranking with its own seeds, quota, times and audiences. Its conditions can never be changed."""

    model_config = ConfigDict(
        extra="forbid",
        json_schema_extra={
            "examples": [
                {
                    "name": "final",
                    "benchmark": "quickstart",
                    "draw_seeds": 3,
                    "secret": True,
                    "runs_per_period": 1,
                    "closes": "2026-11-30T12:00:00Z",
                }
            ]
        },
    )

    name: Annotated[TeamName, Field(description="Name of the phase, unique in the challenge.")]
    benchmark: Annotated[
        str, Field(min_length=1, max_length=100, description="Benchmark; its current version is kept.")
    ]
    seeds: Annotated[
        list[Seed] | None, Field(min_length=1, max_length=100, description="Default: the benchmark's own seeds.")
    ] = None
    draw_seeds: Annotated[
        int | None,
        Field(ge=1, le=100, description="Instead of `seeds`: so many random ones, held out from training."),
    ] = None
    secret: Annotated[
        bool,
        Field(description="Whether seeds, scenarios, replays and records are withheld from all but you until `ends`."),
    ] = False
    runs_per_period: Annotated[
        int, Field(ge=1, le=1000, description="Most runs that a team may order within `period_s`, over all its agents.")
    ] = 5
    period_s: Annotated[float, Field(ge=60, le=366 * 86_400, description="Length of that period, s.")] = 86_400.0
    counts: Annotated[Counts, Field(description="Which complete run of a team is its place.")] = Counts.BEST
    opens: Annotated[Time | None, Field(description="Earliest time of an order; default: at once.")] = None
    closes: Annotated[Time, Field(description="Latest time of an order.")]
    grace_s: Annotated[
        float,
        Field(ge=0, le=30 * 86_400, description="Time after `closes` in which runs may still end and count, s."),
    ] = 0.0
    act_deadline_s: Annotated[
        float | None, Field(ge=0.1, le=600, description="Wall-clock time for one decision, s; default: the service's.")
    ] = None
    slow_policy: Annotated[
        Literal["wait", "realtime"], Field(description="Whether the simulation waits for a remote agent.")
    ] = "wait"
    track: Annotated[
        Literal["sensors", "map", "privileged"] | None, Field(description="Only this track; default: any.")
    ] = None
    verified_only: Annotated[
        bool, Field(description="Whether only agents that the service runs (built-in, ONNX) may enter.")
    ] = False
    board: Annotated[Audience, Field(description="Who may see the board.")] = Audience.PUBLIC
    replays: Annotated[Audience, Field(description="Who may see replays of others' runs.")] = Audience.PARTICIPANTS
    records: Annotated[Audience, Field(description="Who may read records of others' runs.")] = Audience.PARTICIPANTS

    @field_validator("seeds")
    @classmethod
    def _each_once(cls, given: list[int] | None) -> list[int] | None:
        if given is not None and len(set(given)) < len(given):
            twice = next(seed for place, seed in enumerate(given) if seed in given[:place])
            raise ValueError(f"a seed comes twice: {twice}")
        return given

    @field_validator("draw_seeds")
    @classmethod
    def _one_kind_of_seeds(cls, given: int | None, info: ValidationInfo) -> int | None:
        if given is not None and info.data.get("seeds") is not None:
            raise ValueError("expected either `seeds` or `draw_seeds`")
        return given

    @field_validator("secret")
    @classmethod
    def _has_seeds(cls, given: bool, info: ValidationInfo) -> bool:
        if given and info.data.get("seeds") is None and info.data.get("draw_seeds") is None:
            raise ValueError("expected `seeds` or `draw_seeds` beside it: those of the benchmark are public")
        return given

    @field_validator("closes")
    @classmethod
    def _after_opening(cls, given: datetime, info: ValidationInfo) -> datetime:
        opens = info.data.get("opens")
        if opens is not None and given <= opens:
            raise ValueError("expected a time after `opens`")
        return given

    @property
    def ends(self) -> datetime:
        """Latest end of a run that counts."""
        return self.closes + timedelta(seconds=self.grace_s)


class PhaseChange(BaseModel):
    """A later end of a phase."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"closes": "2026-12-07T12:00:00Z"}]})

    closes: Annotated[Time, Field(description="New latest time of an order; never earlier than before.")]


class BaselineOrder(BaseModel):
    """A submission of the organiser."""

    model_config = ConfigDict(extra="forbid", json_schema_extra={"examples": [{"agent": "autopilot-baseline"}]})

    agent: Annotated[str, Field(min_length=1, max_length=100, description="Name of an agent of the organiser.")]
    version: Annotated[int | None, Field(ge=1, le=2**31 - 1, description="Of the agent; default: the latest.")] = None


class InvitationOrder(BaseModel):
    """A new invitation."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"team": "blue", "note": "for Ann", "expires_in_days": 14}]}
    )

    team: Annotated[
        TeamName | None, Field(description="Team that it admits to; default: a new team of the bearer's choice.")
    ] = None
    note: Annotated[str, Field(max_length=200, description="For yourself, such as the person it is for.")] = ""
    expires_in_days: Annotated[float, Field(gt=0, le=365, description="Days until it expires.")] = 14.0


class Redemption(BaseModel):
    """A code, and the names that its bearer chooses."""

    model_config = ConfigDict(
        extra="forbid", json_schema_extra={"examples": [{"code": "dohyo_invitation_...", "owner": "ann"}]}
    )

    code: Annotated[str, Field(min_length=1, max_length=200, description="As the organiser gave it.")]
    owner: Annotated[
        Owner | None,
        Field(description="Your name here, which must be new; only without a token, which names its owner."),
    ] = None
    team: Annotated[
        TeamName | None, Field(description="Name of a new team, where the invitation names none; default: your name.")
    ] = None
