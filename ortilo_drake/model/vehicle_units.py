"""Warnings about a vehicle with inconsistent numbers, most likely because a number is in a wrong unit.

For published multirotors, from the Crazyflie's 30 g to the M100's 2.7 kg, nine ratios vary only by a factor of a few
(SIGNS; the vehicles are in tests/model/test_vehicle_units.py and docs/how_to/own_vehicle.md). A ratio outside its range
shows that a number is wrong, but not which one. The warning names the number whose correction, from a usual mistake
(MISTAKES) or by a power of ten, brings most ratios back into their ranges.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ortilo_drake.model.vehicle import GRAVITY, M100, Vehicle

_PER_RPM = 30.0 / np.pi  # rpm in one rad/s
_UNUSUAL = 2.0  # added to the distance of a change that is not a usual mistake; equals a factor of 4 in one ratio
_POWERS = [10.0**n for n in range(-7, 8) if n]


class Sign(NamedTuple):
    """A ratio of a vehicle's numbers, its range, its median over the published vehicles, and a text for a value."""

    of: Callable[[Vehicle], float]
    low: float
    usual: float
    high: float
    says: str


def thrust_ratio(vehicle: Vehicle) -> float:
    """Return the largest thrust over the weight [1]; below 1.2 little thrust is left to tilt and climb."""
    return vehicle.largest_thrust / vehicle.hover_thrust


def hover_speed(vehicle: Vehicle) -> float:
    """Return the rotors' angular speed at hover times the arm [m/s]."""
    return float(vehicle.hover_rotor_speeds.max()) * vehicle.longest_arm


def gyration(vehicle: Vehicle) -> float:
    """Return the radius of gyration sqrt(I / m) over the arm [1], for the axis with the ratio farthest from 1."""
    ratios = np.sqrt(np.array(vehicle.inertia) / vehicle.mass) / vehicle.longest_arm
    return float(ratios[np.argmax(np.abs(np.log(ratios)))])


def flatness(vehicle: Vehicle) -> float:
    """Return I_z over the larger of I_x and I_y [1]: 2 for a flat disc, 1 for a ball, at most 2 for any body."""
    return vehicle.inertia[2] / max(vehicle.inertia[:2])


def spread(vehicle: Vehicle) -> float:
    """Return the radius of gyration about z over the radius r [1]: a body within r of its axis has I_z <= m r^2."""
    return float(np.sqrt(vehicle.inertia[2] / vehicle.mass)) / max(vehicle.longest_arm, vehicle.radius)


def arm_for_mass(vehicle: Vehicle) -> float:
    """Return the arm over the cube root of the mass [m/kg^(1/3)], which is equal for bodies of one density and form."""
    return vehicle.longest_arm / float(np.cbrt(vehicle.mass))


SIGNS = (
    Sign(lambda v: v.rotor_drag / v.rotor_lift, 1e-3, 0.025, 0.1, "the yaw torque over the thrust is {:.2g} m"),
    Sign(thrust_ratio, 1.2, 2.3, 15.0, "by rotor_lift and rotor_max_speed the rotors lift {:.3g} times the weight"),
    Sign(gyration, 0.2, 0.59, 3.0, "the radius of gyration sqrt(I/m) is {:.3g} arms"),
    Sign(flatness, 0.75, 1.8, 2.5, "I_z is {:.3g} times the larger of I_x and I_y"),
    Sign(lambda v: v.longest_arm / max(v.radius, 1e-9), 1 / 3, 0.63, 1.0, "the arm is {:.3g} of the radius"),
    Sign(arm_for_mass, 0.04, 0.19, 0.8, "the arm over the cube root of the mass is {:.2g}"),
    Sign(spread, 0.0, 0.57, 1.0, "sqrt(I_z/m) is {:.3g} times the radius"),
    Sign(hover_speed, 25.0, 92.0, 350.0, "rotor speed at hover times arm is {:.3g} m/s"),
    Sign(lambda v: max(v.rotor_time_constant), 1e-3, 0.025, 0.5, "the rotors lag by {:.3g} s"),
)
UNITS = {
    "mass": "kg",
    "inertia": "kg m²",
    "arm_length": "m",
    "rotor_lift": "N s²/rad²",
    "rotor_drag": "N m s²/rad²",
    "rotor_time_constant": "s",
    "rotor_max_speed": "rad/s",
    "radius": "m",
}
_LENGTHS = {"mm": 1e-3, "cm": 0.01, "inches": 0.0254}
_OTHER_UNITS: dict[tuple[str, ...], dict[str, float]] = {  # other possible units of the numbers, and their sizes
    ("mass",): {"g": 1e-3, "lb": 0.45359237},
    ("inertia",): {"g m²": 1e-3, "kg cm²": 1e-4, "kg mm²": 1e-6, "g cm²": 1e-7, "g mm²": 1e-9},
    ("arm_length",): _LENGTHS,
    ("radius",): _LENGTHS,
    ("arm_length", "radius"): _LENGTHS,
    ("rotor_lift",): {"gram-force": GRAVITY / 1e3},
    ("rotor_time_constant",): {"ms": 1e-3},
    ("rotor_max_speed",): {"rpm": 1.0 / _PER_RPM, "rev/s": 2.0 * np.pi},
}
_LIFT, _DRAG = {"rotor_lift": _PER_RPM**2}, {"rotor_drag": _PER_RPM**2}
MISTAKES: list[tuple[str, dict[str, float]]] = [  # usual mistakes, and the factors that correct the numbers
    *((f"in {unit}", dict.fromkeys(keys, size)) for keys, of in _OTHER_UNITS.items() for unit, size in of.items()),
    ("the whole wheelbase", {"arm_length": 0.5}),
    ("the diameter", {"radius": 0.5}),
    *(("per rpm²", factors) for factors in (_LIFT, _DRAG, _LIFT | _DRAG)),
    ("per rpm² and in rpm", _LIFT | _DRAG | {"rotor_max_speed": 1.0 / _PER_RPM}),
]


