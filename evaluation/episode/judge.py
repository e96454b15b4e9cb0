"""Judge: collects the infractions of one ego's episode and decides when and how it ends."""

from __future__ import annotations

from collections.abc import Sequence

from dohyo.evaluation.criteria import Criterion, criteria_for
from dohyo.evaluation.criteria.collision import Collision
from dohyo.evaluation.criteria.outside_lanes import OutsideLanes
from dohyo.evaluation.records.record import Infraction
from dohyo.evaluation.records.specifications import COLLISIONS, InfractionKind, Status
from dohyo.sumo_networks.rules.episode_end import is_played_out, reached_goal
from dohyo.sumo_networks.scenario import Scenario
from dohyo.sumo_networks.world import World


class Judge:
    """Judges one ego for one episode. It reads worlds and changes nothing in them.

    Attributes:
        infractions: Infractions found so far; in the order of time once the episode has ended.
        progress_m: Largest progress along the route, m.
        driven_m: Distance driven, m.
        duration_s: Simulated time judged, s.
        status: Status with which the episode ended; None while it runs.
    """

    def __init__(self, scenario: Scenario, ego: int, criteria: Sequence[Criterion] | None = None) -> None:
        """Prepares the criteria.

        Args:
            scenario: Scenario that is driven.
            ego: Index of the ego.
            criteria: Criteria to use; by default all of them.
        """
        self.infractions: list[Infraction] = []
        self.progress_m = self.driven_m = self.duration_s = 0.0
        self.status: Status | None = None
        self._scenario, self._ego = scenario, ego
        self._criteria = tuple(criteria_for(scenario) if criteria is None else criteria)
        self._world: World | None = None

    @property
    def contacts(self) -> int:
        """Number of distinct actors that the ego ever touched, at fault or not."""
        return sum(one.touched for one in self._criteria if isinstance(one, Collision))

    @property
    def outside_lanes_m(self) -> float:
        """Distance driven with the centre outside the lanes, m."""
        return sum(one.metres for one in self._criteria if isinstance(one, OutsideLanes))

    def start(self, world: World) -> None:
        """Prepares the criteria for the world in which the episode begins."""
        self._world = world
        for criterion in self._criteria:
            criterion.start(world, self._ego)

    def update(self, before: World, after: World) -> Status | None:
        """Judges one tick.

        Args:
            before: The world before the tick.
            after: The world after it.

        Returns:
            The status with which the episode ends in this tick, for `end`; None if it goes on.
        """
        egos, ego = after.egos, self._ego
        self._world = after
        self.progress_m = max(self.progress_m, float(egos.progress[ego]))
        self.driven_m, self.duration_s = float(egos.driven[ego]), after.time
        found = [self._charged(one) for criterion in self._criteria for one in criterion.update(before, after, ego)]
        self.infractions += found
        return self._ending(found, after)

    def end(self, status: Status) -> None:
        """Ends the episode, and adds the infractions that are only known then."""
        if self._world is not None:
            for criterion in self._criteria:
                self.infractions += criterion.finish(self._world, self._ego)
        self.infractions.sort(key=lambda infraction: infraction.time_s)
        flawless = status is Status.COMPLETED and not self.infractions
        self.status = Status.PERFECT if flawless else status

    def _charged(self, found: Infraction) -> Infraction:
        """A gridlock as blocked where the ego collided before: the jam may be its own."""
        if found.kind is not InfractionKind.GRIDLOCK or all(one.kind not in COLLISIONS for one in self.infractions):
            return found
        return found.model_copy(update={"kind": InfractionKind.BLOCKED, "actor": None})

    def _ending(self, found: Sequence[Infraction], world: World) -> Status | None:
        ending = next((status for one in found if (status := one.kind.specification.ends)), None)
        if ending is not None:
            return ending
        if self._scenario.stop_on_collision and any(one.kind in COLLISIONS for one in found):
            return Status.COLLIDED
        if reached_goal(world, self._ego):
            return Status.COMPLETED
        return Status.FINISHED if is_played_out(world, self._scenario.duration_s) else None
