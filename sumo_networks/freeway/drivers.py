"""Drivers: imperfect drivers of cars and trucks, as SUMO's vehicle types."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from types import MappingProxyType

CAR, CONNECTED, TRUCK = "car", "connected", "truck"
KINDS = (CAR, CONNECTED, TRUCK)
"""Kinds of vehicles; a connected car accepts commands, and drives like any other car without one."""
PROBE = "_probe"
"""Suffix of the type of a vehicle that reports its speed to the segment measurements."""


@dataclass(frozen=True, slots=True)
class Driver:
    """One kind of driver.

    Attributes:
        model: SUMO's car-following model and its own parameters.
        v_class: SUMO's vehicle class.
        emission: SUMO's emission class.
        length_m: Length of the vehicle, m.
        width_m: Width of the vehicle, m.
        max_speed_mps: Highest speed of the vehicle, m/s.
        accel_mps2: Strongest usual acceleration, m/s^2.
        decel_mps2: Comfortable deceleration, m/s^2.
        tau_s: Time gap, s.
        min_gap_m: Standing gap, m.
        speed_factor: SUMO's distribution of desired speed over the limit.
    """

    model: str
    v_class: str
    emission: str
    length_m: float
    width_m: float
    max_speed_mps: float
    accel_mps2: float
    decel_mps2: float
    tau_s: float
    min_gap_m: float
    speed_factor: str


_HUMAN = 'carFollowModel="EIDM" actionStepLength="1" taccmax="1.0"'
"""SUMO's extended intelligent driver model: drivers misjudge gaps and speeds, and decide once per second."""

DRIVERS = MappingProxyType(
    {
        CAR: Driver(
            model=_HUMAN,
            v_class="passenger",
            emission="HBEFA4/PC_petrol_Euro-4",
            length_m=5.0,
            width_m=1.85,
            max_speed_mps=45.0,
            accel_mps2=1.6,
            decel_mps2=2.0,
            tau_s=1.0,
            min_gap_m=3.2,
            speed_factor="normc(1.0,0.08,0.8,1.2)",
        ),
        TRUCK: Driver(
            model=_HUMAN,
            v_class="truck",
            emission="HBEFA3/HDV_D_EU6",
            length_m=14.0,
            width_m=2.5,
            max_speed_mps=30.0,
            accel_mps2=0.5,
            decel_mps2=2.0,
            tau_s=1.3,
            min_gap_m=3.5,
            speed_factor="normc(0.88,0.05,0.75,1.0)",
        ),
    }
)


def vehicle_types(tau_factor: float, jam_factor: float = 1.0) -> Iterator[str]:
    """SUMO's vType elements of every kind, with and without probe.

    Args:
        tau_factor: Factor on every time gap.
        jam_factor: Factor on every standing gap.
    """
    for kind in KINDS:
        driver = DRIVERS[TRUCK if kind == TRUCK else CAR]
        for suffix in ("", PROBE):
            yield (
                f'<vType id="{kind}{suffix}" {driver.model} vClass="{driver.v_class}" '
                f'emissionClass="{driver.emission}" length="{driver.length_m}" width="{driver.width_m}" '
                f'maxSpeed="{driver.max_speed_mps}" accel="{driver.accel_mps2}" decel="{driver.decel_mps2}" '
                f'tau="{driver.tau_s * tau_factor:.3f}" minGap="{driver.min_gap_m * jam_factor:.3f}" '
                f'speedFactor="{driver.speed_factor}"/>'
            )
