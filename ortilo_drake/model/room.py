"""The surveyed room that both halves know: anchors, landmarks, walls and furniture.

A team would survey this map before flying. The onboard half uses anchors, landmarks and obstacles; in the world, walls
and stands also block rays.
"""

import math
import re
from collections.abc import Mapping
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from ortilo_drake.model.input_files import exists, read_text
from ortilo_drake.model.inputs.problems import SeveralProblems
from ortilo_drake.model.inputs.room_text import ORTILO_ROOM, parse_room
from ortilo_drake.model.lens import BROWN_CONRADY, Coefficients, Distortion, Lens, check_count, make_lens
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.model.typed_yaml import SMALLEST, Frozen, InputError, Positive, validate

Vec2 = tuple[float, float]
Vec3 = tuple[float, float, float]
Size3 = tuple[Positive, Positive, Positive]
Share = Annotated[float, Field(ge=-1.0, le=1.0)]
Outline = Annotated[tuple[tuple[Share, Share, Share], ...], Field(min_length=4, max_length=1000)]

_BOX = np.array(list(product((-1.0, 1.0), repeat=3)))  # outline of a class for which the file has none
# The limits are far above any building's numbers; a flight checks each item at every tick.
MAX_ANCHORS = 1000
MAX_LANDMARKS = 1000
MAX_OBSTACLES = 5000  # each for walls, stands and pieces of furniture
MAX_HEIGHT = 8192  # largest height of a picture [px]
MAX_PIXELS = 2**24  # largest number of pixels of a picture, 64 MiB
Side = Annotated[int, Field(ge=1, le=100_000)]  # width or height of a picture [px]
_NAME, _LONGEST_NAME = r"^\w[\w .+-]*$", 64
Label = Annotated[str, Field(pattern=_NAME, max_length=_LONGEST_NAME)]  # used as a name of meshes, and printed


class Interior(Frozen):
    """The free box between the outer walls, two opposite corners in W [m]."""

    min: Vec3
    max: Vec3


class Landmark(Frozen):
    """A detectable object: COCO label, centre p_WL [m], yaw about W's z [rad], size along its own axes [m].

    Without a size, the landmark has the size of its class.
    """

    label: Label
    position: Vec3
    yaw: float = 0.0
    size: Size3 | None = None


class CameraModel(Frozen):
    """A camera at p_BC, looking along B's x axis: C's z = B's x, C's x = -B's y, C's y = -B's z."""

    width: Side
    """width of the pictures [px]."""
    height: Side
    """height of the pictures [px]."""
    focal_length: Positive
    """focal length along the picture's width [px]."""
    center: Vec2
    """principal point, with (0, 0) at the centre of the first pixel [px]."""
    position: Vec3
    """p_BC [m]."""
    aspect: Positive = 1.0
    """focal length along the picture's height divided by focal length along its width [1]."""
    distortion: Distortion = "none"
    """distortion model of the lens, see model/lens.py."""
    coefficients: Coefficients = ()
    """for brown_conrady k1, k2, p1, p2, or with k3, or with k3, k4, k5, k6; for fisheye k1, k2, k3, k4 [1]."""

    @model_validator(mode="after")
    def _has_a_lens(self) -> "CameraModel":
        self.check_lens()
        return self

    def check_lens(self) -> None:
        """Raise ValueError if the number of coefficients is wrong, or if they fold the picture near its middle."""
        check_count(self.distortion, self.coefficients)
        if not self._lens[1]:
            raise ValueError(f".coefficients: {list(self.coefficients)}: must not fold the picture near its middle")

    def scaled_to(self, width: int) -> "CameraModel":
        """Return the same camera at another resolution; InputError if the picture would have no pixels or too many.

        A pixel's centre has integer coordinates, so the principal point moves by c -> (c + 1/2) s - 1/2.
        """
        s = width / self.width
        height = round(self.height * s)
        if not (1 <= height <= MAX_HEIGHT and width * height <= MAX_PIXELS):
            raise InputError(
                f"width: {width}: pictures of the room's camera, {self.width} x {self.height} px, are then {width} x "
                f"{height} px: must be 1 to {MAX_HEIGHT} px high and have at most {MAX_PIXELS} px"
            )
        center = ((self.center[0] + 0.5) * s - 0.5, (self.center[1] + 0.5) * s - 0.5)
        return self.model_copy(
            update={"width": width, "height": height, "focal_length": self.focal_length * s, "center": center}
        )

    @property
    def constants(self) -> Camera:
        """The camera's constants for compiled functions."""
        image = np.array([self.width, self.height], dtype=float)
        return Camera(np.array(self.position), self.focal_length, np.array(self.center), image, self._lens[0])

    @property
    def _lens(self) -> tuple[Lens, bool]:
        zeros = (0.0,) * (BROWN_CONRADY - len(self.coefficients)) if self.distortion == "brown_conrady" else ()
        image = float(self.width), float(self.height)
        return make_lens((*self.coefficients, *zeros), self.aspect, self.focal_length, self.center, image)


