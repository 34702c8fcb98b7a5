"""Floor plans: pictures of dark walls on light paper, and occupancy grids as ROS's map_server keeps them.

A grid is a picture and a .yaml beside it (wiki.ros.org/map_server): `resolution` metres a pixel, `origin` of the lower
left pixel in the map's frame, and p, how surely a pixel of value v is occupied: (255 - v) / 255, v / 255 where `negate`
is set, v / 100 in mode `raw`. It is a wall where p > occupied_thresh, and free where p < free_thresh.
"""

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError
from pydantic import ConfigDict, Field

from ortilo_drake.model.input_files import exists, read_bytes, reason
from ortilo_drake.model.room import MAX_PIXELS
from ortilo_drake.model.typed_yaml import FileName, Frozen, InputError, Positive, load_yaml

_FORMATS = ("PNG", "PPM", "BMP", "JPEG", "TIFF")  # .pgm is of Pillow's PPM
Threshold = Annotated[float, Field(ge=0.0, le=1.0)]


class FloorPlan(NamedTuple):
    """What walls are traced over, row by row from the top.

    Attributes:
        wall: whether a pixel is one (h, w).
        free: whether a pixel is known to be none (h, w); of a picture whatever is no wall.
        scale: pixels a metre.
        corner: x, y of the lower left corner in the plan's frame [m] (2).
        what: what makes a pixel a wall.
        scaled_by: what the scale comes from.
    """

    wall: np.ndarray
    free: np.ndarray
    scale: float
    corner: np.ndarray
    what: str
    scaled_by: str


class GridFile(Frozen):
    """The .yaml of an occupancy grid; what else stands in it is not read."""

    model_config = ConfigDict(extra="ignore")

    image: FileName
    resolution: Positive
    origin: tuple[float, float, float] | tuple[float, float] = (0.0, 0.0, 0.0)
    negate: Literal[0, 1, False, True] = 0
    occupied_thresh: Threshold = 0.65
    free_thresh: Threshold = 0.196
    mode: Literal["trinary", "scale", "raw"] = "trinary"


def read_plan(file: Path, scale: float | None, dark: int) -> FloorPlan:
    """Return the floor plan in a picture, or in the .yaml of an occupancy grid.

    Args:
        file: PNG, PGM, BMP, JPEG or TIFF; or a .yaml.
        scale: pixels a metre; None for a grid, which has a resolution.
        dark: brightness below which a pixel of a picture is a wall.

    Raises:
        InputError: if it cannot be read, is too large, or its scale is given twice or not at all.
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
    """Return the values of a picture's pixels (h, w) or (h, w, c); InputError if it is none or too large."""
    data = read_bytes(file)
    try:
        Image.MAX_IMAGE_PIXELS = None  # the limit here is told in our own words
        with Image.open(file, formats=_FORMATS) as opened:
            width, height = opened.size
    except UnidentifiedImageError:
        raise InputError(
            f"{file}: is no picture of the kinds {', '.join(_FORMATS)} (.pgm), nor a map_server .yaml"
        ) from None
    except (OSError, ValueError, SyntaxError) as error:
        raise InputError(f"{file}: is no whole picture: {reason(error)}") from None
    if width * height > MAX_PIXELS:
        raise InputError(f"{file}: {width} x {height} px: must have at most {MAX_PIXELS} px")
    try:
        found = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        found = None
    if found is None:
        raise InputError(f"{file}: is no whole picture")
    return np.asarray(found)


def _brightness(picture: np.ndarray) -> np.ndarray:
    """Return grey values over white paper, 0 to 255, of a grey or coloured picture, with or without an opacity."""
    values = picture.astype(np.float32) / (65535.0 if picture.dtype == np.uint16 else 255.0)
    if values.ndim == 2:
        return (255.0 * values).astype(np.uint8)
    opacity = values[..., 3:4] if values.shape[2] == 4 else 1.0
    over_white = values[..., :3] * opacity + (1.0 - opacity)
    return (255.0 * over_white @ np.array([0.114, 0.587, 0.299], np.float32)).astype(np.uint8)
