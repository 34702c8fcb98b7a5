"""Settings of the tightly coupled estimator."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat

from ortilo_drake.model.typed_yaml import Frozen, Positive
from ortilo_drake.model.white_noise import USUAL_ROOT
from ortilo_drake.scenario.estimator import InitialSd
from ortilo_drake.scenario.onboard import Gate
from ortilo_drake.scenario.sensors import ProportionalNoise, RangeNoise

Length = Annotated[float, Field(ge=-10.0, le=10.0)]


class Datasheet(Frozen):
    """Noise of a small inertial sensor as its maker states it."""

    rate_density: Positive
    """of the body rates [rad/s/sqrt(Hz)]."""
    specific_force_density: Positive
    """of the specific force [m/s^2/sqrt(Hz)]."""


# From the makers' data sheets: InvenSense ICM-42688-P (2021), 0.0028 deg/s/sqrt(Hz) and 70 ug/sqrt(Hz), 75 in z; Bosch
# BMI088 (2018), 0.014 deg/s/sqrt(Hz) and 175 ug/sqrt(Hz), 230 in z.
DATASHEETS = {
    "icm_42688_p": Datasheet(rate_density=4.9e-5, specific_force_density=7.4e-4),
    "bmi088": Datasheet(rate_density=2.4e-4, specific_force_density=2.3e-3),
}


class InertialNoise(Frozen):
    """The tight filter's noise model of the imu."""

    datasheet: Literal["none", "icm_42688_p", "bmi088"] = "none"
    """the unit whose noise densities are used; 'none' uses the next two."""
    rate_density: Positive = 0.001 * USUAL_ROOT
    """noise of the body rates per axis [rad/s/sqrt(Hz)]; the default is 0.001 rad/s at 30 Hz."""
    specific_force_density: Positive = 0.05 * USUAL_ROOT
    """of the specific force per axis [m/s^2/sqrt(Hz)]; the default is 0.05 m/s^2 at 30 Hz."""
    angle_density: Positive | None = 0.01 * USUAL_ROOT
    """of roll, pitch and yaw [rad/sqrt(Hz)]; the default is 0.01 rad at 30 Hz, null leaves them out."""
    gyroscope_sd: NonNegativeFloat = 3.0e-4
    """bias of the body rates per axis at first [rad/s]; not read after a standstill, imu.standstill."""
    gyroscope_rate: NonNegativeFloat = 1.0e-5
    """its random walk, a standard deviation after 1 s [rad/s]."""
    accelerometer_sd: NonNegativeFloat = 0.1
    """bias of the specific force per axis at first [m/s^2]; likewise."""
    accelerometer_rate: NonNegativeFloat = 5.0e-4
    """its random walk, likewise [m/s^2]."""
    level_sd: NonNegativeFloat = 0.0
    """error of roll and pitch, which lasts [rad]; 0 has none estimated."""
    yaw_sd: NonNegativeFloat = 0.0
    """error of the yaw, which lasts [rad]."""
    angles_rate: NonNegativeFloat = 2.0e-4
    """random walk of both, likewise [rad]."""
    coasting_sd: tuple[Positive, Positive] = (0.004, 0.15)
    """what a tick without samples may change of body rates [rad/s] and specific force [m/s^2]."""
    silent_rate: tuple[Positive, Positive] = (0.05, 0.3)
    """random walk of the errors of body rates [rad/s] and specific force [m/s^2] after a second in which the imu sends
    nothing new."""


class TightRanges(Frozen):
    """The tight filter's noise model of single ranges."""

    noise: RangeNoise = ProportionalNoise()
    """white noise of every range."""
    bias_sd: NonNegativeFloat = 0.0
    """error of each anchor's ranges that lasts [m]: bias, survey; 0 has none estimated."""
    bias_rate: NonNegativeFloat = 0.0
    """its random walk, a standard deviation after 1 s [m]: a survey's error changes with the place."""
    slow_sd: NonNegativeFloat = 0.0
    """error of each anchor's ranges that changes slowly [m]; 0 has none estimated."""
    slow_time: Positive = 3.0
    """its correlation time [s]."""
    clock_sd: NonNegativeFloat = 0.0
    """by how much a message may be older than its stamp [s]; 0 for not estimated."""
    lever: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    """where the antenna is in B [m]."""
    differences: bool = False
    """whether only differences of ranges count, as where the vehicle's clock is not that of the anchors (TDoA)."""


class TightPixels(Frozen):
    """The tight filter's noise model of the boxes' centres.

    The defaults are those of our own network, by what `ortilo detector calibrate` measured of it.
    """

    sd: Positive = 0.5
    """error of a small box's centre [px]."""
    growth: NonNegativeFloat = 0.022
    """its growth with the box's size, relative to sd [1/px]."""
    slow_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.44
    """share of the variance that lasts from picture to picture [1]."""
    slow_time: Positive = 0.7
    """for how long [s]."""
    survey_sd: NonNegativeFloat = 0.0
    """error of each landmark's surveyed position per axis [m]; 0 has none estimated."""
    clock_sd: NonNegativeFloat = 0.0
    """by how much a message may be older than its stamp [s]; 0 for not estimated."""


class TightWatch(Frozen):
    """The tight filter's tests for a sensor that goes wrong in flight.

    A sensor that repeats its last message is ignored.
    """

    time: Positive = 0.5
    """over which contradictions are averaged [s]."""
    leans: Positive = 1.0
    """mean of the angles' normalized innovations above which the gyroscope's bias is estimated anew [1]."""
    gyroscope_sd: Positive = 0.02
    """step of the gyroscope's bias per axis that is assumed then [rad/s]."""
    sided: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.7
    """mean share of ranges rejected with one sign above which an error common to all is estimated [1]."""
    offset_sd: Positive = 1.0
    """error of all ranges that is assumed then [m]."""


class TightFilter(Frozen):
    """The tightly coupled estimator: single ranges, pixels and inertial samples in one error-state Kalman filter."""

    kind: Literal["tight"]
    force: Literal["measured"] = "measured"
    """'measured': it reads the imu's specific force ..."""
    rates: Literal["measured"] = "measured"
    """... and its body rates."""
    imu: InertialNoise = InertialNoise()
    """noise of the imu, as it believes it."""
    ranges: TightRanges = TightRanges()
    """of the ranges."""
    pixels: TightPixels = TightPixels()
    """of the boxes."""
    initial_sd: tuple[InitialSd, InitialSd, InitialSd] = (0.05, 0.02, 0.05)
    """standard deviations of its initial position [m], angles [rad] and velocity [m/s]."""
    gate: Gate = 0.9999
    """probability [1] beyond which a range or a box is refused."""
    huber: Positive = 3.0
    """standard deviations of an innovation from which on it weighs less [1]."""
    watch: TightWatch | None = TightWatch()
    """how the filter detects failing sensors; null for not at all."""
    horizon: Annotated[float, Field(ge=0.0, le=1.0)] = 0.1
    """how late a message may be [s]: poses of so many past ticks are kept."""
