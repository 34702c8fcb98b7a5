"""Walls traced over the picture of a floor plan, as rectangles along its sides.

Dark pixels are walls, once a morphological opening (Serra, "Image Analysis and Mathematical Morphology", 1982) has
taken away what is too thin. They are cut into rectangles row by row: a run of dark pixels that goes on in the next row,
at the same columns to a pixel, goes on as the same rectangle. The same is done column by column, and the fewer
rectangles are kept, but for spots. A wall at an angle to the picture's sides becomes many small ones, or none.
"""

from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from ortilo_drake.model.input_files import read_bytes
from ortilo_drake.model.room import MAX_OBSTACLES, MAX_PIXELS
from ortilo_drake.model.typed_yaml import InputError

SHORTEST = 0.3  # of a wall of the least thickness [m]; what covers less is a spot
THINNEST = 0.04  # [m]; thinner lines are furniture, dimensions or letters
_JAGGED = 1  # by which an edge may go in and out from row to row [px]
_HEADER = 32  # bytes of a PNG before its picture
_KEPT_OFF = 0.3  # of start and goal from the ends of the room, as a share of its length


class Traced(NamedTuple):
    """Walls of a floor plan, from the lower left corner of the space within the outer ones; x right, y up.

    Attributes:
        walls: x, y of the middle, length along x and along y [m] (n, 4).
        size: of the space within, along x and y [m] (2).
        covered: share of the thick dark pixels that are in a wall [1].
        start: the roomiest place in its left part [m] (2).
        goal: the roomiest place in its right part that a free way leads to from there [m] (2).
    """

    walls: np.ndarray
    size: np.ndarray
    covered: float
    start: np.ndarray
    goal: np.ndarray


def read_plan(file: Path) -> np.ndarray:
    """Return a picture's brightness, row by row from the top (h, w), 0 to 255.

    Raises:
        InputError: if it cannot be read, is no picture or too large.
    """
    data = read_bytes(file)
    if data[:8] == b"\x89PNG\r\n\x1a\n" and len(data) > _HEADER:
        width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))
        if width * height > MAX_PIXELS:
            raise InputError(f"{file}: {width} x {height} px: must have at most {MAX_PIXELS} px")
    else:
        raise InputError(f"{file}: is no PNG picture")
    try:
        found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        found = None
    if found is None:
        raise InputError(f"{file}: is no whole PNG picture")
    return np.asarray(_brightness(found))


def _brightness(picture: np.ndarray) -> np.ndarray:
    """Return grey values over white paper, of a grey or coloured picture, with or without an opacity."""
    values = picture.astype(np.float32) / (65535.0 if picture.dtype == np.uint16 else 255.0)
    if values.ndim == 2:
        return (255.0 * values).astype(np.uint8)
    opacity = values[..., 3:4] if values.shape[2] == 4 else 1.0
    over_white = values[..., :3] * opacity + (1.0 - opacity)
    return (255.0 * over_white @ np.array([0.114, 0.587, 0.299], np.float32)).astype(np.uint8)


def _rectangles(dark: np.ndarray) -> list[tuple[int, int, int, int]]:
    """Return dark (h, w) cut into rectangles row by row: left, top, width and height of each [px]."""
    found, going = [], list[tuple[int, int, int]]()  # going: left, right and top of those that may go on
    for row, line in enumerate(np.vstack([dark, np.zeros_like(dark[:1])])):
        edges = np.flatnonzero(np.diff(np.pad(line, 1).astype(np.int8)))
        still = []
        for left, right in edges.reshape(-1, 2).tolist():
            same = [one for one in going if abs(one[0] - left) <= _JAGGED and abs(one[1] - right) <= _JAGGED]
            if same:
                going.remove(same[0])
            still.append(same[0] if same else (left, right, row))
        found += [(left, top, right - left, row - top) for left, right, top in going]
        going = still
    return found


def trace_plan(grey: np.ndarray, scale: float, dark: int) -> Traced:
    """Return the walls of a floor plan.

    Args:
        grey: its brightness, rows from the top (h, w).
        scale: pixels a metre.
        dark: brightness below which a pixel is a wall.

    Raises:
        InputError: if there are no walls, or too many.
    """
    thin = 2 * max(int(THINNEST * scale / 2.0), 1) + 1  # odd: an even one would shift the walls by a pixel
    mask = cv2.morphologyEx((grey < dark).astype(np.uint8), cv2.MORPH_OPEN, np.ones((thin, thin), np.uint8))
    turned = [(x, y, w, h) for y, x, h, w in _rectangles(mask.T)]
    kept = [bar for bar in min(_rectangles(mask), turned, key=len) if bar[2] * bar[3] >= thin * SHORTEST * scale]
    covered = np.zeros_like(mask)
    for x, y, w, h in kept:
        covered[y : y + h, x : x + w] = 1
    if not kept or len(kept) > MAX_OBSTACLES:
        raise InputError(
            f"--dark, --scale: {len(kept)} walls found with {dark} and {scale:g} px/m: must be 1 to {MAX_OBSTACLES}; "
            f"a wall is dark, at least {SHORTEST:g} m long and {THINNEST:g} m thick"
        )
    left, top, right, bottom = _within(covered)
    size = np.array([right - left, bottom - top])
    corners = np.array([[x - left, bottom - y - h, x + w - left, bottom - y] for x, y, w, h in kept])
    low, high = np.maximum(corners[:, :2], 0), np.minimum(corners[:, 2:], size)  # what lies within the outer walls
    within = np.hstack([(low + high) / 2, high - low])[np.all(low < high, axis=1)]
    ends = _ends(1 - covered[top:bottom, left:right])
    start, goal = (np.array([column, size[1] - row]) for column, row in ends)
    share = float(covered[mask > 0].mean())
    return Traced(within / scale, size / scale, share, start / scale, goal / scale)


def _within(walls: np.ndarray) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom [px] of the space that walls enclose, or of the walls if they enclose none."""
    paper = np.pad(1 - walls, 1, constant_values=1)  # a border to go around by
    _, regions, stats, _ = cv2.connectedComponentsWithStats(paper, connectivity=4)
    enclosed = [i for i in range(1, len(stats)) if i != regions[0, 0]]
    rows, columns = np.nonzero(np.isin(regions, enclosed) if enclosed else np.pad(walls, 1))
    return int(columns.min()) - 1, int(rows.min()) - 1, int(columns.max()), int(rows.max())


def _ends(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return column and row [px] of the roomiest places (2 each) at the left and at the right that are connected."""
    away = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    _, regions = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    width = free.shape[1]
    across = (np.arange(width) + 0.5) / width
    near, far = away * (across < _KEPT_OFF), away * (across > 1.0 - _KEPT_OFF)
    start = np.unravel_index(int(np.argmax(near)), near.shape)
    goal = np.unravel_index(int(np.argmax(far * (regions == regions[start]))), far.shape)
    return np.array([start[1] + 0.5, start[0] + 0.5]), np.array([goal[1] + 0.5, goal[0] + 0.5])
