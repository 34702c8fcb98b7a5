"""Faults in the middle of a flight, each from a start, most until an end.

The onboard half knows nothing of them. A fault changes what it concerns and no other noise, see world/faults.
"""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ortilo_drake.model.typed_yaml import Frozen, Positive

Time = Annotated[float, Field(ge=0.0, le=3600.0)]
Length = Annotated[float, Field(ge=-10.0, le=10.0)]
Share = Annotated[float, Field(gt=0.0, le=1.0)]
Factor = Annotated[float, Field(ge=0.5, le=1.0)]
Index = Annotated[int, Field(ge=0, lt=1000)]
Number = Annotated[float, Field(ge=-100.0, le=100.0)]
Vector = tuple[Length, Length, Length]


class Onset(Frozen):
    """A fault that lasts from its start on."""

    start: Time
    """when it begins [s]."""


class Fault(Onset):
    """A fault that may end."""

    end: Time | None = None
    """when it ends [s]; null if it does not."""

    @model_validator(mode="after")
    def _ends_after_its_start(self) -> "Fault":
        if self.end is not None and self.end <= self.start:
            raise ValueError(f".end: {self.end}: must be after the start, {self.start}, or null")
        return self


class NlosStorm(Fault):
    """Ranges without a line of sight: a share of them comes out longer, by an exponential length."""

    kind: Literal["nlos_storm"]
    share: Share = 0.5
    """of the ranges, drawn anew for each [1], above 0, at most 1."""
    mean: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    """mean of the added length [m]."""


class OutlierBursts(Fault):
    """Bursts in which every range has a further Gaussian error."""

    start: Time
    """when the first burst begins [s]."""
    kind: Literal["outlier_bursts"]
    every: Positive = 0.5
    """from the beginning of a burst to the next one's [s]."""
    length: Positive = 0.2
    """of a burst [s]."""
    sd: Annotated[float, Field(gt=0.0, le=100.0)] = 2.0
    """standard deviation of the error [m]."""


class Stuck(Fault):
    """A stuck sensor: it repeats its last payload before the start, with current stamps."""

    kind: Literal["stuck"]
    start: Annotated[float, Field(gt=0.0, le=3600.0)]
    """when it begins [s], above 0."""
    sensor: str
    """which one; it must fly."""


class AnchorMoved(Fault):
    """A UWB anchor that is moved: its ranges are to its new place, its noise and the walls between those of old."""

    end: Time | None = None
    """when the anchor is back [s]; null if it stays."""
    kind: Literal["anchor_moved"]
    anchor: Index
    """its index in the room's file, from 0 [1]."""
    by: Vector = (0.3, 0.0, 0.0)
    """from the old to the new place in W [m], each at most 10."""


class AnchorsDying(Fault):
    """UWB anchors that fall silent one after the other."""

    start: Time
    """when the first falls silent [s]."""
    end: Time | None = None
    """when all are back [s]; null if they stay silent."""
    kind: Literal["anchors_dying"]
    anchors: Annotated[tuple[Index, ...], Field(min_length=1, max_length=1000)]
    """their indices in the room's file, from 0 [1], in the order of their ends."""
    every: Positive = 1.0
    """from one's end to the next one's [s]."""


class ClockJump(Fault):
    """A jump of the receiver's clock: all ranges are off by the same length."""

    kind: Literal["clock_jump"]
    by: Length = 0.5
    """added to every range [m]; 0.3 m is a nanosecond."""


class YawJump(Fault):
    """A jump of the imu's yaw, as of a compass beside iron."""

    kind: Literal["yaw_jump"]
    by: Annotated[float, Field(ge=-3.15, le=3.15)] = 0.26
    """added to the yaw [rad], at most pi."""


class GyroBias(Fault):
    """A step of the gyroscope's bias; the imu's angles stay."""

    kind: Literal["gyro_bias"]
    by: Vector = (0.01, 0.01, 0.01)
    """added to the body rates w_WB_B [rad/s]."""


class CameraBlinded(Fault):
    """A blinded camera: its messages come, without a box."""

    kind: Literal["camera_blinded"]


