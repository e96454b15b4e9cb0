"""Orders: what a process or a worker needs to drive an episode."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import Literal, cast

from dohyo.evaluation.records.record import AgentInfo
from dohyo.service.benchmarks.catalog import AnyScenario, read_benchmark
from dohyo.service.episodes.archive import staged_folder
from dohyo.service.running.order import EpisodeOrder
from dohyo.service.scheduling.queue import Ticket
from dohyo.service.settings import Settings
from dohyo.service.submissions.model import AgentKind
from dohyo.service.wire.messages import Format, encode
from dohyo.sumo_networks.errors import DohyoError, InvalidInputError

logger = logging.getLogger("dohyo.scheduler")


class Orders:
    """Makes orders of tickets; the scenarios of an evaluation are built once."""

    def __init__(self, settings: Settings) -> None:
        """Begins without scenarios."""
        self._settings = settings
        self._scenarios: dict[str, Sequence[AnyScenario]] = {}

    def forget(self, evaluation_id: str) -> None:
        """Frees the scenarios of an evaluation that has ended."""
        self._scenarios.pop(evaluation_id, None)

    def make(self, ticket: Ticket) -> EpisodeOrder:
        """Order of an episode; it builds scenarios, which is slow.

        Raises:
            DohyoError: The episode cannot be driven, or no worker could be told of it.
        """
        try:
            order = self._order(ticket)
        except DohyoError:
            raise
        except Exception as error:  # stored by another version, or damaged: no attempt would succeed
            logger.exception("episode %s has no order", ticket.episode_id)
            what = f"its stored benchmark or agent cannot be read ({type(error).__name__})"
            raise InvalidInputError(f"{what}; the log of the service tells more") from error
        if order.remote:
            encode(order.told(ticket.waiting.version), Format.MSGPACK)  # refuses what no worker could ever be told
        return order

    def _order(self, ticket: Ticket) -> EpisodeOrder:
        scenarios = self._scenarios.get(ticket.evaluation_id)
        if scenarios is None:
            scenarios = read_benchmark(ticket.document).scenarios(ticket.seeds)
            self._scenarios[ticket.evaluation_id] = scenarios
        return EpisodeOrder(
            scenario=scenarios[ticket.position],
            info=AgentInfo.model_validate(ticket.info),
            others={ego: AgentInfo.model_validate(info) for ego, info in ticket.others.items()},
            benchmark=ticket.benchmark,
            directory=staged_folder(self._settings, ticket.evaluation_id).resolve(),
            stem=ticket.stem,
            act_deadline_s=ticket.act_deadline_s,
            remote=ticket.waiting.kind is AgentKind.REMOTE,
            slow_policy=cast(Literal["wait", "realtime"], ticket.slow_policy),
            agent_seed=ticket.agent_seed,
        )
