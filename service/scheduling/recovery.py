"""Recovery: episodes that an earlier service left unfinished, also when it was ended by kill -9.

What cannot be read of one evaluation ends or delays that one: the service starts in any case.
"""

from __future__ import annotations

import asyncio
import logging
from functools import partial

from dohyo.service.database.patience import PatientDatabase
from dohyo.service.running.process import End
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.orders import Orders
from dohyo.service.scheduling.queue import Ticket
from dohyo.service.scheduling.results import Results
from dohyo.sumo_networks.errors import DohyoError

logger = logging.getLogger("dohyo.scheduler")


async def recover(database: PatientDatabase, orders: Orders, results: Results) -> None:
    """Archives complete records that were left in staging; queues other running episodes again."""
    for ticket in await database.read(queue.running, patient=False):
        try:
            if not await _is_kept(ticket, orders, results):
                await results.requeue(ticket)
        except DohyoError as error:
            logger.warning("evaluation %s cannot be driven: %s", ticket.evaluation_id, error)
            failed = partial(queue.fail, ticket=ticket, why=str(error))
            await results.tell(await database.change(failed), ticket, "cancelled")
    for evaluation_id in await database.read(queue.unfinished, patient=False):
        try:
            await results.tell(await database.change(partial(queue.settle, evaluation_id=evaluation_id)))
        except Exception:
            logger.exception("evaluation %s cannot be ended", evaluation_id)


async def _is_kept(ticket: Ticket, orders: Orders, results: Results) -> bool:
    """Whether an episode has a complete record, which is archived now.

    Raises:
        DohyoError: The episode cannot be driven.
    """
    order = await asyncio.to_thread(orders.make, ticket)
    try:
        return (await results.keep(ticket, order, processor_s=0.0)).end is End.FINISHED
    except Exception:  # it is driven again
        logger.exception("the record of episode %s cannot be kept", ticket.episode_id)
        return False
