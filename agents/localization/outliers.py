"""Outliers: what to do with a fix that surprises the filter. Three policies by name.

`none` uses every fix. `gate` leaves out those beyond a bound and believes the fifth in a row: the rule of the first
version, kept for comparison. `robust`, the default, follows two hypotheses after a surprising fix until the next ones
decide: the fix is wild and left out; or the filter was overconfident, its whole covariance is scaled up until the fix
is expected, and the fix is used. Scaling all of it lets velocity, attitude and biases follow in the proportions that
the filter knows. After a long silence no fix surprises, so that it is used in one hypothesis and left out in the other.
"""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from dohyo.agents.localization.filters.base import Filter, Innovation
from dohyo.agents.localization.filters.measurements import AntennaPosition, Measurement
from dohyo.sumo_networks.arrays import FloatArray

GATE = 21.1
"""NIS above which a fix is surprising: one in 10 000 for a correct filter (chi-square, 3 degrees)."""
PATIENCE = 5
"""Number of consecutive outliers after which the policy `gate` believes the fixes."""
DECIDED_S = 2.0
"""Least time from a surprising fix to the decision; reflections last for some tenths of a second."""
RARE = 0.05
"""Prior probability of a wild fix. Ours."""
DRIFT_S = 10.0
"""Time without a fix after which the filter is overconfident as often as fixes are wild; less often before, by the
third power of the time, since a filter that was right a second ago cannot be far off. Ours."""
SILENCE_S = 5.0
"""Time without a fix after which the next one is doubted even if it is expected."""
WILD_VOLUME_M3 = 400.0 * 400.0 * 100.0
"""Where a wild fix may lie: anywhere within 200 m, and 50 m in height. Ours."""


@dataclass(frozen=True, slots=True)
class JudgedFix:
    """A fix that came while the filter ran.

    Attributes:
        time: s.
        innovation: Of the fix before it was used.
        used: Whether it corrected the filter; not an outlier.
    """

    time: float
    innovation: Innovation
    used: bool


class Corrector(ABC):
    """A filter with a policy for outliers."""

    def __init__(self, filter_: Filter) -> None:
        self._filter = filter_
        self._judged: list[JudgedFix] = []

    @property
    def filter(self) -> Filter:
        """The filter to read."""
        return self._filter

    @property
    def judged(self) -> list[JudgedFix]:
        """Every fix so far, outliers included."""
        return self._judged

    def predict(self, specific_force: FloatArray, rate: FloatArray, dt: float) -> None:
        """See `Filter`."""
        self._filter.predict(specific_force, rate, dt)

    def loosen(self, position_std: float, velocity_std: float, heading_std: float) -> None:
        """See `Filter`."""
        self._filter.loosen(position_std, velocity_std, heading_std)

    def correct(self, measurement: Measurement) -> None:
        """Uses a measurement that is no fix."""
        self._filter.correct(measurement)

    @abstractmethod
    def fix(self, fix: AntennaPosition, time: float) -> None:
        """Uses a fix at a time [s], or leaves it out."""


class UseAll(Corrector):
    """Uses every fix."""

    def fix(self, fix: AntennaPosition, time: float) -> None:
        """See `Corrector`."""
        self._judged.append(JudgedFix(time, self._filter.expect(fix), used=True))
        self._filter.correct(fix)


class Gate(Corrector):
    """Leaves outliers out, and believes the fifth in a row."""

    def __init__(self, filter_: Filter) -> None:
        super().__init__(filter_)
        self._outliers = 0

    def fix(self, fix: AntennaPosition, time: float) -> None:
        """See `Corrector`."""
        innovation = self._filter.expect(fix)
        expected = innovation.nis <= GATE
        self._outliers += not expected
        used = expected or self._outliers == PATIENCE
        self._judged.append(JudgedFix(time, innovation, used))
        if not used:
            return
        if not expected:
            # The filter was overconfident: raise its uncertainty, so that this fix moves it.
            off = float(np.linalg.norm(innovation.residual))
            self._filter.loosen(off, min(off, 5.0), 0.2)
        self._outliers = 0
        self._filter.correct(fix)


@dataclass
class _Hypothesis:
    """A filter that has judged the latest fixes in its own way.

    Attributes:
        filter: With its state.
        judged: Fixes since the surprising one.
        log_likelihood: Of these.
    """

    filter: Filter
    judged: list[JudgedFix] = field(default_factory=list)
    log_likelihood: float = 0.0

    def fix(self, fix: AntennaPosition, time: float) -> None:
        """Uses an expected fix; a surprising one is wild."""
        innovation = self.filter.expect(fix)
        if innovation.nis > GATE:
            self.leave_out(innovation, time)
        else:
            self.use(fix, innovation, time)

    def outlook(self, fix: AntennaPosition) -> float:
        """Log-likelihood of a fix that is not used yet."""
        innovation = self.filter.expect(fix)
        return _LOG_WILD if innovation.nis > GATE else _log_good(innovation)

    def leave_out(self, innovation: Innovation, time: float) -> None:
        """Takes a fix as wild."""
        self.judged.append(JudgedFix(time, innovation, used=False))
        self.log_likelihood += _LOG_WILD

    def use(self, fix: AntennaPosition, innovation: Innovation, time: float) -> None:
        """Takes a fix as good."""
        self.judged.append(JudgedFix(time, innovation, used=True))
        self.log_likelihood += _log_good(innovation)
        self.filter.correct(fix)


