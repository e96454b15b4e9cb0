"""Dismissal of workers whose API token was revoked or has expired, by any process."""

from __future__ import annotations

import asyncio
import logging
from typing import Final, Protocol

from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from dohyo.service.accounts.model import Token
from dohyo.service.accounts.queries import is_valid
from dohyo.service.database.patience import PatientDatabase

EVERY_S: Final = 2.0

logger = logging.getLogger("dohyo.scheduler")


class Holders(Protocol):
    """Workers that hold something, by the API tokens that they came with."""

    def token_ids(self) -> set[str]:
        """Identifiers of the API tokens."""

    def dismiss(self, token_id: str) -> None:
        """Takes everything from the workers of a token."""


async def dismiss_workers(database: PatientDatabase, holders: Holders) -> None:
    """Ends the work of workers without a valid token, until it is cancelled."""
    while True:
        await asyncio.sleep(EVERY_S)
        held = holders.token_ids()
        if not held:
            continue

        def invalid(session: Session, held: set[str] = held) -> list[str]:
            return [one for one in held if not is_valid(session.get(Token, one))]

        try:
            for token_id in await database.read(invalid, patient=False):
                logger.warning("workers of token %s are dismissed: it is no longer valid", token_id)
                holders.dismiss(token_id)
        except (SQLAlchemyError, OSError) as error:
            logger.warning("the tokens of workers cannot be checked: %s", error)
