"""Work in the background: by what a task failed is told when the service ends, and that it was cancelled is not."""

from __future__ import annotations

import asyncio
import logging

import pytest

from dohyo.service.periodic import ended, repeated


async def _fails_at_its_end() -> None:
    try:
        await asyncio.sleep(60.0)
    except asyncio.CancelledError:
        raise OSError("the disk is full") from None


async def _end_both() -> None:
    tasks = [asyncio.create_task(one) for one in (_fails_at_its_end(), asyncio.sleep(60.0))]
    await asyncio.sleep(0)
    for task in tasks:
        task.cancel()
    await ended(tasks, logging.getLogger("dohyo.service"))


def test_what_fails_as_the_service_ends_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    asyncio.run(_end_both())
    (record,) = caplog.records
    assert record.levelno == logging.ERROR
    assert record.exc_info is not None
    assert "the disk is full" in str(record.exc_info[1])


@pytest.mark.parametrize("error", [OSError("the disk is full"), KeyError("headline")])
def test_work_is_done_again_whatever_it_failed_by(error: Exception, caplog: pytest.LogCaptureFixture) -> None:
    calls = list[bool]()

    def fails_first() -> None:
        calls.append(True)
        if len(calls) == 1:
            raise error

    async def work() -> None:
        async with asyncio.timeout(60.0), repeated(fails_first, 0.01, "closing"):
            while len(calls) < 3:
                await asyncio.sleep(0.01)

    asyncio.run(work())
    (record,) = caplog.records
    assert "closing failed, trying again in 0.01 s" in record.getMessage()
