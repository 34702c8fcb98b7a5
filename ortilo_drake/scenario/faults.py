"""Settings of the faults in a flight, each from a start, most until an end.

The onboard half does not know the faults. A fault leaves the noise of everything else unchanged (world/faults).
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
    """time at which the fault begins [s]."""


class Fault(Onset):
    """A fault that may end."""

    end: Time | None = None
    """time at which the fault ends [s]; null for never."""

    @model_validator(mode="after")
    def _ends_after_its_start(self) -> "Fault":
        if self.end is not None and self.end <= self.start:
            raise ValueError(f".end: {self.end}: must be after the start, {self.start}, or null")
        return self


class NlosStorm(Fault):
    """Loss of the line of sight: a share of the ranges is too long, by an exponential length."""

    kind: Literal["nlos_storm"]
    share: Share = 0.5
    """share of ranges that are too long [1], drawn independently for each range; above 0, at most 1."""
    mean: Annotated[float, Field(gt=0.0, le=100.0)] = 1.0
    """mean of the added length [m]."""


class OutlierBursts(Fault):
    """Bursts in which every range has an additional Gaussian error."""

    start: Time
    """time at which the first burst begins [s]."""
    kind: Literal["outlier_bursts"]
    every: Positive = 0.5
    """time from the beginning of a burst to the beginning of the next one [s]."""
    length: Positive = 0.2
    """duration of a burst [s]."""
    sd: Annotated[float, Field(gt=0.0, le=100.0)] = 2.0
    """standard deviation of the additional error [m]."""


class Stuck(Fault):
    """A stuck sensor: it repeats its last payload before the start, with current stamps."""

    kind: Literal["stuck"]
    start: Annotated[float, Field(gt=0.0, le=3600.0)]
    """time at which the fault begins [s], above 0."""
    sensor: str
    """name of the sensor, which must fly."""


class AnchorMoved(Fault):
    """A UWB anchor that is moved: its ranges change to the new place, with the noise and the walls of the old place."""

    end: Time | None = None
    """time at which the anchor is moved back [s]; null for never."""
    kind: Literal["anchor_moved"]
    anchor: Index
    """index of the anchor in the room's file, from 0 [1]."""
    by: Vector = (0.3, 0.0, 0.0)
    """vector from the old to the new place in W [m], each coordinate at most 10."""


class AnchorsDying(Fault):
    """UWB anchors that fall silent one after the other."""

    start: Time
    """time at which the first anchor falls silent [s]."""
    end: Time | None = None
    """time at which all anchors work again [s]; null for never."""
    kind: Literal["anchors_dying"]
    anchors: Annotated[tuple[Index, ...], Field(min_length=1, max_length=1000)]
    """indices of the anchors in the room's file, from 0 [1], in the order in which they fall silent."""
    every: Positive = 1.0
    """time from the silence of one anchor to the silence of the next [s]."""


class ClockJump(Fault):
    """A jump of the receiver's clock: all ranges are wrong by the same length."""

    kind: Literal["clock_jump"]
    by: Length = 0.5
    """length added to every range [m]; 0.3 m is a nanosecond."""


class YawJump(Fault):
    """A jump of the IMU's yaw, as of a compass beside iron."""

    kind: Literal["yaw_jump"]
    by: Annotated[float, Field(ge=-3.15, le=3.15)] = 0.26
    """angle added to the yaw [rad], at most pi."""


class GyroBias(Fault):
    """A step of the gyroscope's bias; the IMU's angles stay correct."""

    kind: Literal["gyro_bias"]
    by: Vector = (0.01, 0.01, 0.01)
    """bias added to the body rates w_WB_B [rad/s]."""


class CameraBlinded(Fault):
    """A blinded camera: its messages arrive without any box."""

    kind: Literal["camera_blinded"]


class LandmarkMoved(Fault):
    """A landmark that is moved."""

    end: Time | None = None
    """time at which the landmark is moved back [s]; null for never."""
    kind: Literal["landmark_moved"]
    landmark: Index
    """index of the landmark in the room's file, from 0 [1]."""
    by: Vector = (0.0, 0.5, 0.0)
    """vector from the old to the new place in W [m], each coordinate at most 10."""


class LandmarkGone(Fault):
    """A landmark that is taken away."""

    end: Time | None = None
    """time at which the landmark is put back [s]; null for never."""
    kind: Literal["landmark_gone"]
    landmark: Index
    """index of the landmark in the room's file, from 0 [1]."""


class People(Fault):
    """People who walk to and fro: upright cylinders that block camera and receiver."""

    start: Time
    """time at which the people appear [s]."""
    end: Time | None = None
    """time at which the people leave [s]; null for never."""
    kind: Literal["people"]
    walks: Annotated[tuple[tuple[Number, Number, Number, Number], ...], Field(min_length=1, max_length=100)]
    """for each person, the points in W where the walk begins and where it turns: x, y, x, y [m]."""
    speed: Positive = 1.2
    """speed of every person [m/s]."""
    radius: Positive = 0.25
    """radius of the cylinders [m]."""
    height: Positive = 1.75
    """height of the cylinders, which stand on the floor [m]."""
    excess: Annotated[float, Field(gt=0.0, le=100.0)] | None = None
    """mean of the exponential excess of a range through a person [m], drawn anew for each range; null for none."""


class Gust(Fault):
    """A gust: a force in addition to all other forces on the vehicle."""

    kind: Literal["gust"]
    force: tuple[Number, Number, Number] = (0.0, 2.0, 0.0)
    """force in W [N]."""


class LoadDropped(Onset):
    """A load that the vehicle drops from its center of mass; the moments of inertia do not change."""

    start: Time
    """time at which the load drops [s]."""
    kind: Literal["load_dropped"]
    mass_factor: Factor = 0.9
    """mass after the drop over mass before [1], 0.5 to 1."""


class RotorWeak(Fault):
    """A rotor that produces less thrust and drag than normal at its commanded speed."""

    kind: Literal["rotor_weak"]
    rotor: Annotated[int, Field(ge=0, le=15)] = 0
    """index of the rotor, from 0 [1]."""
    factor: Factor = 0.8
    """thrust of the weak rotor over its normal thrust [1], 0.5 to 1."""


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
    """Return the sensors that a fault concerns; none if it is a fault of the vehicle."""
    if hasattr(fault, "sensor"):  # a fault that may concern any sensor
        return (fault.sensor,)
    return sensors_of_kind(getattr(fault, "kind", ""))


def sensors_of_kind(kind: str) -> tuple[str, ...]:
    """Return the sensors that faults of a kind concern; none if they concern the vehicle or any one sensor."""
    return tuple(sensor for sensor, kinds in _SENSORS_OF.items() if kind in kinds)


def check_faults(faults: tuple[AnyFault, ...], sensors: tuple[str, ...], rendered: bool) -> None:
    """Raise ValueError, naming the fault, if a fault concerns no sensor that flies, or a rendered camera."""
    for i, fault in enumerate(faults):
        concerned = sensors_of(fault)
        if concerned and not set(concerned) & set(sensors):
            raise ValueError(
                f"faults.{i}: {fault.kind}: concerns {' and '.join(concerned)}, must be in sensors {list(sensors)}"
            )
        if rendered and "camera" in concerned:
            raise ValueError(f"faults.{i}: {fault.kind}: a fault of the camera: camera.kind must be projected")
