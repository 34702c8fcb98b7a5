"""The sources of MAP.yaml: the file or topic of each stream, and the meaning of its columns or fields."""

from typing import Annotated, Any, Literal, Self

from pydantic import AfterValidator, BeforeValidator, Field, field_validator, model_validator

from ortilo_drake.model.typed_yaml import FileName, Frozen, Positive

Column = Annotated[str, Field(min_length=1, max_length=256)] | Annotated[int, Field(ge=1, le=10_000)]
Three = tuple[Column, Column, Column]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]
MOST = 256  # most anchors, and most files of one stream
IMUS: dict[str, dict[str, Any]] = {"euroc": {"time": 1, "unit": "ns", "rates": (2, 3, 4), "force": (5, 6, 7)}}
TRUTHS: dict[str, dict[str, Any]] = {
    "tum": {"time": 1, "position": (2, 3, 4), "rotation": {"columns": (5, 6, 7, 8)}},
    "euroc": {
        "time": 1,
        "unit": "ns",
        "position": (2, 3, 4),
        "rotation": {"columns": (5, 6, 7, 8), "order": "wxyz"},
    },
}


def _not_zero(value: float) -> float:
    if value == 0.0:
        raise ValueError("0: a unit must not be 0")
    return value


Unit = Annotated[float, Field(ge=-1e6, le=1e6), AfterValidator(_not_zero)]


def _word(value: Any) -> Any:
    """Return 'yes' or 'no' for a boolean, because YAML reads these words as booleans."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    return {"true": "yes", "false": "no"}.get(value, value) if isinstance(value, str) else value


def _text(value: Any) -> Any:
    """Return a whole number as text. Names in MAP.yaml stay as they are written, see load_map."""
    return str(value) if isinstance(value, int) and not isinstance(value, bool) else value


Name = Annotated[str, BeforeValidator(_text), Field(min_length=1, max_length=256)]


class OfOne(Frozen):
    """A file with the ranges to one anchor or of one tag, whose rows need not name the anchor or tag."""

    file: FileName
    anchor: Name | None = None
    tag: Name | None = None

    @model_validator(mode="after")
    def _says_of_what(self) -> Self:
        if self.anchor is None and self.tag is None:
            raise ValueError(f"file: {self.file}: of which `anchor`, or which `tag`?")
        return self


def _named_once(axes: str | tuple[Axis, Axis, Axis] | None) -> str | tuple[Axis, Axis, Axis] | None:
    """Refuse axes that do not name x, y and z once each."""
    if isinstance(axes, tuple) and sorted(axis[-1] for axis in axes) != ["x", "y", "z"]:
        raise ValueError(f"{list(axes)}: must name x, y and z once each")
    return axes


def _as_tuples(value: Any) -> Any:
    """Return a value with tuples for all lists: strict validation accepts only tuples."""
    if isinstance(value, dict):
        return {key: _as_tuples(part) for key, part in value.items()}
    return tuple(_as_tuples(part) for part in value) if isinstance(value, list) else value


def _laid_out(values: Any, layouts: dict[str, dict[str, Any]]) -> Any:
    """Return a source's entries together with those of its `layout`; an entry that is given takes precedence."""
    layout = values.get("layout") if isinstance(values, dict) else None
    known = layouts.get(layout, {}) if isinstance(layout, str) else {}
    return {**known, **_as_tuples(values)} if isinstance(values, dict) else values


