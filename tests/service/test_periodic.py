"""Work in the background: by what a task failed is told when the service ends, and that it was cancelled is not."""

from __future__ import annotations

import asyncio
import itertools
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
    calls = itertools.count()

    def fails_first() -> None:
        if next(calls) == 0:
            raise error

    async def work() -> None:
        async with repeated(fails_first, 0.01, "closing"):
            await asyncio.sleep(0.3)

    asyncio.run(work())
    assert next(calls) > 2
    (record,) = caplog.records
    assert "closing failed, trying again in 0.01 s" in record.getMessage()