Furniture = tuple[Label, float, float, float, float, float, float]
Wall = Annotated[tuple[float, ...], Field(min_length=3, max_length=6)]  # x, y, yaw, and a size unless it is wall_size


OWN_CAMERA = CameraModel(
    width=1600,
    height=1200,
    focal_length=746.632634717237,
    center=(800.5, 600.5),
    position=(0.049798, -0.001493, 0.0429629),
)


class Room(Frozen):
    """The content of a room file; ortilo_room.yaml explains the fields, the defaults are here.

    A wall may have its own size, as three further numbers: [x, y, yaw, length, thickness, height]. If a scenario has no
    start or goal, the room's is used, x and y [m]. A landmark class of ortilo_room.yaml needs no size. A file may also
    give anchors by name, {0: {x: , y: , z: }}, see inputs/room_text.py.

    A room without a name has the name of its file.
    """

    name: Label = "room"
    interior: Interior
    anchors: Annotated[tuple[Vec3, ...], Field(max_length=MAX_ANCHORS)]
    landmarks: Annotated[tuple[Landmark, ...], Field(max_length=MAX_LANDMARKS)] = ()
    landmark_size: dict[Label, Size3] = Field(default_factory=dict)
    landmark_outline: dict[Label, Outline] = Field(default_factory=dict)
    wall_size: Size3 = (3.0, 1.0, 3.0)
    walls: Annotated[tuple[Wall, ...], Field(max_length=MAX_OBSTACLES)] = ()
    stand_radius: Positive = 0.25
    stand_height: Positive = 0.86
    stands: Annotated[tuple[Vec2, ...], Field(max_length=MAX_OBSTACLES)] = ()
    furniture: Annotated[tuple[Furniture, ...], Field(max_length=MAX_OBSTACLES)] = ()
    furniture_size: dict[Label, Size3] = Field(default_factory=dict)
    camera: CameraModel = OWN_CAMERA
    start: Vec2 | None = None
    goal: Vec2 | None = None

    @model_validator(mode="after")
    def _is_complete(self) -> "Room":
        problems = []
        if len(self.anchors) < 3:
            problems.append(f"anchors: {len(self.anchors)} given, a position needs at least 3")
        for low, high, axis in zip(self.interior.min, self.interior.max, "xyz", strict=True):
            if low >= high:
                problems.append(f"interior: min {axis} = {low} must be below max {axis} = {high}")
        for label in sorted({landmark.label for landmark in self.landmarks} - set(self.landmark_size)):
            problems.append(f"landmark_size: no size for class '{label}'")
        for label in sorted(set(self.landmark_outline) - set(self.landmark_size)):
            problems.append(f"landmark_outline: class '{label}' is none of landmark_size")
        for kind in sorted({item[0] for item in self.furniture} - set(self.furniture_size)):
            problems.append(f"furniture_size: no size for kind '{kind}'")
        for i, wall in enumerate(self.walls):
            if len(wall) not in (3, 6) or min(wall[3:], default=1.0) < SMALLEST:
                problems.append(
                    f"walls.{i}: {list(wall)}: must be x, y, yaw, and maybe a length, thickness and height > 0"
                )
        if problems:
            raise SeveralProblems(problems)
        return self

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Room) and self._text == other._text  # pydantic's own also compares the cached arrays

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> "Room":
        """Return a copy with some fields changed and without the values cached from the old fields."""
        copied = super().model_copy(update=update, deep=deep)
        for computed in copied.__dict__.keys() - type(self).model_fields.keys():
            del copied.__dict__[computed]
        return copied

    def __hash__(self) -> int:
        return hash(self._text)  # the fields for sizes are dicts, which have no hash

    @cached_property
    def _text(self) -> str:
        return self.model_dump_json()

    @cached_property
    def classes(self) -> tuple[str, ...]:
        """The landmark classes in order of first appearance; a detection's label is an index into this tuple."""
        return tuple(dict.fromkeys(landmark.label for landmark in self.landmarks))

    @cached_property
    def anchor_positions(self) -> np.ndarray:
        """Positions of the anchors in W (n, 3) [m]."""
        return np.array(self.anchors)

    @cached_property
    def landmark_positions(self) -> np.ndarray:
        """Positions p_WL of the landmarks in W (n, 3) [m]."""
        return np.array([landmark.position for landmark in self.landmarks]).reshape(-1, 3)

    @cached_property
    def landmark_labels(self) -> np.ndarray:
        """Index of each landmark's class in ``classes`` (n,), float as in a detections message."""
        return np.array([float(self.classes.index(landmark.label)) for landmark in self.landmarks])

    @cached_property
    def landmark_outlines(self) -> np.ndarray:
        """Points that span each landmark's convex hull, from its surveyed centre in the axes of W [m] (n, m, 3).

        The points are the outline of the class (or else the corners of a box), scaled by half the size and turned by
        yaw. The last point of a shorter list is repeated.
        """
        outlines = []
        for landmark in self.landmarks:
            points = np.array(self.landmark_outline.get(landmark.label, _BOX))
            half = 0.5 * np.array(landmark.size or self.landmark_size[landmark.label])
            c, s = math.cos(landmark.yaw), math.sin(landmark.yaw)
            R_WL = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
            outlines.append((points * half) @ R_WL.T)
        m = max((len(points) for points in outlines), default=1)
        padded = [np.pad(points, ((0, m - len(points)), (0, 0)), mode="edge") for points in outlines]
        return np.array(padded).reshape(-1, m, 3)

    @cached_property
    def landmark_sizes(self) -> np.ndarray:
        """Size along W's axes of the smallest box about each landmark's centre that contains its outline (n, 3) [m]."""
        return 2.0 * np.abs(self.landmark_outlines).max(axis=1)

    @cached_property
    def wall_boxes(self) -> np.ndarray:
        """The walls as rows (x, y, z of the centre, yaw, three half sizes) (n, 7) [m, rad]."""
        rows = []
        for x, y, yaw, *size in self.walls:
            half = np.array(size or self.wall_size) / 2
            rows.append([x, y, half[2], yaw, *half])
        return np.array(rows).reshape(-1, 7)

    @cached_property
    def stand_cylinders(self) -> np.ndarray:
        """The stands, on the floor, as rows (x, y, radius, height) (n, 4) [m]."""
        return np.array([[x, y, self.stand_radius, self.stand_height] for x, y in self.stands]).reshape(-1, 4)


def load_room(path: Path = ORTILO_ROOM) -> Room:
    """Return the room of a file; InputError names file, field, value and the allowed values."""
    if not exists(path):
        raise InputError(f"room: {path}: no such room file")
    return _room_of(read_text(path), str(path))


@lru_cache(maxsize=8)
def _room_of(text: str, source: str) -> Room:
    data, stem = parse_room(text, source), Path(source).stem
    if isinstance(data, dict) and re.fullmatch(_NAME, stem) and len(stem) <= _LONGEST_NAME:
        data = {"name": stem} | data
    return validate(Room, data, source)
