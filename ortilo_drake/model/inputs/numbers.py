"""Numbers as text, in plain decimal digits only, and angles that may be degrees.

Python's int and float also take digits of other scripts and underscores within, which nobody types and other programs
that read the same address do not take.
"""

import math
import re


def whole(text: str) -> int:
    """Return a whole number; ValueError if the text is anything but digits with a sign before them."""
    if not re.fullmatch(r" *[+-]?[0-9]{1,20} *", text):
        raise ValueError(f"{text!r}: must be a whole number")
    return int(text)


def decimal(text: str) -> float:
    """Return a number, which may have a point and an exponent; ValueError if the text is anything else."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"{text!r}: must be a number")
    return float(text)


def is_port(text: str) -> bool:
    """Return whether a text is the number of a port that can be connected to."""
    return re.fullmatch("[0-9]{1,5}", text) is not None and 0 < int(text) < 65536


def not_radians(value: float) -> str | None:
    """Return the reason why a value is no angle within a turn either way [rad]; None if it is one."""
    if abs(value) <= 2.0 * math.pi:
        return None
    return f"{value:g}: must be within -6.283 and 6.283 radians; {value:g} degrees are {math.radians(value):.3g}"
