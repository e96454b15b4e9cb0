"""Largest numbers of things in a lot. A list of benchmarks reads them, so that this module loads no kernel."""

from __future__ import annotations

from typing import Final

MAX_WALLS, MAX_BOXES, MAX_SPOTS, MAX_PEDESTRIANS, MAX_KARTS = 16, 32, 24, 8, 8
PARALLEL_SPOTS: Final = (5, 6)
"""Smallest and largest number of spots in a drawn row of parallel spots; every other row has a spot for each kart."""


def most_karts(scene: str) -> int:
    """Largest number of karts for which every lot drawn of a scene has spots.

    Args:
        scene: Name of the scene, as in a benchmark.
    """
    return PARALLEL_SPOTS[0] if scene == "parallel" else MAX_KARTS