class Source(Frozen):
    """A file and the place of its stamps.

    In a table, columns are given by name or by number from 1. In a bag or MCAP file the topic is given, and a column is
    a field of its messages, such as `linear_acceleration.x` or `ranges[2]`.
    """

    file: FileName | Annotated[tuple[FileName | OfOne, ...], Field(min_length=1, max_length=MOST)] = Field(
        description="A file, a pattern such as `imu_*.csv`, or a list: several are merged by their stamps. "
        "Of ranges, tables of one range a row that do not name the anchor are one for each anchor, in order; "
        "`{file: a.csv, anchor: 0E15}` says of which, `{file: a.csv, tag: left}` which tag heard it."
    )
    topic: str | None = Field(default=None, description="A bag's or MCAP file's topic; none for a table.")
    time: Column | tuple[Column, Column] | None = Field(
        default=None,
        description="Column of the stamp, or two, of seconds and nanoseconds; in a bag the header's stamp if there is"
        " one, else the time of receipt.",
    )
    unit: Literal["s", "ms", "us", "ns"] | Positive = Field(
        default="s", description="Unit of `time`, or seconds in one of the file's: 0.999 of a clock that is fast."
    )
    delimiter: Literal["auto", "tab", "space"] | Annotated[str, Field(min_length=1, max_length=1)] = "auto"
    header: Annotated[Literal["auto", "yes", "no"], BeforeValidator(_word)] = Field(
        default="auto", description="Whether a table's first line has names; a `#` or `%` before them is taken off."
    )
    zero: Literal["common", "first"] = Field(
        default="common", description="`first`: the clock is not the other files'; its first stamp counts as theirs."
    )
    late: float = Field(default=0.0, ge=-1e6, le=1e6, description="Taken off every stamp [s].")

    @property
    def anchors_of_files(self) -> tuple[str, ...]:
        """The anchors of the files, in order, as far as the map names them."""
        return tuple(one.anchor for one in self._of_one if one.anchor is not None)

    @property
    def tags_of_files(self) -> tuple[str, ...]:
        """The tags of the files, in order, as far as the map names them."""
        return tuple(one.tag for one in self._of_one if one.tag is not None)

    @property
    def _of_one(self) -> tuple[OfOne, ...]:
        return () if isinstance(self.file, str) else tuple(file for file in self.file if isinstance(file, OfOne))

    @model_validator(mode="after")
    def _table_has_stamps(self) -> Self:
        if self._of_one:
            raise ValueError("file: its files are of no anchor and no tag; only those of `ranges` are")
        if self.topic is None and self.time is None:
            raise ValueError("time: a table needs the column of its stamps (a bag needs `topic`)")
        return self


class Quaternion(Frozen):
    """A quaternion of the body's attitude in the world, with its columns in the order of the file."""

    columns: tuple[Column, Column, Column, Column] = (
        "orientation.x",
        "orientation.y",
        "orientation.z",
        "orientation.w",
    )
    order: Literal["xyzw", "wxyz"] = "xyzw"
    of: Literal["body", "world"] = Field(default="body", description="`world`: turns world's vectors into the body's.")


class Matrix(Frozen):
    """A rotation matrix, row by row in nine columns: the body's attitude in the world; its inverse for `of: world`."""

    columns: tuple[Column, Column, Column, Column, Column, Column, Column, Column, Column]
    of: Literal["body", "world"] = "body"


class ImuSource(Source):
    """Body rates [rad/s], specific force [m/s²], and the attitude if the unit computes one."""

    layout: Literal["euroc"] | None = Field(default=None, description="EuRoC's table: ns, rates, force.")
    rates: Three = ("angular_velocity.x", "angular_velocity.y", "angular_velocity.z")
    force: Three = ("linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z")
    orientation: Quaternion | None = None
    axes: Literal["flu", "frd"] | tuple[Axis, Axis, Axis] = Field(
        default="flu",
        description="The unit's axes: forward left up, forward right down, or which of them ours (x forward, y left, "
        "z up) are, as [y, -x, z].",
    )
    rate_axes: tuple[Axis, Axis, Axis] | None = Field(
        default=None, description="Those of the body rates alone, if they differ: [x, y, -z] turns one sign."
    )
    force_axes: tuple[Axis, Axis, Axis] | None = Field(default=None, description="Those of the force alone.")
    rate_unit: Literal["rad/s", "deg/s", "mrad/s", "mdeg/s"] | Unit = Field(
        default="rad/s", description="Or rad/s in one of the file's units; a negative one turns the signs."
    )
    force_unit: Literal["m/s2", "g", "mg", "ft/s2"] | Unit = Field(
        default="m/s2", description="Or m/s² in one of the file's units; -1 where gravity itself is reported."
    )
    standstill: float = Field(
        default=0.0,
        ge=0.0,
        le=3600.0,
        description="The body stands still for the first so many seconds, at least 2, by which gyro and accelerometer "
        "are known [s].",
    )

    _axes_are_all = field_validator("axes", "rate_axes", "force_axes")(_named_once)

    @field_validator("standstill")
    @classmethod
    def _long_enough(cls, value: float) -> float:
        if 0.0 < value < 2.0:
            raise ValueError(f"{value:g}: must be 0 or at least 2")
        return value

    @model_validator(mode="before")
    @classmethod
    def _has_a_layout(cls, values: Any) -> Any:
        return _laid_out(values, IMUS)


