"""Largest numbers of things in a lot. A list of benchmarks reads them, so that this module imports nothing."""

from __future__ import annotations

MAX_WALLS, MAX_BOXES, MAX_SPOTS, MAX_PEDESTRIANS, MAX_KARTS = 16, 32, 24, 8, 8
