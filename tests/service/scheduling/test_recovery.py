"""What a service finds at its start: an evaluation that cannot be read ends with the reason, and keeps no other."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from dohyo.service.evaluations.model import BenchmarkVersion, Evaluation, EvaluationStatus
from dohyo.service.scheduling import queue
from dohyo.service.submissions.model import AgentKind
from tests.service.scheduling.scheduled import scheduled
from tests.service.served import STEADY, Service, info_of, short


@pytest.fixture
def shop(tmp_path: Path) -> Iterator[Service]:
    kept = Service(tmp_path / "data", processes=1)
    yield kept
    kept.close()


def left_running(shop: Service, kind: AgentKind = AgentKind.REMOTE) -> str:
    """An evaluation whose episode ran when its service was killed."""
    evaluation = shop.submit(info_of(STEADY), short(), kind=kind)
    with shop.database.session() as session:
        assert queue.take(session, queue.waiting(session)[0]) is not None
    return evaluation


def start_and_stop(shop: Service) -> None:
    async def main() -> None:
        async with scheduled(shop):
            pass

    asyncio.run(main())


def no_document(evaluation: Evaluation) -> dict[str, Any]:
    return {"kind": "parking"}


def no_scenario(evaluation: Evaluation) -> dict[str, Any]:
    return evaluation.benchmark.document | {"missions": []}


@pytest.mark.parametrize("damaged", [no_document, no_scenario])
def test_a_document_that_cannot_be_read_ends_its_evaluation_and_not_the_start(shop: Service, damaged: Any) -> None:
    evaluation = left_running(shop)
    with shop.database.session() as session:
        one = session.get_one(Evaluation, evaluation)
        session.get_one(BenchmarkVersion, one.benchmark_sha256).document = damaged(one)
    start_and_stop(shop)
    ended = shop.evaluation(evaluation)
    assert ended.status is EvaluationStatus.FAILED
    assert "its stored benchmark or agent cannot be read" in (ended.failure or "")


def test_a_result_that_cannot_be_stored_at_the_start_is_driven_again(
    shop: Service, monkeypatch: pytest.MonkeyPatch
) -> None:
    def breaks(*_: Any) -> None:
        raise KeyError("egos")

    evaluation = left_running(shop)
    monkeypatch.setattr("dohyo.service.scheduling.results.shelve", breaks)
    start_and_stop(shop)
    assert [one.status for one in shop.episodes(evaluation)] == ["queued"]
