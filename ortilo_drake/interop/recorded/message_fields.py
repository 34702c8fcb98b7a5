"""Fields of a message by the names in a map. The message may be decoded by rosbags, mcap or ROS itself.

A recording may define its own types. Such types are refused where decoding a short message would never end.
"""

import re
from typing import Any, Final

import numpy as np
from rosbags.interfaces import Nodetype

from ortilo_drake.interop.recorded.sources import Column

_PART = re.compile(r"([^\[\].]+)|\[(\d+)\]")


def field_of(message: Any, path: str) -> Any:
    """Return a field by its path, such as `pose.position.x` or `ranges[2]`; LookupError if there is no such field.

    A name after a list of messages gives the list of their fields: `measurements.distance`.
    """
    value = message
    for name, index in _PART.findall(path):
        try:
            if index:
                value = value[int(index)]
            else:
                value = [getattr(one, name) for one in value] if isinstance(value, list) else getattr(value, name)
        except (AttributeError, IndexError, TypeError):
            raise LookupError(path) from None
    return value


def _seconds(stamp: Any) -> float:
    """Return a stamp [s]; its nanoseconds are called nanosec in ROS 2, nsec elsewhere."""
    return float(stamp.sec + 1e-9 * getattr(stamp, "nanosec", getattr(stamp, "nsec", 0)))


def stamp_of(message: Any, received: int, time: Column | tuple[Column, Column] | None) -> float:
    """Return a message's stamp: the field `time`, else the header's stamp [s], else its time of receipt (ns) in s."""
    if isinstance(time, tuple):
        whole, nanoseconds = (float(field_of(message, str(one))) for one in time)
        return whole + 1e-9 * nanoseconds
    if time is not None:
        value = field_of(message, str(time))
        return _seconds(value) if hasattr(value, "sec") else float(value)
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    found = _seconds(stamp) if hasattr(stamp, "sec") else 0.0
    return found if found != 0.0 else received * 1e-9


def numbers_of(message: Any, columns: tuple[Column, ...]) -> list[float]:
    """Return the numbers in fields of a message, all entries of a field that is a list; LookupError if one lacks."""
    found: list[float] = []
    for column in columns:
        value = np.asarray(field_of(message, str(column)), dtype=float)
        found.extend(value.ravel().tolist())
    return found


LONGEST: Final = 1000  # longest fixed-length array of texts or messages: rosbags writes lines of code for each entry


def check_types(types: Any, name: str) -> None:
    """Refuse a type with an inner message without fields, or with a long fixed-length array of anything but numbers.

    `types` are a result of rosbags' get_types_from_msg; `name` and all types that it uses are checked. A message
    without fields takes no bytes, so 8 bytes may announce an array of 4 billion such messages. The ValueError names
    type and field.
    """
    checked, left = set(), {name}
    while left:
        name = left.pop()
        checked.add(name)
        for field, (kind, inner) in types[name][1] if name in types else ():
            item, of = (kind, inner) if kind in (Nodetype.BASE, Nodetype.NAME) else inner[0]
            if item == Nodetype.NAME:
                if of in types and not types[of][1]:
                    raise ValueError(f"{name}.{field}: {of} has no fields")
                left |= {of} - checked
            numbers = item == Nodetype.BASE and of[0] != "string"
            if kind == Nodetype.ARRAY and not numbers and inner[1] > LONGEST:
                raise ValueError(f"{name}.{field}: {inner[1]} items, at most {LONGEST}")
