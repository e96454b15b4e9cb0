"""The same bits with and without AVX-512: another process has it switched off in NumPy and its matrix products."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest

from dohyo.sumo_networks.portable_math import arctan2, exp, power
from tests.forked import ROOT

DIGEST = """
from hashlib import sha256
import numpy as np
from dohyo.sumo_networks.portable_math import arctan2, exp, power
from dohyo.sumo_networks.actors.paths import ActorPath
from dohyo.sumo_networks.freeway.demand import WEEKDAY
from dohyo.sumo_networks.conditions import conditions_named
from dohyo.sumo_networks.rendering.view import Optics, _rays, view_of
from dohyo.sumo_networks.routes.route import _directions

rng = np.random.default_rng(1)
x, y = rng.standard_normal((2, 20_000))
line = np.cumsum(np.abs(rng.standard_normal((20_000, 2))) + 0.5, axis=0)
view = view_of(Optics(320, 240, 100.0, 0.5, 0.1, 1.6, 5.0, -4.0, 1.0), conditions_named("wet-sunset"))
for name, array in {
    "arctan2": arctan2(y, x),
    "exp": exp(x),
    "power": power(np.abs(x), y),
    "headings of a route": _directions(line)[0],
    "headings of a path": ActorPath(line)._heading,
    "demand": WEEKDAY[0].at(np.linspace(0.0, 24.0, 20_000)),
    "fog": view.air.transmission(np.linspace(0.0, 100.0, 20_000)),
    "pixels": np.concatenate([view.ray.ravel(), view.inverse.ravel(), *(level.tone.ravel() for level in view.levels)]),
    "rays": _rays(view.lens, view.mount, *np.mgrid[0:240, 0:320]),
}.items():
    print(name, sha256(array.tobytes()).hexdigest())
"""


def digests(**environment: str) -> list[str]:
    ended = subprocess.run(
        [sys.executable, "-c", DIGEST],
        cwd=ROOT,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return ended.stdout.splitlines()


def test_headings_demand_fog_and_pixels_are_the_same_without_avx_512() -> None:
    usual, without = digests(), digests(NPY_DISABLE_CPU_FEATURES="X86_V4", OPENBLAS_CORETYPE="Nehalem")
    assert len(usual) == 9
    assert usual == without


def test_every_element_is_what_the_c_library_says() -> None:
    y, x = np.random.default_rng(2).normal(0.0, 30.0, (2, 3, 500))
    assert arctan2(y, x).ravel().tolist() == [math.atan2(*both) for both in zip(y.flat, x.flat, strict=True)]
    assert exp(x).ravel().tolist() == [math.exp(one) for one in x.flat]
    assert power(np.abs(x), 0.8).ravel().tolist() == [math.pow(abs(one), 0.8) for one in x.flat]


@pytest.mark.parametrize("shape", [(), (0,), (3,), (2, 0), (2, 3)])
def test_shapes_stay_and_numbers_are_float64(shape: tuple[int, ...]) -> None:
    ones = np.ones(shape, dtype=np.float32)
    for array in (arctan2(ones, 1.0), exp(ones), power(ones, 2)):
        assert array.shape == shape
        assert array.dtype == np.float64


def test_angles_of_the_axes_have_their_signs() -> None:
    assert arctan2([0.0, -0.0, 0.0, 1.0], [1.0, 1.0, -1.0, 0.0]).tolist() == [0.0, -0.0, math.pi, math.pi / 2]
    assert np.signbit(arctan2(-0.0, 1.0))
