# Generated from the service's OpenAPI description by `python -m dohyo.service.client.generate`.
"""Answers of the service, as plain JSON."""

from __future__ import annotations

from typing import Any, Literal, NotRequired, TypedDict


class AgentSummaryView(TypedDict):
    """Scores of one agent of a mixed run, over its own drives."""

    drives: int
    episodes: int
    lost: int
    km: float
    scores: dict[str, EstimateView]
    scores_lost_as_zero: dict[str, EstimateView] | None
    per_km: dict[str, EstimateView]
    statuses: dict[str, int]
    agent: str
    version: int
    submission: str
    kind: AgentKind
    track: str
    egos: list[str]


class AgentVersionView(TypedDict):
    """A version of an agent."""

    agent: str
    version: int


class AgentView(TypedDict):
    """A named line of submissions."""

    name: str
    owner: str
    description: str
    created: str
    version: int | None
    kind: AgentKind | None
    track: str | None


class ComparedView(TypedDict):
    """Comparison of evaluations of one benchmark version."""

    benchmark: str
    benchmark_sha256: str
    metric: str
    evaluations: list[SideView]
    pairs: list[PairView]
    scenarios: list[ScenarioView]


class ComparisonView(TypedDict):
    """Paired difference of two sides over their common drives."""

    difference: EstimateView
    probability: float | None
    verdict: Literal["<", "=", ">"]


class CrossPlayAgentView(TypedDict):
    """An agent of mixed runs, with its score over all of its drives in them."""

    score: EstimateView
    drives: int
    episodes: int
    lost: int
    submission: str
    agent: str
    version: int
    owner: str
    kind: AgentKind
    track: str


class CrossPlayCellView(TypedDict):
    """The score of one agent in episodes with another one."""

    score: EstimateView
    drives: int
    episodes: int
    lost: int
    submission: str
    other: str


class CrossPlayView(TypedDict):
    """Agents of a benchmark beside each other, in the complete mixed runs that the caller may read."""

    benchmark: str
    version: str
    versions: list[str]
    metric: str
    description: str
    runs: int
    dohyo_version: str | None
    other_versions: int
    agents: list[CrossPlayAgentView]
    cells: list[CrossPlayCellView]


class DriverView(TypedDict):
    """The agent of an ego."""

    agent: str
    version: int
    submission: str
    kind: AgentKind
    track: str


class EgoView(TypedDict):
    """An ego of a world."""

    name: str
    driver: str | None
    driving: bool


class EpisodeView(TypedDict):
    """One scenario of an evaluation. Where the records are withheld, so are the scenario and all that tells of it."""

    id: str
    evaluation: str
    position: int
    scenario: str | None
    cell: str | None
    seed: int | None
    status: EpisodeStatus
    attempts: int
    record_hash: str | None
    summary: dict[str, Any] | None
    failure: str | None
    started: str | None
    finished: str | None


class EstimateView(TypedDict):
    """A number with its 95 % interval; null where there are too few values."""

    mean: float | None
    low: float | None
    high: float | None
    n: int


class EvaluationView(TypedDict):
    """One submission on one version of a benchmark, or several in a mixed run: a ranked run or a practice run."""

    id: str
    owner: str
    agent: str
    version: int
    kind: AgentKind
    track: str
    egos: dict[str, DriverView]
    benchmark: str
    benchmark_version: str
    dohyo_versions: list[str]
    ranking: str | None
    seeds: list[int] | None
    slow_policy: str
    act_deadline_s: float
    status: EvaluationStatus
    failure: str | None
    withheld: bool
    progress: Progress
    created: str
    started: str | None
    finished: str | None


class LeaderboardView(TypedDict):
    """A page of a ranking's board, best first."""

    benchmark: str
    version: str
    versions: list[str]
    ranking: RankingView | None
    final: bool
    track: str | None
    metric: str
    description: str
    total: int
    rows: list[RowView]
    next: str | None


class MeetingView(TypedDict):
    """Two agents of a mixed run that drove in the same episodes."""

    agents: list[AgentVersionView]
    episodes: int
    collisions: int


class MetricsView(TypedDict):
    """An evaluation as a whole, by cell and by drive; a mixed run also by agent."""

    evaluation: str
    agent: str
    version: int
    benchmark: str
    benchmark_sha256: str
    seeds: list[int]
    all: SummaryView
    agents: list[AgentSummaryView]
    meetings: list[MeetingView]
    cells: dict[str, SummaryView]
    drives: list[dict[str, Any]]