_LOG_WILD = math.log(RARE / WILD_VOLUME_M3)


def _log_good(innovation: Innovation) -> float:
    """Log-likelihood of a good fix."""
    _, size = np.linalg.slogdet(2.0 * math.pi * innovation.covariance)
    return math.log(1.0 - RARE) - 0.5 * (innovation.nis + float(size))


class Robust(Corrector):
    """Follows two hypotheses after a surprising fix, and decides by the next ones."""

    def __init__(self, filter_: Filter) -> None:
        super().__init__(filter_)
        self._hypotheses = [_Hypothesis(filter_)]
        self._since = self._used_at = math.nan

    @property
    def filter(self) -> Filter:
        """That of the hypothesis to report."""
        return self._likely.filter

    @property
    def judged(self) -> list[JudgedFix]:
        """See `Corrector`."""
        return self._judged + self._likely.judged if len(self._hypotheses) > 1 else self._judged

    def predict(self, specific_force: FloatArray, rate: FloatArray, dt: float) -> None:
        """See `Filter`."""
        for one in self._hypotheses:
            one.filter.predict(specific_force, rate, dt)

    def loosen(self, position_std: float, velocity_std: float, heading_std: float) -> None:
        """See `Filter`."""
        for one in self._hypotheses:
            one.filter.loosen(position_std, velocity_std, heading_std)

    def correct(self, measurement: Measurement) -> None:
        """See `Corrector`."""
        for one in self._hypotheses:
            one.filter.correct(measurement)

    def fix(self, fix: AntennaPosition, time: float) -> None:
        """See `Corrector`."""
        if len(self._hypotheses) > 1 and time - self._since >= DECIDED_S - 1e-6:
            self._settle(max(self._hypotheses, key=lambda one: one.log_likelihood + one.outlook(fix)))
        if len(self._hypotheses) > 1:
            for one in self._hypotheses:
                one.fix(fix, time)
            return
        (only,) = self._hypotheses
        innovation = only.filter.expect(fix)
        if innovation.nis > GATE:
            self._branch(only.filter, fix, innovation, time)
        elif time - self._used_at > SILENCE_S:
            self._doubt(only.filter, fix, innovation, time)
        else:
            self._judged.append(JudgedFix(time, innovation, used=True))
            self._used_at = time
            only.filter.correct(fix)

    @property
    def _likely(self) -> _Hypothesis:
        """What to report: until the decision a filter that has had fixes of late does well without the next ones."""
        if self._since - self._used_at < DECIDED_S:
            return self._hypotheses[0]
        return max(self._hypotheses, key=lambda one: one.log_likelihood)

    def _branch(self, filter_: Filter, fix: AntennaPosition, innovation: Innovation, time: float) -> None:
        """Begins two hypotheses on a surprising fix."""
        gap = time - self._used_at if math.isfinite(self._used_at) else DRIFT_S
        drifted = RARE * min(1.0, max(gap / DRIFT_S, 1e-3) ** 3)
        wild, overconfident = _Hypothesis(filter_), _Hypothesis(copy.copy(filter_), log_likelihood=math.log(drifted))
        wild.leave_out(innovation, time)
        overconfident.filter.scale(needed_scale(innovation, fix.covariance))
        overconfident.use(fix, overconfident.filter.expect(fix), time)
        overconfident.judged[0] = JudgedFix(time, innovation, used=True)  # as surprising as it was
        self._hypotheses, self._since = [wild, overconfident], time

    def _doubt(self, filter_: Filter, fix: AntennaPosition, innovation: Innovation, time: float) -> None:
        """Begins two hypotheses on a fix that is expected, as almost any fix after a silence."""
        wild, good = _Hypothesis(filter_), _Hypothesis(copy.copy(filter_))
        wild.leave_out(innovation, time)
        good.use(fix, innovation, time)
        self._hypotheses, self._since = [wild, good], time

    def _settle(self, chosen: _Hypothesis) -> None:
        self._judged += chosen.judged
        # `max` would keep the NaN of a filter that has not used any fix.
        self._used_at = float(np.fmax.reduce([self._used_at, *(one.time for one in chosen.judged if one.used)]))
        self._hypotheses = [_Hypothesis(chosen.filter)]


def needed_scale(innovation: Innovation, fix_covariance: FloatArray) -> float:
    """Factor of the state's covariance that makes an innovation as large as expected: a NIS of 3 or less."""
    state, residual, factor = innovation.covariance - fix_covariance, innovation.residual, 1.0
    while factor < 1e12:
        factor *= 2.0
        if float(residual @ np.linalg.solve(factor * state + fix_covariance, residual)) <= len(residual):
            break
    return factor


CORRECTORS: Mapping[str, Callable[[Filter], Corrector]] = MappingProxyType(
    {"none": UseAll, "gate": Gate, "robust": Robust}
)
"""Policies by name."""
