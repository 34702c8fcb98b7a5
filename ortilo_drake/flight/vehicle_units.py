"""Warn of a vehicle whose numbers do not belong together, most likely because one is in a wrong unit.

Seven ratios of published multirotors, from the Crazyflie's 30 g to the M100's 2.7 kg, lie within a factor of a few
(SIGNS; the vehicles are in tests/flight/test_vehicle_units.py and docs/how_to/own_vehicle.md). A ratio out of its range
says that something is wrong, but not which of its numbers. The blame falls on the one number whose change by a power of
ten, or from a usual wrong unit, brings most ratios back.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ortilo_drake.model.vehicle import LEAST_ARM, M100, Vehicle

LEAST_THRUST = 1.2  # thrust over weight, below which little is left to tilt and climb with [1]
_RPM = 2.0 * np.pi / 60.0  # [rad/s]
_POWERS = [10.0**n for n in range(-7, 8) if n]


class Sign(NamedTuple):
    """A ratio of a vehicle's numbers, its range, the median of the published ones, and words for a value."""

    of: Callable[[Vehicle], float]
    low: float
    usual: float
    high: float
    says: str


def thrust_ratio(vehicle: Vehicle) -> float:
    """The largest thrust over the weight [1]."""
    return vehicle.largest_thrust / vehicle.hover_thrust


def hover_speed(vehicle: Vehicle) -> float:
    """The rotors' angular speed at hover times the arm [m/s]."""
    return float(vehicle.hover_rotor_speeds.max()) * vehicle.longest_arm


def gyration(vehicle: Vehicle) -> float:
    """The radius of gyration sqrt(I / m) over the arm [1], about the axis where that is farthest from 1."""
    ratios = np.sqrt(np.array(vehicle.inertia) / vehicle.mass) / vehicle.longest_arm
    return float(ratios[np.argmax(np.abs(np.log(ratios)))])


def spread(vehicle: Vehicle) -> float:
    """The radius of gyration about z over the radius [1]: no body within r of its axis has an I_z above m r^2."""
    return float(np.sqrt(vehicle.inertia[2] / vehicle.mass)) / max(vehicle.longest_arm, vehicle.radius)


def arm_for_mass(vehicle: Vehicle) -> float:
    """The arm over the cube root of the mass [m/kg^(1/3)]: alike for bodies of one density and form."""
    return vehicle.longest_arm / float(np.cbrt(vehicle.mass))


THRUST = Sign(thrust_ratio, 0.0, 2.3, 15.0, "the rotors lift {:.3g} times the weight")
SIGNS = (
    Sign(lambda v: v.rotor_drag / v.rotor_lift, 1e-3, 0.025, 0.1, "the yaw torque over the thrust is {:.2g} m"),
    THRUST,
    Sign(gyration, 0.2, 0.59, 3.0, "the radius of gyration sqrt(I/m) is {:.3g} arms"),
    Sign(lambda v: v.longest_arm / max(v.radius, 1e-9), 0.15, 0.63, 1.0, "the arm is {:.2g} of the radius"),
    Sign(arm_for_mass, LEAST_ARM, 0.19, 0.8, "the arm over the cube root of the mass is {:.2g}"),
    Sign(spread, 0.0, 0.57, 1.0, "sqrt(I_z/m) is {:.3g} times the radius"),
    Sign(hover_speed, 25.0, 92.0, 350.0, "rotor speed at hover times arm is {:.3g} m/s"),
)


class Change(NamedTuple):
    """A field, the factors on it and on others that go with it, and the wrong unit that they mend, if it has a name."""

    key: str
    factors: dict[str, float]
    unit: str = ""


UNITS = {
    "mass": "kg",
    "inertia": "kg m²",
    "arm_length": "m",
    "rotor_lift": "N s²/rad²",
    "rotor_drag": "N m s²/rad²",
    "rotor_max_speed": "rad/s",
    "radius": "m",
}
_NAMED = [
    Change("rotor_max_speed", {"rotor_max_speed": _RPM}, "rpm"),
    *(
        Change(key, {key: size}, unit)
        for key in ("arm_length", "radius")
        for size, unit in ((1e-3, "mm"), (0.01, "cm"))
    ),
    Change("rotor_lift", {"rotor_lift": _RPM**-2, "rotor_drag": _RPM**-2, "rotor_max_speed": _RPM}, "N/rpm²"),
    Change("rotor_lift", {"rotor_lift": _RPM**-2, "rotor_drag": _RPM**-2}, "N/rpm²"),
]
CHANGES = _NAMED + [Change(key, {key: factor}) for key in UNITS for factor in _POWERS]


