"""Units of the numbers in signals, found by the numbers' names."""

from typing import Final

from ortilo_drake.model.measurement import Rows
from ortilo_drake.model.signals import CONTROL_NAMES, INTEGRAL_NAMES, STATE_NAMES

_OF_STATES = ("m",) * 3 + ("rad",) * 3 + ("m/s",) * 3 + ("rad/s",) * 3
_UNITS: Final = {
    **dict(zip(STATE_NAMES, _OF_STATES, strict=True)),
    **dict.fromkeys(INTEGRAL_NAMES, "m"),  # a sum over ticks, without the tick's length
    **dict(zip(CONTROL_NAMES, ("N", "N m", "N m", "N m"), strict=True)),
    **{f"r_{axis}{dots}": unit for dots, unit in (("", "m"), ("_dot", "m/s"), ("_ddot", "m/s^2")) for axis in "xyz"},
}
# Extra states of a filter, and the accelerometer's rows (onboard/estimator/extra_states.py); W_1, W_2, ... are rotor
# speeds.
_BY_LETTER: Final = {"d": "N", "f": "N", "n": "N m", "b": "m/s^2", "a": "m/s^2", "c": "rad/s", "W": "rad/s"}


def unit_of(name: str, rows: Rows = ()) -> str:
    """Return the unit of a number by its name, for example 'm/s' for x_dot, x_dot_hat and x_dot_flow.

    The number may be a state, an estimate, a control, a reference, a row of y or a bias of a row. A row of y has the
    unit of the first vehicle state in the row.
    """
    name = name.removesuffix("_hat").removeprefix("bias_")
    for row in (row for _, own in rows for row in own if row.name == name):
        seen = [state for state, _ in row.sees if state in STATE_NAMES]
        if seen:
            return _UNITS[seen[0]]
    return _UNITS.get(name) or _BY_LETTER[name.partition("_")[0]]


def product_of_units(a: str, b: str) -> str:
    """Return the product of two units as text, for example '(m/s)^2' or 'm rad/s'."""
    if a != b:
        return f"{a} {b}"
    return f"({a})^2" if "/" in a or " " in a else f"{a}^2"