class PairView(TypedDict):
    """Two evaluations, score by score, a - b; null without drives in common."""

    a: str
    b: str
    scores: dict[str, ComparisonView | None]


class Progress(TypedDict):
    """Numbers of an evaluation's episodes by status."""

    total: int
    done: NotRequired[int]
    running: NotRequired[int]
    queued: NotRequired[int]
    lost: NotRequired[int]
    cancelled: NotRequired[int]


class RankingView(TypedDict):
    """How runs on one benchmark version count on this server. A ranking of a challenge is a phase."""

    id: str
    challenge: str | None
    name: str
    benchmark: str
    benchmark_version: str
    state: Literal["planned", "open", "closed", "final"]
    seeds: list[int] | None
    seed_count: int
    secret: bool
    act_deadline_s: float
    slow_policy: str
    track: str | None
    verified_only: bool
    runs_per_period: int
    period_s: float
    counts: Counts
    opens: str | None
    closes: str | None
    ends: str | None
    board: Audience
    replays: Audience
    records: Audience
    board_visible: bool


class RowView(TypedDict):
    """A place on the leaderboard: the run of a team (in an open ranking: of an agent) that counts."""

    rank: int | None
    unranked: Unranked | None
    baseline: bool
    team: str | None
    agent: str
    version: int
    submission: str
    evaluation: str
    owner: str
    kind: AgentKind
    verified: bool
    track: str
    dohyo_versions: list[str]
    runs: int
    thrown_away: int
    seeds: int
    episodes: int
    drives: int
    lost: int
    lost_too_many: bool
    finished: str | None
    scores: dict[str, EstimateView]
    per_km: dict[str, float]
    above: ComparisonView | None


class ScenarioView(TypedDict):
    """A scenario with the score of each evaluation, in their order."""

    scenario: str
    seed: int
    cell: str
    spread: float
    values: list[float]
    driving_scores: list[float]
    episodes: list[str]
    statuses: list[list[str]]


class SideView(TypedDict):
    """One evaluation of a comparison."""

    drives: int
    episodes: int
    lost: int
    km: float
    scores: dict[str, EstimateView]
    scores_lost_as_zero: dict[str, EstimateView] | None
    per_km: dict[str, EstimateView]
    statuses: dict[str, int]
    evaluation: str
    agent: str
    version: int
    track: str
    seeds: int
    dohyo_versions: list[str]


class SubmissionView(TypedDict):
    """One version of an agent; never changes."""

    id: str
    agent: str
    version: int
    kind: AgentKind
    name: str
    track: str
    sensors: list[str]
    control: str
    entry: str
    source_sha256: str
    files_sha256: str
    settings: dict[str, Any]
    policy_sha256: str | None
    created: str


class SummaryView(TypedDict):
    """Scores of drives; lost ones are left out, except where the name says otherwise."""

    drives: int
    episodes: int
    lost: int
    km: float
    scores: dict[str, EstimateView]
    scores_lost_as_zero: dict[str, EstimateView] | None
    per_km: dict[str, EstimateView]
    statuses: dict[str, int]


class WorldGuestView(TypedDict):
    """A guest of a world: an owner who was admitted by an invitation."""

    owner: str
    admitted: str | None


class WorldInvitationView(TypedDict):
    """An invitation to a world; its code cannot be read again."""

    world: str
    code: str


class WorldView(TypedDict):
    """A live scenario, or how it ended. It enters no ranking."""

    id: str
    owner: str
    status: WorldStatus
    network: str
    scenario: str
    seed: int
    tick: int
    time_s: float
    undriven: Literal["autopilot", "stand", "out"]
    deadline_s: float
    late: Literal["repeat", "leave"]
    pace: Literal["lockstep", "realtime"]
    speed: float
    overruns: int
    resets: int
    stays: bool
    egos: list[EgoView]
    actors: int
    created: str
    finished: str | None
    reason: str | None
    recorded: bool
    record_hash: str | None


AgentKind = Literal["builtin", "onnx", "remote"]


Audience = Literal["public", "participants", "organisers"]


Counts = Literal["best", "first"]


EpisodeStatus = Literal["queued", "running", "done", "lost", "cancelled"]


EvaluationStatus = Literal["queued", "running", "done", "failed", "cancelled"]


Unranked = Literal["other_version", "lost_too_many", "low_throughput", "baseline"]


WorldStatus = Literal["waiting", "running", "paused", "over", "done", "ended", "failed"]