class AccelerometerSource(Source):
    """Specific force [m/s²] in a separate stream that replaces the imu's; axes and unit are given in `imu`."""

    force: Three


class FinderSource(Source):
    """A range finder that looks down, along -z of the body; distances [m]."""

    distance: Column
    scale: Positive = Field(default=1.0, description="Metres in one of the file's units.")
    at: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="From the estimated point to the finder, body axes [m]."
    )
    sd: Positive = Field(default=0.05, description="Standard deviation [m].")


class FlowSource(Source):
    """Optical flow of the floor in counts of the Crazyflie's sensor; see onboard/estimator/tight/floor_rows.py."""

    pixels: tuple[Column, Column]
    per_rad: Positive = Field(default=4.4, description="Pixels in an interval for one rad/s.")
    per_rad_sd: float = Field(default=0.1, ge=0.0, le=1.0, description="Standard deviation of that, as a share.")
    sd: Positive = Field(default=2.0, description="Standard deviation [px].")


class BoxSource(Source):
    """A detector's boxes of a room's landmarks [px], one in each row; rows with the same stamp belong to one picture.

    The centre of a pixel has integer coordinates, (0, 0) for the first. The room and the anchors have one frame.
    """

    label: Column = Field(description="The column that names the class of each box, as the room does.")
    box: tuple[Column, Column, Column, Column] = Field(description="u_min, v_min, u_max, v_max [px].")
    room: FileName = Field(description="The room file with the landmarks, beside the map or among the files.")
    camera: FileName | None = Field(
        default=None, description="A calibration file of Kalibr, ROS or OpenCV in the place of the room's camera."
    )
    at: tuple[float, float, float] | None = Field(
        default=None, description="From the estimated point to the camera, body axes [m]; the room's if not given."
    )
    sd: Positive = Field(default=1.0, description="Standard deviation of a small box's centre [px].")
    growth: float = Field(default=0.02, ge=0.0, le=1.0, description="Share of its size by which it grows, over sd.")


class CommandSource(Source):
    """The flown command, thrust over mass along the body's z [m/s²], which replaces the accelerometer's samples."""

    thrust: Column
    scale: Positive = Field(default=1.0, description="m/s² in one of the file's units.")


class TruthSource(Source):
    """The true position [m] and, if recorded, the true attitude, in their own frame and by their own clock."""

    layout: Literal["tum", "euroc"] | None = Field(
        default=None, description="TUM's table: s, position, quaternion xyzw; EuRoC's: ns, position, wxyz, and more."
    )
    position: Three
    rotation: Matrix | Quaternion | None = None
    scale: Positive = Field(default=1.0, description="Metres in one of the file's units.")
    axes: tuple[Axis, Axis, Axis] = Field(
        default=("x", "y", "z"),
        description="Which of the file's axes are ours (z up): [x, -z, y] where its y is up, [x, -y, -z] where z is "
        "down.",
    )
    drop_zero_rows: bool = Field(default=True, description="Drop rows whose position is exactly 0, 0, 0: no fix.")
    drop_frozen: Positive | None = Field(
        default=None, description="Drop rows that repeat a position for longer than this: the body was lost [s]."
    )

    _axes_are_all = field_validator("axes")(_named_once)

    @model_validator(mode="before")
    @classmethod
    def _has_a_layout(cls, values: Any) -> Any:
        return _laid_out(values, TRUTHS)