class Change(NamedTuple):
    """The corrected values of some fields, and the mistake, if it is a usual one."""

    values: dict[str, Any]
    mistake: str = ""


def vehicle_units(vehicle: Vehicle) -> list[str]:
    """Return a line for each number that does not fit the others: the field, its value, and the usual range."""
    lines: list[str] = []
    now, odd = vehicle, _odd(vehicle)
    while odd:
        changes = _changes(now)
        remaining = [_odd(_changed(now, change)) for change in changes]
        best = min(range(len(changes)), key=lambda i: (len(remaining[i]), _far(now, changes[i])))
        change, left = changes[best], remaining[best]
        if len(left) >= len(odd):
            left_out = ", ".join(key for key in UNITS if getattr(vehicle, key) == getattr(M100, key))
            taken = f" The M100's are: {left_out}" if left_out else ""
            return [*lines, f"vehicle: {_said(odd, now)}; is each in SI units, arm and radius from the centre?{taken}"]
        rivals = [one for one, odds in zip(changes, remaining, strict=True) if one.mistake and len(odds) == len(left)]
        rivals.sort(key=lambda one: _far(now, one))
        mended = [sign for sign in odd if sign not in left]
        numbers = ", ".join(_number(vehicle, key) for key in change.values)
        lines.append(f"vehicle.{numbers}: {_said(mended, now)}{_asked(vehicle, change, rivals)}")
        now, odd = _changed(now, change), left
    return lines


def _odd(vehicle: Vehicle) -> list[Sign]:
    return [sign for sign in SIGNS if not sign.low <= sign.of(vehicle) <= sign.high]


def _changes(vehicle: Vehicle) -> list[Change]:
    """Return all changes to try: corrections of the usual mistakes, then each number times each power of ten."""
    usual = [Change({key: _times(vehicle, key, by) for key, by in by_key.items()}, said) for said, by_key in MISTAKES]
    drag, lift, most = vehicle.rotor_drag, vehicle.rotor_lift, vehicle.rotor_max_speed
    reach = max(vehicle.radius, 1.6 * vehicle.longest_arm)  # reach of the propellers, if the radius leaves them out
    return [
        *usual,
        Change({"rotor_lift": drag, "rotor_drag": lift}, "swapped"),
        Change({"rotor_drag": drag * lift}, "the ratio of torque to thrust, in m"),
        Change({"rotor_lift": lift / most**2}, "the thrust at full speed, in N"),
        Change({"radius": reach}, "that of the frame without propellers"),
        Change({"inertia": tuple(sorted(vehicle.inertia))}, "in another order than I_x, I_y, I_z"),
        *(Change({key: _times(vehicle, key, by)}) for key in UNITS for by in _POWERS),
    ]


def _times(vehicle: Vehicle, key: str, factor: float) -> Any:
    value = getattr(vehicle, key)
    return tuple(factor * one for one in value) if isinstance(value, tuple) else factor * value


def _changed(vehicle: Vehicle, change: Change) -> Vehicle:
    """Return the vehicle with the changed values, without validation, as it may be unable to hover."""
    values = dict(change.values)
    if "arm_length" in values and vehicle.arms is not None:
        by = values["arm_length"] / vehicle.arm_length
        values["arms"] = tuple(one.model_copy(update={"length": by * one.length}) for one in vehicle.arms)
    return vehicle.model_copy(update=values)


def _far(vehicle: Vehicle, change: Change) -> float:
    """Return the distance of the changed vehicle's ratios from the usual ones, larger for an unusual mistake."""
    changed = _changed(vehicle, change)
    far = sum(float(np.log(sign.of(changed) / sign.usual)) ** 2 for sign in SIGNS)
    return far if change.mistake else far + _UNUSUAL


def _number(vehicle: Vehicle, key: str) -> str:
    """Return a field with its value and unit as text."""
    if key == "arm_length" and vehicle.arms is not None:
        return f"arms: {vehicle.longest_arm:.4g} m"
    value = getattr(vehicle, key)
    digits = ", ".join(f"{one:.4g}" for one in value) if isinstance(value, tuple) else f"{value:.4g}"
    return f"{key}: {digits} {UNITS[key]}"


def _asked(vehicle: Vehicle, change: Change, rivals: list[Change]) -> str:
    """Return the question to the user about the change, if there is one, with the other equally good mistakes."""
    key = next(iter(change.values))
    of_arms = key == "arm_length" and vehicle.arms is not None
    if not of_arms and getattr(vehicle, key) == getattr(M100, key):
        return "; it is the M100's, is it yours?"
    if not change.mistake:
        return ""
    same = [one.mistake for one in rivals if one.values.keys() == change.values.keys()]
    others = [
        f", or {' and '.join(one.values)} {one.mistake}" for one in rivals if one.values.keys() != change.values.keys()
    ]
    return f"; {'is it' if len(change.values) == 1 else 'are they'} {' or '.join(same)}{''.join(others)}?"


def _said(signs: list[Sign], vehicle: Vehicle) -> str:
    """Return the first two signs with their values and usual ranges as text."""
    return "; ".join(
        f"{sign.says.format(sign.of(vehicle))}, usual is "
        + (f"{sign.low:.3g} to {sign.high:g}" if sign.low else f"up to {sign.high:g}")
        for sign in signs[:2]
    )
