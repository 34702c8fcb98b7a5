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
    """Noise densities of a small inertial sensor from its maker's data sheet."""

    rate_density: Positive
    """noise density of the body rates [rad/s/sqrt(Hz)]."""
    specific_force_density: Positive
    """noise density of the specific force [m/s^2/sqrt(Hz)]."""


# From the makers' data sheets: InvenSense ICM-42688-P (2021), 0.0028 deg/s/sqrt(Hz) and 70 ug/sqrt(Hz), 75 in z; Bosch
# BMI088 (2018), 0.014 deg/s/sqrt(Hz) and 175 ug/sqrt(Hz), 230 in z.
DATASHEETS = {
    "icm_42688_p": Datasheet(rate_density=4.9e-5, specific_force_density=7.4e-4),
    "bmi088": Datasheet(rate_density=2.4e-4, specific_force_density=2.3e-3),
}


class InertialNoise(Frozen):
    """The tight filter's noise model of the IMU; all figures are standard deviations or noise densities."""

    datasheet: Literal["none", "icm_42688_p", "bmi088"] = "none"
    """the unit whose noise densities are used; 'none' uses rate_density and specific_force_density."""
    rate_density: Positive = 0.001 * USUAL_ROOT
    """noise density of the body rates per axis [rad/s/sqrt(Hz)]; the default is 0.001 rad/s at 30 Hz."""
    specific_force_density: Positive = 0.05 * USUAL_ROOT
    """noise density of the specific force per axis [m/s^2/sqrt(Hz)]; the default is 0.05 m/s^2 at 30 Hz."""
    angle_density: Positive | None = 0.01 * USUAL_ROOT
    """noise density of roll, pitch and yaw [rad/sqrt(Hz)]; the default is 0.01 rad at 30 Hz, null leaves them out."""
    gyroscope_sd: NonNegativeFloat = 3.0e-4
    """initial bias of the body rates per axis [rad/s]; not read after a standstill (imu.standstill)."""
    gyroscope_rate: NonNegativeFloat = 1.0e-5
    """random walk of that bias, its standard deviation after 1 s [rad/s]."""
    accelerometer_sd: NonNegativeFloat = 0.1
    """initial bias of the specific force per axis [m/s^2]; not read after a standstill (imu.standstill)."""
    accelerometer_rate: NonNegativeFloat = 5.0e-4
    """random walk of that bias, its standard deviation after 1 s [m/s^2]."""
    level_sd: NonNegativeFloat = 0.0
    """lasting error of roll and pitch [rad]; 0 for not estimated."""
    yaw_sd: NonNegativeFloat = 0.0
    """lasting error of the yaw [rad]; 0 for not estimated."""
    angles_rate: NonNegativeFloat = 2.0e-4
    """random walk of these lasting errors, their standard deviation after 1 s [rad]."""
    coasting_sd: tuple[Positive, Positive] = (0.004, 0.15)
    """change of the body rates [rad/s] and the specific force [m/s^2] in a tick without samples."""
    silent_rate: tuple[Positive, Positive] = (0.05, 0.3)
    """random walk of the errors of body rates [rad/s] and specific force [m/s^2] while the imu sends nothing new, their
    standard deviation after 1 s."""


class TightRanges(Frozen):
    """The tight filter's noise model of single ranges; all errors are standard deviations."""

    noise: RangeNoise = ProportionalNoise()
    """white noise of every range."""
    bias_sd: NonNegativeFloat = 0.0
    """lasting error of each anchor's ranges, from bias and survey [m]; 0 for not estimated."""
    bias_rate: NonNegativeFloat = 0.0
    """random walk of the lasting error, its standard deviation after 1 s [m]: a survey's error changes with place."""
    slow_sd: NonNegativeFloat = 0.0
    """slowly changing error of each anchor's ranges [m]; 0 for not estimated."""
    slow_time: Positive = 3.0
    """correlation time of the slowly changing error [s]."""
    clock_sd: NonNegativeFloat = 0.0
    """age of a message beyond its stamp [s]; 0 for not estimated."""
    lever: tuple[Length, Length, Length] = (0.0, 0.0, 0.0)
    """position of the antenna in B [m]."""
    differences: bool = False
    """whether only differences of ranges are used, as needed if vehicle and anchors have different clocks (TDoA)."""


class TightPixels(Frozen):
    """The tight filter's noise model of the boxes' centres; all errors are standard deviations.

    The defaults are what `ortilo detector calibrate` measured for our own network.
    """

    sd: Positive = 0.5
    """error of a small box's centre [px]."""
    growth: NonNegativeFloat = 0.022
    """growth of the centre's error with the box's size, relative to sd [1/px]."""
    slow_share: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.44
    """share of the variance that lasts from picture to picture [1]."""
    slow_time: Positive = 0.7
    """correlation time of the lasting part [s]."""
    survey_sd: NonNegativeFloat = 0.0
    """error of each landmark's surveyed position per axis [m]; 0 for not estimated."""
    clock_sd: NonNegativeFloat = 0.0
    """age of a message beyond its stamp [s]; 0 for not estimated."""


class TightWatch(Frozen):
    """The tight filter's tests for a sensor that goes wrong in flight.

    A sensor that repeats its last message is ignored.
    """

    time: Positive = 0.5
    """averaging time of the tests [s]."""
    leans: Positive = 1.0
    """size of the angles' mean normalized innovation above which the gyroscope's bias is estimated anew [1]."""
    gyroscope_sd: Positive = 0.02
    """step of the gyroscope's bias per axis that the filter then assumes [rad/s]."""
    sided: Annotated[float, Field(gt=0.0, lt=1.0)] = 0.7
    """mean share of ranges rejected with the same sign above which an error common to all ranges is estimated [1]."""
    offset_sd: Positive = 1.0
    """error common to all ranges that the filter then assumes [m]."""


class TightFilter(Frozen):
    """The tightly coupled estimator: single ranges, pixels and inertial samples in one error-state Kalman filter."""

    kind: Literal["tight"]
    force: Literal["measured"] = "measured"
    """always 'measured': the filter reads the imu's specific force."""
    rates: Literal["measured"] = "measured"
    """always 'measured': the filter reads the imu's body rates."""
    imu: InertialNoise = InertialNoise()
    """noise of the imu that the filter assumes."""
    ranges: TightRanges = TightRanges()
    """noise of the ranges that the filter assumes."""
    pixels: TightPixels = TightPixels()
    """noise of the boxes that the filter assumes."""
    initial_sd: tuple[InitialSd, InitialSd, InitialSd] = (0.05, 0.02, 0.05)
    """standard deviations of the initial position [m], angles [rad] and velocity [m/s]."""
    gate: Gate = 0.9999
    """probability that a correct range or box is used [1]; values beyond its quantile are rejected."""
    huber: Positive = 3.0
    """size of an innovation, in its standard deviations, above which it gets less weight [1]."""
    watch: TightWatch | None = TightWatch()
    """tests that detect failing sensors; null for no such tests."""
    horizon: Annotated[float, Field(ge=0.0, le=1.0)] = 0.1
    """greatest delay of a message that is used [s]; the filter keeps the poses of the ticks within it."""
