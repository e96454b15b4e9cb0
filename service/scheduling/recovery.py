"""Recovery: episodes that an earlier service left unfinished, also when it was ended by kill -9."""

from __future__ import annotations

import asyncio
from functools import partial

from dohyo.service.database.patience import PatientDatabase
from dohyo.service.running.process import End, Outcome
from dohyo.service.scheduling import queue
from dohyo.service.scheduling.orders import Orders
from dohyo.service.scheduling.results import Results
from dohyo.sumo_networks.errors import DohyoError


async def recover(database: PatientDatabase, orders: Orders, results: Results) -> None:
    """Archives complete records that were left in staging; queues other running episodes again."""
    for ticket in await database.read(queue.running, patient=False):
        try:
            order = await asyncio.to_thread(orders.make, ticket)
            kept = await results.keep(ticket, order, processor_s=0.0)
        except DohyoError as error:
            kept = Outcome(End.FAILED, str(error))
        if kept.end is not End.FINISHED:
            await results.requeue(ticket)
    for evaluation_id in await database.read(queue.unfinished, patient=False):
        await results.tell(await database.change(partial(queue.settle, evaluation_id=evaluation_id)))
