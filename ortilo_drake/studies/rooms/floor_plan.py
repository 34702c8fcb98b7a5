"""Floor plans: pictures of dark walls on light paper, and occupancy grids as ROS's map_server keeps them.

A grid is a picture and a .yaml beside it (wiki.ros.org/map_server): `resolution` metres a pixel, `origin` of the lower
left pixel in the map's frame, and p, how surely a pixel of value v is occupied: (255 - v) / 255, v / 255 where `negate`
is set, v / 100 in mode `raw`. It is a wall where p > occupied_thresh, and free where p < free_thresh.
"""

import io
import warnings
from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import numpy as np
from PIL import Image, UnidentifiedImageError
from pydantic import ConfigDict, Field

from ortilo_drake.model.input_files import MIB, exists, read_bytes, reason
from ortilo_drake.model.room import MAX_PIXELS
from ortilo_drake.model.typed_yaml import FileName, Frozen, InputError, Positive, load_yaml

_LARGEST = 256 * MIB  # of a picture's file: MAX_PIXELS of 16 bit in four channels take half of it
_FORMATS = ("PNG", "PPM", "BMP", "JPEG", "TIFF")  # .pgm is of Pillow's PPM
Threshold = Annotated[float, Field(ge=0.0, le=1.0)]


class FloorPlan(NamedTuple):
    """The drawing over which walls are traced, row by row from the top.

    A pixel is a wall (h, w), or known to be none, free (h, w); of a picture whatever is no wall. The scale is in pixels
    a metre, the corner x, y of the lower left one in the plan's frame [m] (2). `what` makes a pixel a wall, and the
    scale is from scaled_by, in words.
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

    The scale is in pixels a metre, None for a grid, which has a resolution; a pixel of a picture is a wall if darker
    than `dark`. InputError if it cannot be read, is too large, or its scale is given twice or not at all.
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
        picture = beside[0]  # renamed together, as people do
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
    """Return a picture's pixels, grey (h, w) or red, green, blue, opacity (h, w, 4); InputError if it is none."""
    data = read_bytes(file, _LARGEST)
    try:
        Image.MAX_IMAGE_PIXELS = None  # the limit here is told in our own words
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(data), formats=_FORMATS) as opened:
            width, height = opened.size
            if width * height > MAX_PIXELS:
                raise InputError(f"{file}: {width} x {height} px: must have at most {MAX_PIXELS} px")
            opened.verify()  # the check sums of a PNG, which reading its pixels does not look at
        with warnings.catch_warnings(action="ignore"), Image.open(io.BytesIO(data), formats=_FORMATS) as opened:
            return _values(opened)
    except InputError:
        raise
    except UnidentifiedImageError:
        raise InputError(
            f"{file}: is no picture of the kinds {', '.join(_FORMATS)} (.pgm), nor a map_server .yaml"
        ) from None
    except Exception as error:  # Pillow raises nearly any for a damaged picture
        raise InputError(f"{file}: is no whole picture: {reason(error)}") from None


def _values(picture: Image.Image) -> np.ndarray:
    if picture.mode.startswith("I"):  # 16 bit
        return np.asarray(picture).astype(np.uint16)
    is_grey = picture.mode in ("1", "L") and "transparency" not in picture.info
    return np.asarray(picture.convert("L" if is_grey else "RGBA"))


def _brightness(picture: np.ndarray) -> np.ndarray:
    """Return grey values over white paper, 0 to 255, of what read_picture returns."""
    if picture.dtype == np.uint16:
        return (picture // 257).astype(np.uint8)
    if picture.ndim == 2:
        return picture
    opacity = picture[..., 3].astype(np.float32) / np.float32(255.0)
    grey = picture[..., :3] @ np.array([0.299, 0.587, 0.114], np.float32)
    return (grey * opacity + np.float32(255.0) * (1.0 - opacity)).astype(np.uint8)
