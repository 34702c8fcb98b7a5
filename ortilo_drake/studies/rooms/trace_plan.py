"""Floor plans, and walls traced over them as rectangles along their sides.

A plan is a picture of dark walls on light paper, or an occupancy grid of ROS's map_server: a picture and a .yaml beside
it (wiki.ros.org/map_server) with `resolution` in metres a pixel and `origin` of the lower left pixel in the map's
frame. The probability p that a pixel of value v is occupied is (255 - v) / 255, or v / 255 with `negate`, or v / 100 in
mode `raw`. A pixel is a wall if p > occupied_thresh, and free if p < free_thresh.

First, a morphological opening (Serra, "Image Analysis and Mathematical Morphology", 1982) removes wall pixels that are
too thin. The others are cut into rectangles row by row: a run that continues in the next row, at the same columns to a
pixel, continues the same rectangle. The same is done column by column, and the smaller set of rectangles is kept,
without spots. A wall at an angle to the picture's sides becomes many small rectangles, or none. If a pixel is as wide
as the thinnest wall, like the 5 cm cells of a robot's map, nothing is too thin.
"""

import io
import math
import warnings
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from PIL import Image, UnidentifiedImageError
from pydantic import ConfigDict, Field

from ortilo_drake.model.input_files import MIB, exists, read_bytes, reason
from ortilo_drake.model.optional import later
from ortilo_drake.model.room import MAX_OBSTACLES, MAX_PIXELS
from ortilo_drake.model.typed_yaml import FileName, Frozen, InputError, Positive, load_yaml

_LARGEST = 256 * MIB  # largest picture's file: MAX_PIXELS of 16 bit in four channels take half of this
_FORMATS = ("PNG", "PPM", "BMP", "JPEG", "TIFF")  # Pillow's PPM includes .pgm
Threshold = Annotated[float, Field(ge=0.0, le=1.0)]


class FloorPlan(NamedTuple):
    """The drawing over which walls are traced, row by row from the top.

    wall: mask of wall pixels (h, w); free: mask of pixels known to be no wall (h, w), in a picture all others; scale:
    pixels a metre; corner: x, y of the lower left pixel in the plan's frame [m] (2); what: when a pixel is a wall, in
    words; scaled_by: the source of the scale, in words.
    """

    wall: np.ndarray
    free: np.ndarray
    scale: float
    corner: np.ndarray
    what: str
    scaled_by: str


class GridFile(Frozen):
    """The .yaml of an occupancy grid; other keys are ignored."""

    model_config = ConfigDict(extra="ignore")

    image: FileName
    resolution: Positive
    origin: tuple[float, float, float] | tuple[float, float] = (0.0, 0.0, 0.0)
    negate: Literal[0, 1, False, True] = 0
    occupied_thresh: Threshold = 0.65
    free_thresh: Threshold = 0.196
    mode: Literal["trinary", "scale", "raw"] = "trinary"


def read_plan(file: Path, scale: float | None, dark: int) -> FloorPlan:
    """Return the floor plan in a picture (PNG, PGM, BMP, JPEG or TIFF), or in the .yaml of an occupancy grid.

    scale: pixels a metre, None for a grid, which has a resolution; dark: a picture's pixel is a wall if darker than
    this. InputError if the file cannot be read or is too large, or if the scale is given twice or not at all.
    """
    if file.suffix in (".yaml", ".yml"):
        if scale is not None:
            raise InputError(f"--scale: {scale:g}: must be left out: {file} has a resolution")
        return _grid(file)
    if scale is None:
        raise InputError(f"--scale: is missing: how many pixels of {file} are a metre")
    wall = _brightness(read_picture(file)) < dark
    return FloorPlan(wall, ~wall, scale, np.zeros(2), f"darker than {dark} of 255 (--dark)", "--scale")


def _grid(file: Path) -> FloorPlan:
    grid = load_yaml(GridFile, file)
    if len(grid.origin) > 2 and grid.origin[2] != 0.0:
        raise InputError(f"{file}: origin: {list(grid.origin)}: its yaw must be 0: turn the picture instead")
    picture = file.parent / grid.image
    if not exists(picture):
        beside = [found for end in (".pgm", ".png") if exists(found := file.with_suffix(end))]
        if not beside:
            raise InputError(f"{file}: image: {grid.image}: no such picture")
        picture = beside[0]  # people rename both files together and leave `image` as it was
    v = _brightness(read_picture(picture)).astype(float)
    p = v / 255.0 if grid.negate else (255.0 - v) / 255.0
    if grid.mode == "raw":
        p = np.where(v <= 100.0, v / 100.0, 0.5 * (grid.occupied_thresh + grid.free_thresh))
    wall, free = p > grid.occupied_thresh, p < grid.free_thresh
    origin = np.array(grid.origin[:2], dtype=float)
    return FloorPlan(
        wall, free, 1.0 / grid.resolution, origin, f"over occupied_thresh {grid.occupied_thresh:g}", "resolution"
    )


