"""An agent of a mixed run that never returns: the fault is its own, and the other agents drive without it."""

from __future__ import annotations

from pathlib import Path

import pytest

from dohyo.evaluation.records.record import EpisodeRecord
from dohyo.evaluation.records.specifications import Status
from dohyo.evaluation.running import executors
from dohyo.evaluation.running.job import NEVER_RETURNED
from dohyo.evaluation.running.run import REST, run_benchmark
from dohyo.service.submissions.model import AgentKind
from tests.service.mixed_runs.test_records import TWO
from tests.service.served import STEADY, Service, info_of

HANGS = "tests.evaluation.agents:HangsOutsidePython"


def assert_only_front_is_at_fault(record: EpisodeRecord) -> None:
    back, front = record.egos
    assert (back.name, back.status.completed, back.failure) == ("back", True, None)
    assert (front.status, front.failure) == (Status.AGENT_DEADLINE, NEVER_RETURNED)
    assert (front.agent.name, front.agent.entry) == ("steady", HANGS)


def test_on_this_machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(executors, "KILL_GRACE_S", 0.2)
    agents = {REST: info_of(STEADY), "front": info_of(HANGS, after=2)}
    (record,) = run_benchmark(TWO, agents, out=tmp_path / "one", act_deadline_s=0.3).records
    assert_only_front_is_at_fault(record)

    agents[REST] = info_of(HANGS, after=5)
    (record,) = run_benchmark(TWO, agents, out=tmp_path / "both", act_deadline_s=0.3).records
    assert {ego.status for ego in record.egos} == {Status.AGENT_DEADLINE}


def test_at_the_service(running_service: Service) -> None:
    own, other = info_of(STEADY), info_of(HANGS, after=2)
    evaluation = running_service.submit(own, TWO, kind=AgentKind.BUILTIN, others={"front": other}, act_deadline_s=0.3)
    assert_only_front_is_at_fault(running_service.record(evaluation))
    assert [one.charged for one in running_service.attempts(evaluation)] == [False]