class LandmarkMoved(Fault):
    """A landmark that was moved."""

    end: Time | None = None
    """when the landmark is back [s]; null if it stays."""
    kind: Literal["landmark_moved"]
    landmark: Index
    """its index in the room's file, from 0 [1]."""
    by: Vector = (0.0, 0.5, 0.0)
    """from the old to the new place in W [m], each at most 10."""


class LandmarkGone(Fault):
    """A landmark that was taken away."""

    end: Time | None = None
    """when the landmark is back [s]; null if it is not."""
    kind: Literal["landmark_gone"]
    landmark: Index
    """its index in the room's file, from 0 [1]."""


class People(Fault):
    """People who walk to and fro: upright cylinders in the way of camera and receiver."""

    start: Time
    """when they come [s]."""
    end: Time | None = None
    """when they are gone [s]; null if they stay."""
    kind: Literal["people"]
    walks: Annotated[tuple[tuple[Number, Number, Number, Number], ...], Field(min_length=1, max_length=100)]
    """of each, where in W the walk begins and where it turns: x, y, x, y [m]."""
    speed: Positive = 1.2
    """of all [m/s]."""
    radius: Positive = 0.25
    """of the cylinders [m]."""
    height: Positive = 1.75
    """of the cylinders, on the floor [m]."""
    excess: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """mean of the exponential excess of a range through a person [m], drawn anew for each; null if there is none."""


class Gust(Fault):
    """A gust: a force beside whatever else pushes the vehicle."""

    kind: Literal["gust"]
    force: tuple[Number, Number, Number] = (0.0, 2.0, 0.0)
    """in W [N]."""


class LoadDropped(Onset):
    """A load that the vehicle drops from its center of mass; the moments of inertia stay."""

    start: Time
    """when it drops [s]."""
    kind: Literal["load_dropped"]
    mass_factor: Factor = 0.9
    """mass afterwards over mass before [1], 0.5 to 1."""


class RotorWeak(Fault):
    """A rotor that makes less thrust and drag of the speed it is asked for."""

    kind: Literal["rotor_weak"]
    rotor: Annotated[int, Field(ge=0, le=15)] = 0
    """its index, from 0 [1]."""
    factor: Factor = 0.8
    """its thrust over its normal thrust [1], 0.5 to 1."""


AnyFault = Annotated[
    NlosStorm
    | OutlierBursts
    | Stuck
    | AnchorMoved
    | AnchorsDying
    | ClockJump
    | YawJump
    | GyroBias
    | CameraBlinded
    | LandmarkMoved
    | LandmarkGone
    | People
    | Gust
    | LoadDropped
    | RotorWeak,
    Field(discriminator="kind"),
]
MAX_FAULTS = 100
Faults = Annotated[tuple[AnyFault, ...], Field(max_length=MAX_FAULTS)]

_SENSORS_OF = {
    "uwb": ("nlos_storm", "outlier_bursts", "anchor_moved", "anchors_dying", "clock_jump", "people"),
    "imu": ("yaw_jump", "gyro_bias"),
    "camera": ("camera_blinded", "landmark_moved", "landmark_gone", "people"),
}


def sensors_of(fault: Onset) -> tuple[str, ...]:
    """Return the sensors that a fault concerns; none if it is the vehicle's."""
    if hasattr(fault, "sensor"):  # one that may be any sensor's
        return (fault.sensor,)
    return sensors_of_kind(getattr(fault, "kind", ""))


def sensors_of_kind(kind: str) -> tuple[str, ...]:
    """Return the sensors that faults of a kind concern; none if those are the vehicle's, or may be any sensor's."""
    return tuple(sensor for sensor, kinds in _SENSORS_OF.items() if kind in kinds)


def check_faults(faults: tuple[AnyFault, ...], sensors: tuple[str, ...], rendered: bool) -> None:
    """Refuse faults of sensors that do not fly, and of a rendered camera: ValueError names the fault."""
    for i, fault in enumerate(faults):
        concerned = sensors_of(fault)
        if concerned and not set(concerned) & set(sensors):
            raise ValueError(
                f"faults.{i}: {fault.kind}: concerns {' and '.join(concerned)}, must be in sensors {list(sensors)}"
            )
        if rendered and "camera" in concerned:
            raise ValueError(f"faults.{i}: {fault.kind}: a fault of the camera: camera.kind must be projected")
