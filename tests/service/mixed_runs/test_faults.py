"""An agent of a mixed run that never returns, or ends its process: its own fault, and the others drive without it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running import executors
from dohyo.evaluation.running.job import DIED_TWICE, NEVER_RETURNED, Job
from dohyo.evaluation.running.run import REST, run_benchmark
from dohyo.service.evaluations.model import AttemptOutcome
from dohyo.service.submissions.model import AgentKind
from tests.service.mixed_runs.test_records import TWO
from tests.service.served import STEADY, Service, info_of

HANGS = "tests.evaluation.agents:HangsOutsidePython"
DIES = "tests.evaluation.agents:DiesAlways"
DEADLINE_S = 5.0  # beyond any decision of the healthy one on a busy machine
FAULTS = {HANGS: (Status.AGENT_DEADLINE, NEVER_RETURNED), DIES: (Status.AGENT_RAISED, DIED_TWICE)}


def assert_only_front_is_at_fault(record: EpisodeRecord, entry: str = HANGS) -> None:
    back, front = record.egos
    assert (back.name, back.status.completed, back.failure) == ("back", True, None)
    assert (front.status, front.failure) == FAULTS[entry]
    assert (front.agent.name, front.agent.entry) == ("steady", entry)


def test_on_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "KILL_GRACE_S", 0.2)
    agents = {REST: info_of(STEADY), "front": info_of(HANGS, after=2)}
    (record,) = run_benchmark(TWO, agents, out=tmp_path / "one", act_deadline_s=DEADLINE_S).records
    assert_only_front_is_at_fault(record)

    agents[REST] = info_of(HANGS, after=5)
    (record,) = run_benchmark(TWO, agents, out=tmp_path / "both", act_deadline_s=DEADLINE_S).records
    assert {ego.status for ego in record.egos} == {Status.AGENT_DEADLINE}


def test_at_the_service(running_service: Service) -> None:
    own, other = info_of(STEADY), info_of(HANGS, after=2)
    evaluation = running_service.submit(
        own, TWO, kind=AgentKind.BUILTIN, others={"front": other}, act_deadline_s=DEADLINE_S
    )
    assert_only_front_is_at_fault(running_service.record(evaluation))
    assert [one.charged for one in running_service.attempts(evaluation)] == [False]


def test_an_agent_that_ends_its_process_on_this_machine(tmp_path: Path) -> None:
    agents = {REST: info_of(STEADY), "front": info_of(DIES, after=2)}
    (record,) = run_benchmark(TWO, agents, out=tmp_path / "one").records
    assert_only_front_is_at_fault(record, DIES)

    agents[REST] = info_of(DIES, after=5)
    (record,) = run_benchmark(TWO, agents, out=tmp_path / "both").records
    assert {ego.status for ego in record.egos} == {Status.SIMULATION}, "nobody is blamed where no other agent is left"


def test_an_agent_that_ends_its_process_at_the_service(running_service: Service) -> None:
    own, other = info_of(STEADY), info_of(DIES, after=2)
    evaluation = running_service.submit(own, TWO, kind=AgentKind.BUILTIN, others={"front": other})
    assert_only_front_is_at_fault(running_service.record(evaluation), DIES)
    assert [one.outcome for one in running_service.attempts(evaluation)] == [AttemptOutcome.AGENT_FAILED]


def test_nobody_is_blamed_for_deaths_in_calls_of_two_agents() -> None:
    infos = {"back": info_of(STEADY), "front": info_of(DIES, after=2)}
    (scenario,) = TWO.scenarios([0])
    job = Job(scenario, infos, None, Path("out"), "stem", 1.0)
    once = job.after_death(0)
    assert once is not None
    assert (once.suspect, once.hung, once.after_death(1)) == ("back", {}, None)
    assert (again := once.after_death(0)) is not None
    assert (again.suspect, again.hung) == (None, {"back": DIED_TWICE})
    alone = Job(scenario, dict.fromkeys(infos, infos["back"]), None, Path("out"), "stem", 1.0)
    assert alone.after_death(0) is None
