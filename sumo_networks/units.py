"""Units of time and speed, and the range of sight, that every layer shares; everything else is in SI units."""

from __future__ import annotations

from typing import Final

TICK_S: Final = 0.1
"""Simulated time between two decisions of an agent, s."""
SUBSTEP_S: Final = 0.01
"""Integration step of the ego's dynamics, s."""
KMH_PER_MPS: Final = 3.6
"""Kilometres per hour in one metre per second."""
SIGHT_M: Final = 100.0
"""Radius around an ego within which the world lists actors, m."""
