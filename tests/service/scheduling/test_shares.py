"""Shares: what one owner holds or orders never keeps another one waiting."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from dohyo.evaluation.benchmarks.benchmark import load_benchmark
from dohyo.service.evaluations.model import EpisodeStatus, EvaluationStatus
from dohyo.service.submissions.model import AgentKind
from tests.service.harness import assert_problem, running
from tests.service.served import STEADY, Service, info_of, short, wait_until

HANGS = "tests.evaluation.agents:Hangs"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One process for episodes."""
    shared = Service(tmp_path_factory.mktemp("data"), processes=1)
    shared.start()
    yield shared
    shared.close()


def test_a_newcomer_drives_beside_an_owner_who_holds_every_process(service: Service) -> None:
    hog = service.submit(
        info_of(HANGS), short(3), kind=AgentKind.BUILTIN, owner="hog", act_deadline_s=600.0, seeds=range(5)
    )
    wait_until(lambda: service.evaluation(hog).status is EvaluationStatus.RUNNING, "the hog does not begin")
    newcomer = service.submit(info_of(STEADY), short(2), kind=AgentKind.BUILTIN, owner="newcomer")
    assert service.wait(newcomer).status is EvaluationStatus.DONE
    statuses = [one.status for one in service.episodes(hog)]
    assert statuses.count(EpisodeStatus.RUNNING) == 1, "the hog has its process, and no more"
    assert statuses.count(EpisodeStatus.DONE) == 0


def test_five_orders_of_everything_leave_the_queue_to_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    size = load_benchmark("nocrash-original").size
    with running(tmp_path / "data", queued_per_owner=2 * size, queue_limit=5 * size) as service:
        hog, other = service.caller("hog"), service.caller("other")
        hog.agent("greedy")
        other.agent("modest")
        for _ in range(5):
            greedy = {"agent": "greedy", "benchmark": "nocrash-original", "seeds": list(range(100))}
            refused = hog.post("/v1/evaluations", greedy)
            assert_problem(refused, 429, f"at most {2 * size} episodes of one owner", str(100 * size))
            assert int(refused.headers["retry-after"]) > 0
        hog.evaluation("greedy", "nocrash-original", seeds=[0, 1])
        assert_problem(hog.post("/v1/evaluations", {"agent": "greedy", "benchmark": "quickstart"}), 429)
        other.evaluation("modest")


def test_an_order_without_room_is_refused_before_it_is_planned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def plan(*_: object) -> None:
        raise AssertionError("the scenarios were made")

    monkeypatch.setattr("dohyo.evaluation.benchmarks.scenarios.make_scenarios", plan)
    with running(tmp_path / "data", queued_per_owner=3) as service:
        hog = service.caller("hog")
        hog.agent("greedy")
        assert_problem(hog.post("/v1/evaluations", {"agent": "greedy", "benchmark": "quickstart"}), 429)
