"""MAP.yaml: which column or field of which recorded file is what, and what to do with it.

Names of files are relative to the folder that the command is given, so one map serves every motion recorded alike.
"""

from pathlib import Path
from typing import Annotated, Literal, Self

import yaml
from pydantic import Field, model_validator

from ortilo_drake.model.typed_yaml import FileName, Frozen, Positive, load_yaml

Column = Annotated[str, Field(min_length=1, max_length=256)] | Annotated[int, Field(ge=1, le=10_000)]
Three = tuple[Column, Column, Column]
Vector = tuple[float, float, float]
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Axis = Literal["x", "y", "z", "-x", "-y", "-z"]


class Source(Frozen):
    """A file and where in it the stamps are.

    Of a table the columns are named, or counted from 1; of a bag or MCAP file the topic is named, and a column is a
    field of its messages, such as `linear_acceleration.x` or `ranges[2]`.
    """

    file: FileName
    topic: str | None = Field(default=None, description="A bag's or MCAP file's topic; none for a table.")
    time: Column | None = Field(
        default=None,
        description="Column of the stamp; in a bag the header's stamp if there is one, else the time of receipt.",
    )
    unit: Literal["s", "ms", "us", "ns"] = Field(default="s", description="Unit of `time`.")
    delimiter: Literal["auto", "tab", "space"] | Annotated[str, Field(min_length=1, max_length=1)] = "auto"
    header: Literal["auto", "yes", "no"] = Field(default="auto", description="Whether a table's first line has names.")
    zero: Literal["common", "first"] = Field(
        default="common", description="`first`: the clock is not the other files'; its first stamp counts as theirs."
    )
    late: float = Field(default=0.0, ge=-1e6, le=1e6, description="Taken off every stamp [s].")

    @model_validator(mode="after")
    def _table_has_stamps(self) -> Self:
        if self.topic is None and self.time is None:
            raise ValueError("time: a table needs the column of its stamps (a bag needs `topic`)")
        return self


class RangeSource(Source):
    """Ranges to anchors [m]: a column or field for each, or rows of one range that name the anchor."""

    values: tuple[Column, ...] = Field(
        min_length=1, max_length=256, description="A column for each anchor; or one field that is a list."
    )
    anchor: Column | None = Field(default=None, description="Rows of one range: the column that names the anchor.")
    names: tuple[int, ...] = Field(default=(), description="What `anchor` calls the anchors, in their order.")
    topics: tuple[str, ...] = Field(default=(), description="A topic for each anchor, in place of `topic`.")
    scale: Positive = Field(default=1.0, description="Metres in one of the file's units.")

    @model_validator(mode="after")
    def _rows_name_their_anchor(self) -> Self:
        if (self.anchor is None) != (not self.names):
            raise ValueError("names: belong to `anchor`, which names the anchor of each row; give both or neither")
        if (self.anchor is not None or self.topics) and len(self.values) != 1:
            raise ValueError(f"values: {len(self.values)} columns, where every row has one range")
        if self.topics and (self.anchor is not None or self.topic is not None):
            raise ValueError("topics: stand in place of `topic` and `anchor`; leave those out")
        return self

    @model_validator(mode="after")
    def _table_has_stamps(self) -> Self:
        if self.topic is None and not self.topics and self.time is None:
            raise ValueError("time: a table needs the column of its stamps (a bag needs `topic`)")
        return self


class Quaternion(Frozen):
    """A quaternion of the body's attitude in the world, in the order in which the file has it."""

    columns: tuple[Column, Column, Column, Column] = (
        "orientation.x",
        "orientation.y",
        "orientation.z",
        "orientation.w",
    )
    order: Literal["xyzw", "wxyz"] = "xyzw"
    of: Literal["body", "world"] = Field(default="body", description="`world`: turns world's vectors into the body's.")


class Matrix(Frozen):
    """A rotation matrix, nine columns row by row: the body's attitude in the world, or with `of: world` its inverse."""

    columns: tuple[Column, Column, Column, Column, Column, Column, Column, Column, Column]
    of: Literal["body", "world"] = "body"


class ImuSource(Source):
    """Body rates [rad/s] and specific force [m/s²], and the attitude if the unit computes one."""

    rates: Three = ("angular_velocity.x", "angular_velocity.y", "angular_velocity.z")
    force: Three = ("linear_acceleration.x", "linear_acceleration.y", "linear_acceleration.z")
    orientation: Quaternion | None = None
    axes: Literal["flu", "frd"] | tuple[Axis, Axis, Axis] = Field(
        default="flu",
        description="The unit's axes: forward left up, forward right down, or which of them ours (x forward, y left, "
        "z up) are, as [y, -x, z].",
    )
    rate_unit: Literal["rad/s", "deg/s"] = "rad/s"
    force_unit: Literal["m/s2", "g"] = "m/s2"

    @model_validator(mode="after")
    def _axes_turn(self) -> Self:
        if not isinstance(self.axes, str) and sorted(axis[-1] for axis in self.axes) != ["x", "y", "z"]:
            raise ValueError(f"axes: {list(self.axes)}: must name x, y and z once each")
        return self


class CommandSource(Source):
    """The flown command: thrust over mass [m/s²] along the body's z, in the place of the accelerometer's reading."""

    thrust: Column
    scale: Positive = Field(default=1.0, description="m/s² in one of the file's units.")


