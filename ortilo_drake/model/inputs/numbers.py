"""Numbers as text, in plain decimal digits only, and angles that may be in degrees.

Python's int and float also accept digits of other scripts and underscores, which nobody types, and which other programs
that read the same address do not accept.
"""

import math
import re


def whole(text: str) -> int:
    """Return a whole number; ValueError if the text is not digits with at most a sign before them."""
    if not re.fullmatch(r" *[+-]?[0-9]{1,20} *", text):
        raise ValueError(f"{text!r}: must be a whole number")
    return int(text)


def decimal(text: str) -> float:
    """Return a number with an optional point and exponent; ValueError if the text is not such a number."""
    if not text.isascii() or "_" in text:
        raise ValueError(f"{text!r}: must be a number")
    return float(text)


def is_port(text: str) -> bool:
    """Return whether a text is a port number from 1 to 65535."""
    return re.fullmatch("[0-9]{1,5}", text) is not None and 0 < int(text) < 65536


def not_radians(value: float) -> str | None:
    """Return the reason why a value is not an angle within [-2 pi, 2 pi] [rad]; None if it is one."""
    if abs(value) <= 2.0 * math.pi:
        return None
    return f"{value:g}: must be within -6.283 and 6.283 radians; {value:g} degrees are {math.radians(value):.3g}"