def read_picture(file: Path) -> np.ndarray:
    """Return a picture's pixels, grey (h, w) or red, green, blue, opacity (h, w, 4); InputError if it is no picture."""
    data = read_bytes(file, _LARGEST)
    try:
        Image.MAX_IMAGE_PIXELS = None  # the limit below has our own message
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(data), formats=_FORMATS) as opened:
            width, height = opened.size
            if width * height > MAX_PIXELS:
                raise InputError(f"{file}: {width} x {height} px: must have at most {MAX_PIXELS} px")
            opened.verify()  # checks a PNG's check sums, which reading its pixels does not
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(data), formats=_FORMATS) as opened:
            return _values(opened)
    except InputError:
        raise
    except UnidentifiedImageError:
        raise InputError(
            f"{file}: is no picture of the kinds {', '.join(_FORMATS)} (.pgm), nor a map_server .yaml"
        ) from None
    except Exception as error:  # Pillow raises nearly any exception for a damaged picture
        raise InputError(f"{file}: is no whole picture: {reason(error)}") from None


def _values(picture: Image.Image) -> np.ndarray:
    if picture.mode.startswith("I"):  # 16 bit
        return np.asarray(picture).astype(np.uint16)
    is_grey = picture.mode in ("1", "L") and "transparency" not in picture.info
    return np.asarray(picture.convert("L" if is_grey else "RGBA"))


