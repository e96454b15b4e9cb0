from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dohyo.agents.speed_planning.fundamental_diagram import FundamentalDiagram, Greenshields, Triangle, calibrated
from dohyo.sumo_networks.errors import InvalidInputError

DIAGRAMS = [Greenshields(30.0, 0.14), Triangle(30.0, 5.0, 0.14)]


def test_the_triangles_tip_by_hand() -> None:
    diagram = Triangle(free_speed_mps=30.0, wave_speed_mps=5.0, jam_density=0.14)
    assert diagram.critical_density == pytest.approx(0.02)
    assert diagram.capacity == pytest.approx(0.6)
    assert diagram.speed(np.array([0.0, 0.02, 0.14])) == pytest.approx([30.0, 30.0, 0.0])


@pytest.mark.parametrize("diagram", DIAGRAMS)
@given(share=st.floats(0.0, 1.0))
def test_a_speed_comes_back_from_its_density(diagram: FundamentalDiagram, share: float) -> None:
    lowest_free = float(diagram.speed(np.array(diagram.critical_density)))
    speed = np.array(share * lowest_free)
    assert float(diagram.speed(diagram.density(speed))) == pytest.approx(float(speed), abs=1e-9)


@pytest.mark.parametrize("diagram", DIAGRAMS)
@given(speed=st.floats(0.0, 30.0))
def test_the_passing_flow_is_the_greatest_over_all_densities(diagram: FundamentalDiagram, speed: float) -> None:
    density = np.linspace(0.0, diagram.jam_density, 2001)
    most = np.max(diagram.flow(density) - speed * density)
    assert float(diagram.passing_flow(np.array(speed))) == pytest.approx(max(float(most), 0.0), abs=1e-3)


def test_greenshields_passing_flow_is_the_published_formula() -> None:
    diagram = Greenshields(30.0, 0.12)
    assert float(diagram.passing_flow(np.array(10.0))) == pytest.approx(0.12 / (4 * 30) * 20**2)


def test_calibration_finds_the_triangle_that_made_the_pairs() -> None:
    rng = np.random.default_rng(3)
    truth = Triangle(29.0, 4.4, 0.125)
    density = rng.uniform(0.002, 0.12, 600)
    found = calibrated(density, truth.speed(density) * rng.normal(1, 0.02, 600))
    assert found.free_speed_mps == pytest.approx(29.0, rel=0.03)
    assert found.wave_speed_mps == pytest.approx(4.4, rel=0.15)
    assert found.jam_density == pytest.approx(0.125, rel=0.1)


def test_calibration_refuses_what_it_cannot_fit() -> None:
    with pytest.raises(InvalidInputError, match="at least 20 pairs"):
        calibrated(np.full(5, 0.02), np.full(5, 20.0))
    with pytest.raises(InvalidInputError, match="congested"):
        calibrated(np.linspace(0.005, 0.02, 50), np.full(50, 30.0))
