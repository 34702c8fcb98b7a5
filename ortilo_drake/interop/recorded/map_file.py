"""MAP.yaml: the meaning of each column or field of recorded files, and the settings of their filter.

File names are relative to the folder given to the command, so one map serves every motion recorded in the same way.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator

from ortilo_drake.interop.recorded.anchors import Vector, as_anchors, names_in_map, read_anchors
from ortilo_drake.interop.recorded.columns import UNITS
from ortilo_drake.interop.recorded.range_sources import DifferenceSource, RangeSource
from ortilo_drake.interop.recorded.sources import (
    MOST,
    AccelerometerSource,
    BoxSource,
    CommandSource,
    FinderSource,
    FlowSource,
    ImuSource,
    TruthSource,
)
from ortilo_drake.interop.recorded.units import size_of
from ortilo_drake.model.input_files import exists, read_text
from ortilo_drake.model.inputs.numbers import not_radians
from ortilo_drake.model.typed_yaml import FileName, Frozen, Positive, parse_yaml, validate

Share = Annotated[float, Field(ge=0.0, le=1.0)]


class Find(Frozen):
    """Anchors that nobody surveyed: they are found from the truth of the calibration part."""

    find: int = Field(ge=3, le=256, description="How many.")


class Estimated(Frozen):
    """The quantities that are calibrated with the truth on the first part of the recording."""

    share: Share = Field(
        default=0.3,
        description="Share of the truth's time that calibrates; the rest judges. 0: nothing is calibrated.",
    )
    clock: Literal["estimate"] | float = Field(
        default="estimate", description="Truth's clock minus the sensors' clock [s], by the files' stamps."
    )
    search: float = Field(default=5.0, gt=0.0, le=3600.0, description="Clock offsets tried, at most [s].")
    frame: Literal["yaw", "se3", "same"] = Field(
        default="yaw",
        description="Frame of the truth in the anchors': yaw: shift, heading; se3: shift, rotation; same: equal.",
    )
    biases: Literal["calibrated", "online", "none"] = Field(
        default="calibrated",
        description="Bias of each anchor's ranges: from the truth, a state of the filter, or none.",
    )
    lever: Literal["estimate"] | Vector = Field(
        default="estimate",
        description="From the truth's point to the antenna, or to the point that `tags` count from, body axes (forward "
        "left up) [m]. Estimated by the truth; in the row without it by the ranges' innovations, as from the imu.",
    )

    @field_validator("clock", mode="before")
    @classmethod
    def _is_estimated_or_given(cls, value: Any) -> Any:
        if isinstance(value, str) and value != "estimate":
            raise ValueError(f"{value}: must be 'estimate' or a number [s]")
        return value


class FilterSettings(Frozen):
    """The noise that the filter assumes, the same for every motion; see `ortilo tune FOLDERS --map MAP.yaml`."""

    acceleration: Positive = Field(default=0.1, description="White noise of the specific force [m/s²/√Hz].")
    rotation: Positive = Field(default=0.001, description="White noise of the body rates [rad/s/√Hz].")
    acceleration_bias: Positive = Field(default=0.02, description="Random walk [m/s²/√s].")
    rotation_bias: Positive = Field(default=0.0005, description="Random walk [rad/s/√s].")
    range_white: Positive = Field(default=0.03, description="Standard deviation of a range's white error [m].")
    range_correlated: Positive = Field(
        default=0.05, description="Of the error that lasts, first-order Gauss-Markov [m]."
    )
    range_tail: Annotated[float, Field(ge=0.0, le=1.0)] = Field(
        default=0.3,
        description="Share of its estimate that a lasting error is expected to have: above 0 an anchor may err by far.",
    )
    reflected: Annotated[float, Field(ge=0.0, le=0.5)] = Field(
        default=0.0, description="Share of ranges that are too long because of a reflection; replaces their `huber`."
    )
    correlation_time: Positive = Field(default=0.7, description="How long it lasts [s].")
    bias_walk: Positive = Field(default=0.001, description="Random walk of an anchor's bias [m/√s].")
    bias_start: Positive = Field(default=0.2, description="Standard deviation of a bias that was not calibrated [m].")
    gate: Positive = Field(
        default=4.0, description="Ranges farther from the prediction, in standard deviations, are out."
    )
    huber: Positive | None = Field(
        default=None, description="Innovations beyond so many standard deviations count less (Huber)."
    )
    near_floor: Annotated[float, Field(ge=0.0, le=10.0)] = Field(
        default=0.0,
        description="Height [m] at which the floor doubles the errors of ranges: they grow by (this / height)^4.",
    )
    baseline_acceleration: Positive = Field(
        default=1.0, description="White acceleration of the constant-velocity filter, which has no IMU [m/s²/√Hz]."
    )
    baseline_range: Positive = Field(default=0.06, description="Its ranges' standard deviation [m].")
    baseline_gate: Positive = Field(default=4.0, description="Its gate, in standard deviations.")


class Start(Frozen):
    """The vehicle's start, in the anchors' frame."""

    position: Vector = Field(description="Of the estimated point [m].")
    position_sd: Positive = Field(default=0.03, description="[m].")
    heading: float | None = Field(
        default=None,
        description="From the anchors' x axis towards y, within -2 pi and 2 pi; needed with an `imu` [rad].",
    )
    heading_sd: Positive = Field(default=0.1, description="[rad].")
    rests: bool = Field(default=False, description="Whether it stands level on the floor until it takes off.")
    tilted: bool = Field(default=False, description="Whether its imu may begin tilted by more than 30 degrees.")
    lands: bool = Field(default=False, description="Whether it lands at the height of the start: noticed by its imu.")

    @field_validator("heading")
    @classmethod
    def _is_in_radians(cls, value: float | None) -> float | None:
        if value is not None and (wrong := not_radians(value)):
            raise ValueError(wrong)
        return value

    @model_validator(mode="after")
    def _lands_from_rest(self) -> Self:
        if self.lands and not self.rests:
            raise ValueError("lands: needs `rests: true`: the floor that it starts from is where it lands")
        return self


class Drag(Frozen):
    """Rotor drag -k v along x and y of the body; with it the filter detects and replaces a failing accelerometer."""

    k: float = Field(default=0.38, ge=0.0, le=10.0, description="[1/s].")
    k_sd: float = Field(
        default=0.0, ge=0.0, le=10.0, description="Standard deviation of k, a state then; 0: it is as given [1/s]."
    )
    noise: Positive = Field(default=0.5, description="White noise of the force so found [m/s²/√Hz].")
    doubted: Positive = Field(
        default=3.0,
        description="A sample farther from it is not used [m/s²]; a tenth of all in a second: the axis fails.",
    )


class Gaps(Frozen):
    """Blackouts of all ranges, repeated at equal intervals."""

    last: Positive = Field(default=2.0, description="[s].")
    every: Positive = Field(default=6.0, description="From one's start to the next's [s].")

    @model_validator(mode="after")
    def _there_are_ranges_between(self) -> Self:
        if self.last >= self.every:
            raise ValueError(f"last: {self.last}: must be shorter than `every`, {self.every}")
        return self


class Imposed(Frozen):
    """Losses imposed on the recorded ranges; the results have rows of their own in the report."""

    lost: Share = Field(default=0.5, description="Share of single ranges lost, at random.")
    seed: int = Field(default=0, ge=0, le=2**63 - 1)
    gaps: Gaps | None = Gaps()


class Map(Frozen):
    """The map of a folder of recorded files: the meaning of each column; see docs/how_to/recorded.md."""

    ranges: RangeSource | None = None
    differences: DifferenceSource | None = None
    anchors: Annotated[
        Annotated[tuple[Vector, ...], Field(min_length=3, max_length=256)]
        | Find
        | Annotated[dict[str, Vector], Field(min_length=3, max_length=256)]
        | FileName,
        BeforeValidator(as_anchors),
    ] = Field(
        description="[m]: in the order of the ranges, by name, `{find: n}`, or a file with them: cfclient's YAML, a "
        "table `id, x, y, z`, a DWM1001's console."
    )
    tags: Annotated[dict[str, Vector], Field(min_length=1, max_length=MOST)] | None = Field(
        default=None,
        description="Several tags on one body: by name, where each is, from the point that `calibration.lever` leads "
        "to, body axes (forward left up) [m].",
    )
    imu: ImuSource | None = None
    accelerometer: AccelerometerSource | None = None
    command: CommandSource | None = None
    range_finder: FinderSource | None = None
    flow: FlowSource | None = None
    boxes: BoxSource | None = None
    drag: Drag | None = None
    start: Start | None = None
    floor: float = Field(default=0.0, ge=-1e4, le=1e4, description="Its z in the anchors' frame [m].")
    truth: TruthSource | None = None
    planar: bool = Field(default=False, description="Whether the antenna keeps one height, as on a ground robot.")
    height: float | None = Field(
        default=None, ge=-1e4, le=1e4, description="The antenna's height, z in the anchors' frame, if it is known [m]."
    )
    height_sd: Positive | None = Field(
        default=None, description="By how much it differs from that, standard deviation (0.05) [m]."
    )
    calibration: Estimated = Estimated()
    filter: FilterSettings = FilterSettings()
    imposed: Imposed = Imposed()
    airborne: Positive | None = Field(
        default=None,
        description="Judged is the time from the first to the last stamp so far above the truth's first height [m].",
    )
    available: Positive = Field(default=0.3, description="An estimate counts as available below this deviation [m].")

    @property
    def names(self) -> tuple[str, ...]:
        """The anchors' names in the rows, in the order of `anchors`; empty if the map gives none."""
        of_ranges = () if self.ranges is None else self.ranges.names
        return of_ranges or (() if self.differences is None else self.differences.names)

    def in_the_air(self) -> "Map":
        """Return the map for a vehicle that has left its start: without `start` and standstill."""
        return self.without_standstill().model_copy(update={"start": None})

    def without_standstill(self) -> "Map":
        """Return the map for a flight without a known standstill; a map without an imu is returned unchanged."""
        if self.imu is None:
            return self
        return self.model_copy(update={"imu": self.imu.model_copy(update={"standstill": 0.0})})

    @model_validator(mode="after")
    def _anchors_are_those_of_the_ranges(self) -> Self:
        by_name = isinstance(self.anchors, dict | str)  # counted or chosen by name only when the files are read
        if self.ranges is None and self.differences is None:
            raise ValueError("ranges: are missing, and `differences`, too; give one or both")
        heard = None if self.ranges is None else self.ranges.anchor_count
        names = self.names
        anchors = self.anchors.find if isinstance(self.anchors, Find) else len(self.anchors)
        if heard is not None and heard != anchors and not (by_name and names) and not isinstance(self.anchors, str):
            raise ValueError(f"anchors: {anchors} of them, but the ranges are to {heard}")
        named = self.differences is not None or (self.ranges is not None and self.ranges.rows_name_anchors)
        if named and not names and not by_name:
            raise ValueError("ranges.names: are missing: what the rows call the anchors; or give `anchors` by name")
        if isinstance(self.anchors, Find) and self.truth is None:
            raise ValueError("anchors: find: needs `truth`; without it `ortilo room survey` finds anchors")
        if self.height_sd is not None and self.height is None:
            raise ValueError("height_sd: belongs to `height`, which is not given")
        if self.differences is not None and isinstance(self.anchors, Find):
            raise ValueError("anchors: find: from single ranges only; differences need surveyed anchors")
        if self.differences is not None and self.filter.reflected > 0.0:
            raise ValueError("filter.reflected: is of single ranges only; leave it out with differences")
        for key in ("ranges", "differences"):
            source = getattr(self, key)
            says = source is not None and bool(source.tag is not None or source.tags_of_files)
            if source is not None and says != (self.tags is not None):
                raise ValueError(
                    f"{key}: name tags, but `tags`, where they are, is missing"
                    if says
                    else f"tags: are given, but {key} name none: give {key}.tag, or the tag of each file"
                )
        for key in ("accelerometer", "range_finder", "flow", "boxes", "drag"):
            if getattr(self, key) is not None and self.imu is None:
                raise ValueError(f"{key}: needs `imu`")
        now = self.calibration
        free = now.clock == "estimate" or now.lever == "estimate" or now.biases == "calibrated" or now.frame != "same"
        if now.share == 0.0 and free:
            raise ValueError(
                "calibration.share: 0 calibrates nothing: give clock and lever, frame: same, and biases: online or none"
            )
        if self.start is not None and self.start.heading is None and self.imu is not None:
            raise ValueError(
                "start.heading: is missing: where the nose points, in radians from the anchors' x axis towards y (90 "
                "degrees are 1.571); where it is known roughly, give heading_sd, too; else leave `start` out"
            )
        if self.command is not None and self.imu is None:
            raise ValueError("command: needs `imu`, whose body rates turn it")
        return self


def load_map(path: Path) -> Map:
    """Read MAP.yaml and the file of anchors beside it, and find room and camera there; InputError if one is wrong."""
    map_ = validate(Map, parse_yaml(read_text(path), str(path), names_in_map), str(path))
    if map_.boxes is not None:
        files = {key: path.parent / name for key in ("room", "camera") if (name := getattr(map_.boxes, key))}
        beside = {key: str(file.resolve()) for key, file in files.items() if exists(file)}
        map_ = map_.model_copy(update={"boxes": map_.boxes.model_copy(update=beside)})
    if isinstance(map_.anchors, str) and exists(path.parent / map_.anchors):
        return map_.model_copy(update={"anchors": read_anchors(path.parent / map_.anchors)})
    return map_


def unit_key(map_: Map, by: float, key: str = "imu") -> str:
    """Return the entry of a map that scales a source's stamps by the factor `by`, against the drift of its clock."""
    return f"{key}: {{unit: {size_of(getattr(map_, key).unit, UNITS) * by:.6g}}} (its clock drifts)"