def _brightness(picture: np.ndarray) -> np.ndarray:
    """Return grey values over white paper, 0 to 255 (h, w), of a picture from read_picture."""
    if picture.dtype == np.uint16:
        return (picture // 257).astype(np.uint8)
    if picture.ndim == 2:
        return picture
    opacity = picture[..., 3].astype(np.float32) / np.float32(255.0)
    grey = picture[..., :3] @ np.array([0.299, 0.587, 0.114], np.float32)
    return (grey * opacity + np.float32(255.0) * (1.0 - opacity)).astype(np.uint8)


cv2 = later("cv2")

SHORTEST = 0.3  # least length of a wall of the least thickness [m]; a smaller area is a spot
THINNEST = 0.04  # least thickness of a wall, in whole pixels; thinner lines are furniture, dimensions or letters [m]
_JAGGED = 1  # an edge may shift by so much from row to row [px]
_MOST = 0.5  # least share of the free space within closed outer walls, and of wall in a line that is a wall with gaps
_KEPT_OFF = 0.3  # start and goal are in this share of the room's length at the left and at the right


class Traced(NamedTuple):
    """Walls of a floor plan, from the lower left corner of the space within the outer ones; x right, y up."""

    walls: np.ndarray
    """x, y of each wall's middle, length along x and along y [m] (n, 4)."""
    size: np.ndarray
    """size of the space within the outer walls, along x and y [m] (2)."""
    covered: float
    """share of the thick enough dark pixels that lie in a traced wall [1]."""
    start: np.ndarray
    """the roomiest place in the space's left part [m] (2)."""
    goal: np.ndarray
    """the roomiest place in the space's right part to which a free way leads from start. If no way leads there, it is
    the farthest of the roomier places; if nothing is free, it is start itself [m] (2)."""
    corner: np.ndarray
    """lower left corner of the space within the outer walls, in the plan's frame [m] (2)."""


def _rectangles(dark: np.ndarray) -> list[tuple[int, int, int, int]]:
    """Return the mask dark (h, w) cut into rectangles row by row: left, top, width and height of each [px]."""
    found, going = [], dict[int, tuple[int, int, int]]()  # going: left, right, top of rectangles still open, by left
    for row, line in enumerate(np.vstack([dark, np.zeros_like(dark[:1])])):
        edges = np.flatnonzero(np.diff(np.pad(line, 1).astype(np.int8)))
        still = {}
        for left, right in edges.reshape(-1, 2).tolist():
            near = (going.get(left + step) for step in range(-_JAGGED, _JAGGED + 1))
            same = next((one for one in near if one and abs(one[1] - right) <= _JAGGED), (left, right, row))
            if going.get(same[0]) is same:
                del going[same[0]]
            still[same[0]] = same
        found += [(left, top, right - left, row - top) for left, right, top in going.values()]
        going = still
    return found


def thinnest(scale: float) -> int:
    """Return the least thickness of a wall [px]; scale: pixels a metre."""
    pixels = THINNEST * scale
    return max(math.ceil(pixels), 1) if pixels <= 2.0 else 2 * max(int(pixels / 2.0), 1) + 1


def _opened(wall: np.ndarray, thin: int) -> np.ndarray:
    """Return the mask without parts thinner than `thin` pixels; the rest does not move."""
    square, first = np.ones((thin, thin), np.uint8), thin // 2
    eroded = cv2.erode(wall.astype(np.uint8), square, anchor=(first, first))
    return np.asarray(cv2.dilate(eroded, square, anchor=(thin - 1 - first, thin - 1 - first)))


def _is_wall(width: int, height: int, thin: int, shortest: float) -> bool:
    """Return whether a rectangle is a wall or a pillar rather than a spot; all lengths in pixels."""
    area = width * height
    return area >= max(thin, 3) * shortest or (area >= thin * shortest and max(width, height) >= shortest)


def trace_plan(plan: FloorPlan) -> Traced:
    """Return the walls of a floor plan; InputError if there are no walls, or too many."""
    scale, thin = plan.scale, thinnest(plan.scale)
    mask = _opened(plan.wall, thin)
    turned = [(x, y, w, h) for y, x, h, w in _rectangles(mask.T)]
    kept = [bar for bar in min(_rectangles(mask), turned, key=len) if _is_wall(*bar[2:], thin, SHORTEST * scale)]
    covered = np.zeros_like(mask)
    for x, y, w, h in kept:
        covered[y : y + h, x : x + w] = 1
    if not kept or len(kept) > MAX_OBSTACLES:
        long = math.ceil(SHORTEST * scale)
        raise InputError(
            f"{len(kept)} walls found, must be 1 to {MAX_OBSTACLES}: at {scale:g} px/m ({plan.scaled_by}) a wall is "
            f"{plan.what}, at least {thin} px ({thin / scale:.2g} m) thick and {long} px ({long / scale:.2g} m) long; "
            f"{plan.wall.mean():.1%} of the plan is that dark, {mask.mean():.1%} thick enough as well"
        )
    left, top, right, bottom = _within(covered, plan.free)
    size = np.array([right - left, bottom - top])
    corners = np.array([[x - left, bottom - y - h, x + w - left, bottom - y] for x, y, w, h in kept])
    low, high = np.maximum(corners[:, :2], 0), np.minimum(corners[:, 2:], size)  # the parts within the outer walls
    within = np.hstack([(low + high) / 2, high - low])[np.all(low < high, axis=1)]
    ends = _ends(1 - covered[top:bottom, left:right])
    start, goal = (np.array([column, size[1] - row]) for column, row in ends)
    share = float(covered[mask > 0].mean())
    corner = plan.corner + np.array([left, len(mask) - bottom]) / scale
    return Traced(within / scale, size / scale, share, start / scale, goal / scale, corner)


def _within(walls: np.ndarray, free: np.ndarray) -> tuple[int, int, int, int]:
    """Return left, top, right, bottom [px] of the space within the outer walls.

    This is the space that walls enclose. If the walls have gaps, it is the largest connected free space of a map, or
    the extent of the walls in a picture.
    """
    paper = np.pad(1 - walls, 1, constant_values=1)  # with a border that connects the outside
    _, regions, stats, _ = cv2.connectedComponentsWithStats(paper, connectivity=4)
    enclosed = np.isin(regions, [i for i in range(1, len(stats)) if i != regions[0, 0]])
    space = np.pad(free & (walls == 0), 1)
    is_map = not np.all(space[1:-1, 1:-1] | (walls > 0))  # some of it is unknown
    if is_map and (enclosed & space).sum() < _MOST * space.sum():
        _, regions, stats, _ = cv2.connectedComponentsWithStats(space.astype(np.uint8), connectivity=4)
        enclosed = regions == 1 + int(np.argmax(stats[1:, cv2.CC_STAT_AREA]))
    rows, columns = np.nonzero(enclosed if enclosed.any() else np.pad(walls, 1))
    left, top, right, bottom = int(columns.min()) - 1, int(rows.min()) - 1, int(columns.max()), int(rows.max())
    while left < right and walls[top:bottom, left].mean() > _MOST and enclosed.any():  # an outer wall with a gap
        left += 1
    while left < right and walls[top:bottom, right - 1].mean() > _MOST and enclosed.any():
        right -= 1
    while top < bottom and walls[top, left:right].mean() > _MOST and enclosed.any():
        top += 1
    while top < bottom and walls[bottom - 1, left:right].mean() > _MOST and enclosed.any():
        bottom -= 1
    return left, top, right, bottom


def _ends(free: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return column and row [px] (2 each) of the roomiest places at the left and at the right that are connected."""
    away = cv2.distanceTransform(np.pad(free, 1).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    _, regions = cv2.connectedComponents(free.astype(np.uint8), connectivity=4)
    width = free.shape[1]
    across = (np.arange(width) + 0.5) / width
    near = away * (across < _KEPT_OFF)
    start = np.unravel_index(int(np.argmax(near if near.any() else away)), away.shape)
    reached = away * (regions == regions[start])
    far = reached * (across > 1.0 - _KEPT_OFF)
    if reached.any() and not far.any():  # no way leads to the right: take the farthest of the roomier places reached
        rows, columns = np.nonzero(reached >= 0.5 * reached.max())
        far[rows, columns] = np.hypot(rows - start[0], columns - start[1])
    goal = np.unravel_index(int(np.argmax(far)), far.shape)
    return np.array([start[1] + 0.5, start[0] + 0.5]), np.array([goal[1] + 0.5, goal[0] + 0.5])
