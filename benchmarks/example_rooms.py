"""Rooms to try designs on: a hall with pieces of wall in it, drawn from a seed."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ortilo_drake.model.room import Room, Vec3, load_room

HEIGHT = 3.0  # of a hall and its walls [m]
HEIGHTS = (1.0, 2.5)  # of anchors that are spread evenly, in turn [m]


def spread_evenly(low: np.ndarray, high: np.ndarray, n: int) -> np.ndarray:
    """Return n anchors p_W (n, 3) [m] spread evenly around the four walls, low and high in turn.

    Args:
        low: lower corner of the interior, x and y first [m].
        high: upper corner.
        n: number of anchors.
    """
    a, b = high[:2] - low[:2]
    corners = np.array([[0.0, 0.0], [a, 0.0], [a, b], [0.0, b], [0.0, 0.0]]) + low[:2]
    at = np.array([0.0, a, a + b, 2 * a + b, 2 * (a + b)])
    s = (np.arange(n) + 0.5) / n * at[-1]
    heights = [HEIGHTS[i % 2] for i in range(n)]
    return np.column_stack([np.interp(s, at, corners[:, 0]), np.interp(s, at, corners[:, 1]), heights])


def example_room(seed: int, n: int) -> Room:
    """Return a hall of 10 to 20 m by 7 to 10 m with four to eight walls across it and n anchors spread evenly.

    The ends of the hall, 2 m each, are free of walls.
    """
    rng = np.random.default_rng(seed)
    length, width = (round(float(side), 2) for side in (rng.uniform(10.0, 20.0), rng.uniform(7.0, 10.0)))
    walls = []
    for _ in range(rng.integers(4, 9)):
        x, y = rng.uniform(3.0, length - 3.0), rng.uniform(-0.5, 0.5) * width
        walls.append((round(float(x), 3), round(float(y), 3), float(rng.choice([0.0, np.pi / 2]))))
    low, high = (0.0, -width / 2, 0.0), (length, width / 2, HEIGHT)
    anchors = spread_evenly(np.array(low), np.array(high), n)
    return _bare(f"hall_{seed}", low, high, anchors.tolist(), (2.4, 0.3, HEIGHT), walls)


def two_ways() -> Room:
    """Return a hall of 20 m by 10 m with a wall along it that hides the anchors from the southern, shorter way."""
    anchors = [(1.0, 2.8), (5.0, 1.0), (10.0, 0.5), (10.0, 2.9), (15.0, 1.0), (19.0, 2.8)]
    ends = [(0.1, 2.0, 0.5), (19.9, 2.0, 0.5)]
    walls = [(x, -0.5, 0.0) for x in (6.5, 10.0, 13.5)]
    north = [(x, 4.9, z) for x, z in anchors]
    return _bare("two_ways", (0.0, -5.0, 0.0), (20.0, 5.0, HEIGHT), north + ends, (3.6, 0.4, HEIGHT), walls)


def _bare(name: str, low: Vec3, high: Vec3, anchors: Sequence[Any], wall_size: Vec3, walls: Sequence[Vec3]) -> Room:
    """Return a room with nothing in it but anchors and walls; its camera and sizes of things are the authors'."""
    changes = {
        "name": name,
        "interior": {"min": low, "max": high},
        "anchors": anchors,
        "landmarks": [],
        "wall_size": wall_size,
        "walls": walls,
        "stands": [],
        "furniture": [],
    }
    return Room.model_validate_json(
        Room.model_construct(**{**load_room().model_dump(), **changes}).model_dump_json(warnings=False)
    )
