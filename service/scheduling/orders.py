"""Orders: what a process or a worker needs to drive an episode."""

from __future__ import annotations

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
        scenarios = self._scenarios.get(ticket.evaluation_id)
        if scenarios is None:
            scenarios = read_benchmark(ticket.document).scenarios(ticket.seeds)
            self._scenarios[ticket.evaluation_id] = scenarios
        order = EpisodeOrder(
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
        if order.remote:
            encode(order.told(ticket.waiting.version), Format.MSGPACK)  # refuses what no worker could ever be told
        return order