def vehicle_units(vehicle: Vehicle) -> list[str]:
    """A line for each number that does not fit the others: the field, its value, and what is usual."""
    lines: list[str] = []
    if (ratio := thrust_ratio(vehicle)) < LEAST_THRUST:
        lines.append(
            f"vehicle.mass: {vehicle.mass:g} kg: the rotors lift {ratio:.3g} times as much, usual is {LEAST_THRUST} to "
            f"{THRUST.high:g}; rotor_lift, rotor_max_speed and mass decide that"
        )
    now, odd = vehicle, _odd(vehicle)
    while odd:
        change = min(CHANGES, key=lambda change: _left(now, change))
        changed = _changed(now, change.factors)
        left = _odd(changed)
        if len(left) >= len(odd):
            left_out = ", ".join(key for key in UNITS if getattr(vehicle, key) == getattr(M100, key))
            taken = f" The M100's are: {left_out}" if left_out else ""
            return [*lines, f"vehicle: {_said(odd, now)}; is each in SI units, arm and radius from the centre?{taken}"]
        mended = [sign for sign in odd if sign not in left]
        lines.append(f"vehicle.{_value(vehicle, change)}: {_said(mended, now)}{_asked(vehicle, change)}")
        now, odd = changed, left
    return lines


def _odd(vehicle: Vehicle) -> list[Sign]:
    return [sign for sign in SIGNS if not sign.low <= sign.of(vehicle) <= sign.high]


def _left(vehicle: Vehicle, change: Change) -> tuple[int, bool, float]:
    """The odd signs that a change leaves, whether its unit has no name, and how far it stays from what is usual."""
    changed = _changed(vehicle, change.factors)
    far = sum(float(np.log(sign.of(changed) / sign.usual)) ** 2 for sign in SIGNS)
    return len(_odd(changed)), not change.unit, far


def _changed(vehicle: Vehicle, factors: dict[str, float]) -> Vehicle:
    """The vehicle with fields multiplied, unchecked: what cannot hover is a vehicle too."""
    values = {key: getattr(vehicle, key) for key in factors}
    values |= {key: value * factors[key] for key, value in values.items() if key != "inertia"}
    if "inertia" in factors:
        values["inertia"] = tuple(moment * factors["inertia"] for moment in vehicle.inertia)
    if "arm_length" in factors and vehicle.arms is not None:
        longer = [one.model_copy(update={"length": one.length * factors["arm_length"]}) for one in vehicle.arms]
        values["arms"] = tuple(longer)
    return vehicle.model_copy(update=values)


def _value(vehicle: Vehicle, change: Change) -> str:
    """The field with its value and unit."""
    key, value = change.key, getattr(vehicle, change.key)
    if key == "arm_length" and vehicle.arms is not None:
        return f"arms: {vehicle.longest_arm:.4g} m"
    digits = ", ".join(f"{one:.4g}" for one in value) if isinstance(value, tuple) else f"{value:.4g}"
    return f"{key}: {digits} {UNITS[key]}"


def _asked(vehicle: Vehicle, change: Change) -> str:
    """The question that the field asks, if it has one."""
    of_arms = change.key == "arm_length" and vehicle.arms is not None
    if not of_arms and getattr(vehicle, change.key) == getattr(M100, change.key):
        return "; it is the M100's, is it yours?"
    if change.key == "inertia" and change.factors["inertia"] <= 1e-3:
        return "; is it in g m², kg cm² or g cm²?"
    return f"; is it in {change.unit}?" if change.unit else ""


def _said(signs: list[Sign], vehicle: Vehicle) -> str:
    """The first two signs with their values and usual ranges."""
    return "; ".join(_one_said(sign, sign.of(vehicle)) for sign in signs[:2])


def _one_said(sign: Sign, value: float) -> str:
    usual = f"{sign.low:g} to {sign.high:g}" if sign.low else f"up to {sign.high:g}"
    return f"{sign.says.format(value)}, usual is {usual}"
