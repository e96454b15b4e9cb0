"""CSS animations of an SVG: poses over time as keyframes, as few as a straight line between two of them allows.

A browser that prefers reduced motion, and any program that knows no CSS, shows the attributes of the elements: a still.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

TOLERANCE_M, TOLERANCE_DEG = 0.06, 1.5


@dataclass
class Motion:
    """The style sheet of a picture that repeats.

    Attributes:
        duration_s: Of what is shown.
        hold_s: For which the last moment stands still, before it begins anew.
        rules: What has been animated so far.
    """

    duration_s: float
    hold_s: float
    rules: list[str] = field(default_factory=list)

    def poses(self, time_s: np.ndarray, poses: np.ndarray) -> str:
        """The class of an element that moves.

        Args:
            time_s: (T,) from the beginning.
            poses: (T, 3) x, y [m], heading [rad].
        """
        heading = np.degrees(np.unwrap(poses[:, 2]))
        places = np.column_stack([poses[:, :2], heading])
        steps = [(time_s[row], "transform:" + pose(*places[row])) for row in corners(time_s, places)]
        return self._animated(steps, "linear")

    def states(self, changes: Sequence[tuple[float, str]]) -> str:
        """The class of an element that changes at once, each state holding until the next: (time [s], CSS)."""
        return self._animated(changes, "step-end")

    def style(self) -> str:
        """The style sheet."""
        cycle = self.duration_s + self.hold_s
        still = "@media (prefers-reduced-motion: reduce){*{animation:none!important}}"
        return f"<style>.m{{animation:{cycle:g}s infinite}}{''.join(self.rules)}{still}</style>"

    def _animated(self, steps: Sequence[tuple[float, str]], timing: str) -> str:
        name = f"m{len(self.rules)}"
        frames = "".join(f"{at}{{{css}}}" for at, css in self._frames(steps))
        self.rules.append(
            f".{name}{{animation-name:{name};animation-timing-function:{timing}}}@keyframes {name}{{{frames}}}"
        )
        return f"m {name}"

    def _frames(self, steps: Sequence[tuple[float, str]]) -> Iterator[tuple[str, str]]:
        """Keyframes in percent; the first and the last state hold to the ends of the cycle."""
        cycle = self.duration_s + self.hold_s
        shares = [100 * time_s / cycle for time_s, _ in steps]
        if shares[0] > 0:
            yield "0%", steps[0][1]
        for share, (_, css) in zip(shares, steps, strict=True):
            yield f"{share:.4g}%", css
        yield "100%", steps[-1][1]


def pose(x: float, y: float, heading_deg: float) -> str:
    """A place as CSS writes it."""
    return f"translate({x:.1f}px,{y:.1f}px) rotate({heading_deg:.0f}deg)"


def corners(time_s: np.ndarray, places: np.ndarray) -> list[int]:
    """Rows between which straight lines are within the tolerance (Douglas and Peucker, over time).

    Args:
        time_s: (T,).
        places: (T, 3) x, y [m], heading [degrees].
    """
    kept, open_spans = {0, len(time_s) - 1}, [(0, len(time_s) - 1)]
    while open_spans:
        first, last = open_spans.pop()
        if last - first < 2:
            continue
        inner = slice(first + 1, last)
        share = ((time_s[inner] - time_s[first]) / (time_s[last] - time_s[first]))[:, None]
        away = np.abs(places[inner] - (places[first] + share * (places[last] - places[first])))
        error = np.maximum(np.hypot(away[:, 0], away[:, 1]) / TOLERANCE_M, away[:, 2] / TOLERANCE_DEG)
        worst = int(error.argmax())
        if error[worst] > 1.0 and math.isfinite(error[worst]):
            middle = first + 1 + worst
            kept.add(middle)
            open_spans += [(first, middle), (middle, last)]
    return sorted(kept)
