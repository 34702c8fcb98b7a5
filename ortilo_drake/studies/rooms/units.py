"""Rooms whose lengths are hardly metres: the likely unit, and the factor to metres."""

from typing import Final

import numpy as np

from ortilo_drake.model.room import Room

UNITS: Final = {"feet": 0.3048, "inches": 0.0254, "centimetres": 0.01, "millimetres": 0.001, "kilometres": 1000.0}
SIDES, HEIGHTS = (1.5, 300.0), (1.5, 30.0)  # of what is taken for a room as it stands [m]
_SIDES, _HEIGHTS = (2.0, 100.0), (2.0, 6.0)  # of what another unit must make of it [m]
_IN_FEET = (7.0, 11.0)  # a hall is as high, and a room of so many feet [m]
_STANDS = 0.3  # what begins lower stands on the floor [m]


def doubted_units(room: Room) -> list[str]:
    """Return a line for each group of lengths that are hardly metres, beginning with the field; none if all may be."""
    low, high = np.array(room.interior.min), np.array(room.interior.max)
    size = high - low
    unit = _unit_of(room, size)
    if unit is None:
        return _anchors_alone(room, low, high)
    factor, places = UNITS[unit], _places(room)
    also = [name for name, values in places.items() if _is_scaled(values, np.abs([low, high]).max(), factor)]
    fields = f"interior, {', '.join(also)} by {factor:g}" if also else f"it by {factor:g}"
    return [
        f"interior: {_sizes(size)} m: in {unit} it would be {_sizes(size * factor)} m; lengths are in metres: "
        f"multiply {fields}"
    ]


def _unit_of(room: Room, size: np.ndarray) -> str | None:
    sides, height = size[:2], size[2]
    if not (SIDES[0] <= sides.min() and sides.max() <= SIDES[1] and HEIGHTS[0] <= height <= HEIGHTS[1]):
        fits = [unit for unit, factor in UNITS.items() if _is_room(size * factor)]
        return fits[0] if fits else None
    standing = [p[2] - half for p, half in zip(room.landmark_positions, room.landmark_sizes[:, 2] / 2, strict=True)]
    is_high = _IN_FEET[0] <= height <= _IN_FEET[1] and _is_room(size * UNITS["feet"])
    return "feet" if is_high and min(standing, default=np.inf) > room.interior.min[2] + _STANDS else None


def _is_room(size: np.ndarray) -> bool:
    within = _SIDES[0] <= size[:2].min() and size[:2].max() <= _SIDES[1]
    return bool(within and _HEIGHTS[0] <= size[2] <= _HEIGHTS[1])


def _places(room: Room) -> dict[str, np.ndarray]:
    """Return the coordinates of all that is placed in a room, by field."""
    ends = [*(room.start or ()), *(room.goal or ())]
    found = {
        "anchors": room.anchor_positions,
        "landmarks": room.landmark_positions,
        "walls": room.wall_boxes[:, :2],
        "stands": np.array(room.stands),
        "furniture": np.array([item[1:4] for item in room.furniture]),
        "start and goal": np.array(ends),
    }
    return {name: values for name, values in found.items() if values.size}


def _is_scaled(values: np.ndarray, farthest: float, factor: float) -> bool:
    """Return whether places lie over the interior as it stands, rather than in a corner of it."""
    reach = float(np.abs(values).max())
    return reach > farthest * np.sqrt(factor) if factor < 1.0 else reach < farthest * np.sqrt(factor)


def _anchors_alone(room: Room, low: np.ndarray, high: np.ndarray) -> list[str]:
    """Return a line if most anchors are outside, and all would be within if they were in another unit."""
    anchors = room.anchor_positions

    def within(p: np.ndarray) -> np.ndarray:
        return np.all((p >= low - 0.5) & (p <= high + 0.5), axis=1)

    if np.count_nonzero(~within(anchors)) * 2 <= len(anchors):
        return []
    for unit, factor in UNITS.items():
        if within(anchors * factor).all() and np.ptp(anchors * factor, axis=0)[:2].max() > 0.2 * (high - low)[:2].max():
            return [
                f"anchors: {np.count_nonzero(~within(anchors))} of {len(anchors)} lie outside the interior; in {unit} "
                f"all would be within: lengths are in metres: multiply them by {factor:g}"
            ]
    return []


def _sizes(sides: np.ndarray) -> str:
    return " x ".join(f"{side:.4g}" for side in sides)