class TruthSource(Source):
    """The true position [m] and, where it was recorded, attitude, in a frame and by a clock of their own."""

    position: Three
    rotation: Matrix | Quaternion | None = None
    drop_zero_rows: bool = Field(default=True, description="Drop rows whose position is exactly 0, 0, 0: none was had.")


class Find(Frozen):
    """Anchors that nobody surveyed: found from the truth of the calibration part."""

    find: int = Field(ge=3, le=256, description="How many.")


class Estimated(Frozen):
    """What is calibrated on the first part, by the truth."""

    share: Share = Field(default=0.3, description="Share of the truth's time that calibrates; the rest judges.")
    clock: Literal["estimate"] | float = Field(
        default="estimate", description="Truth's clock less the sensors' [s], counted as the files have it."
    )
    search: float = Field(default=5.0, gt=0.0, le=3600.0, description="Clock offsets tried, at most [s].")
    frame: Literal["yaw", "se3", "same"] = Field(
        default="yaw",
        description="Between the truth's frame and the anchors': shift and heading, shift and turn, none.",
    )
    biases: Literal["calibrated", "online", "none"] = Field(
        default="calibrated", description="Of each anchor's ranges: from the truth, as states of the filter, or none."
    )
    lever: Literal["estimate"] | Vector = Field(
        default="estimate", description="From the truth's point to the antenna, body axes (forward left up) [m]."
    )


class FilterSettings(Frozen):
    """The noise that the filter counts on; one set for every motion, see `ortilo replay --fit`."""

    acceleration: Positive = Field(default=0.1, description="White noise of the specific force [m/s²/√Hz].")
    rotation: Positive = Field(default=0.001, description="White noise of the body rates [rad/s/√Hz].")
    acceleration_bias: Positive = Field(default=0.02, description="Random walk [m/s²/√s].")
    rotation_bias: Positive = Field(default=0.0005, description="Random walk [rad/s/√s].")
    range_white: Positive = Field(default=0.03, description="Standard deviation of a range's white error [m].")
    range_correlated: Positive = Field(
        default=0.05, description="Of the error that lasts, first-order Gauss-Markov [m]."
    )
    correlation_time: Positive = Field(default=0.7, description="How long it lasts [s].")
    bias_walk: Positive = Field(default=0.001, description="Random walk of an anchor's bias [m/√s].")
    bias_start: Positive = Field(default=0.2, description="Standard deviation of a bias that was not calibrated [m].")
    gate: Positive = Field(
        default=4.0, description="Ranges farther from the prediction, in standard deviations, are out."
    )
    baseline_acceleration: Positive = Field(
        default=1.0, description="White acceleration of the constant-velocity filter, which has no IMU [m/s²/√Hz]."
    )
    baseline_range: Positive = Field(default=0.06, description="Its ranges' standard deviation [m].")
    baseline_gate: Positive = Field(default=4.0, description="Its gate, in standard deviations.")


class Gaps(Frozen):
    """Blackouts of all ranges, evenly repeated."""

    last: Positive = Field(default=2.0, description="[s].")
    every: Positive = Field(default=6.0, description="From one's start to the next's [s].")

    @model_validator(mode="after")
    def _there_are_ranges_between(self) -> Self:
        if self.last >= self.every:
            raise ValueError(f"last: {self.last}: must be shorter than `every`, {self.every}")
        return self


class Imposed(Frozen):
    """Losses imposed on the recorded ranges in rows of their own."""

    lost: Share = Field(default=0.5, description="Share of single ranges lost, at random.")
    seed: int = Field(default=0, ge=0, le=2**63 - 1)
    gaps: Gaps | None = Gaps()


class Map(Frozen):
    """What a folder of recorded files holds; see docs/how_to/recorded.md."""

    ranges: RangeSource
    anchors: Annotated[tuple[Vector, ...], Field(min_length=3, max_length=256)] | Find
    imu: ImuSource | None = None
    command: CommandSource | None = None
    truth: TruthSource | None = None
    calibration: Estimated = Estimated()
    filter: FilterSettings = FilterSettings()
    imposed: Imposed = Imposed()
    available: Positive = Field(default=0.3, description="An estimate counts as available below this deviation [m].")

    @model_validator(mode="after")
    def _anchors_are_those_of_the_ranges(self) -> Self:
        anchors = self.anchors.find if isinstance(self.anchors, Find) else len(self.anchors)
        r = self.ranges
        heard = len(r.names) or len(r.topics) or len(r.values)
        is_list = r.topic is not None and len(r.values) == 1 and not r.names  # counted when it is read
        if heard != anchors and not is_list:
            raise ValueError(f"anchors: {anchors} of them, but the ranges are to {heard}")
        if isinstance(self.anchors, Find) and self.truth is None:
            raise ValueError("anchors: find: needs `truth`; without it `ortilo room survey` finds anchors")
        if self.command is not None and self.imu is None:
            raise ValueError("command: needs `imu`, whose body rates turn it")
        return self


def load_map(path: Path) -> Map:
    """Read MAP.yaml; InputError if anything is wrong."""
    return load_yaml(Map, path)


def map_text(map_: Map) -> str:
    """Return a map as YAML, without what is as by default."""
    return yaml.safe_dump(map_.model_dump(mode="json", exclude_defaults=True), sort_keys=False, allow_unicode=True)
