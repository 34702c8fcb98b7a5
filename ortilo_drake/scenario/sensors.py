"""Settings of IMU and UWB."""

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, model_validator

from ortilo_drake.model.range_pairs import Pairs
from ortilo_drake.model.typed_yaml import FileName, Frozen, Positive
from ortilo_drake.model.white_noise import USUAL_ROOT, white_sd
from ortilo_drake.scenario.link import Link, LinkRate
from ortilo_drake.scenario.noise_file import UwbNoise


class SensorSetup(Frozen):
    """The settings of a sensor that the onboard half knows."""

    link: LinkRate = LinkRate()
    """rate of the sensor's messages."""


class ImuSetup(SensorSetup):
    """The settings of the IMU that the onboard half knows."""

    standstill: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0
    """time for which the vehicle rests on the floor before take-off [s], to calibrate gyroscope and accelerometer; 0
    for no calibration. A filter's initial covariance of their biases follows from this time."""


class Ahrs(Frozen):
    """An attitude filter without a magnetometer: a complementary filter that takes the specific force for gravity.

    The filter draws roll and pitch towards the direction of the specific force, so they are wrong while the vehicle
    accelerates. Nothing corrects the yaw, which drifts. The random walks of the angles are settings of truth.imu.
    """

    time: Positive = 5.0
    """time constant with which roll and pitch follow the specific force, the reciprocal of the filter's gain [s]."""
    drift_sd: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """standard deviation of the rate at which the yaw drifts, drawn by seed [rad/s]."""


class Imu(ImuSetup):
    """An IMU with its own attitude filter: white noise on each output, of sd density / sqrt(sample period)."""

    link: Link = Link()
    """rate and delivery of the IMU's messages."""
    angle_density: NonNegativeFloat = 0.01 * USUAL_ROOT
    """noise density of roll, pitch and yaw [rad/sqrt(Hz)]; the default is 0.01 rad at 30 Hz."""
    rate_density: NonNegativeFloat = 0.01 * USUAL_ROOT
    """noise density of the body rates per axis [rad/s/sqrt(Hz)]; the default is 0.01 rad/s at 30 Hz."""
    specific_force_density: NonNegativeFloat = 0.05 * USUAL_ROOT
    """noise density of the specific force per axis [m/s^2/sqrt(Hz)]; the default is 0.05 m/s^2 at 30 Hz."""
    ahrs: Ahrs | None = None
    """error of the IMU's attitude filter under acceleration; null for none."""

    def sds(self, period: float) -> tuple[float, float, float]:
        """Return the sds of angles [rad], rates [rad/s] and specific force [m/s^2] for samples every `period` [s]."""
        rate, force = white_sd(self.rate_density, period), white_sd(self.specific_force_density, period)
        return white_sd(self.angle_density, period), rate, force


class _WhiteNoise(Frozen):
    @property
    def sds(self) -> tuple[float, float]:
        """The numbers s_0 [m] and s_1 of the standard deviation s_0 + s_1 d."""
        return getattr(self, "sd", 0.0), getattr(self, "fraction", 0.0)


class ProportionalNoise(_WhiteNoise):
    """Range noise that grows with the distance."""

    kind: Literal["proportional"] = "proportional"
    fraction: NonNegativeFloat = 0.0075
    """standard deviation over distance [1]."""


class ConstantNoise(_WhiteNoise):
    """Range noise that is the same at every distance."""

    kind: Literal["constant"]
    sd: NonNegativeFloat
    """standard deviation [m]."""


class AffineNoise(_WhiteNoise):
    """Range noise with a floor: the standard deviation is a constant plus a share of the distance."""

    kind: Literal["affine"]
    sd: NonNegativeFloat = 0.03
    """standard deviation at distance 0 [m]."""
    fraction: NonNegativeFloat = 0.002
    """growth of the standard deviation per distance [1]."""


class WallsIgnored(Frozen):
    """Radio passes through walls unchanged."""

    kind: Literal["none"] = "none"


class WallsBias(Frozen):
    """Each wall in the line of sight, except the one that holds the anchor, lengthens a range by a constant."""

    kind: Literal["bias"]
    per_wall: NonNegativeFloat = 0.3
    """length that each wall adds to a range [m]."""


class WallsBlock(Frozen):
    """Each wall in the line of sight, except the one that holds the anchor, blocks a range."""

    kind: Literal["block"]


class WallsExcess(Frozen):
    """Each wall in the line of sight, except the one that holds the anchor, adds an exponential length to a range.

    The added length changes slowly for each anchor, so its ranges are too long in bursts, while a wall is between.
    """

    kind: Literal["excess"]
    mean: NonNegativeFloat = 0.3
    """mean of the length that a wall adds [m]; the standard deviation is the same, the skewness 2."""
    time: Positive = 1.0
    """correlation time of the added length [s]."""


RangeNoise = Annotated[ProportionalNoise | ConstantNoise | AffineNoise, Field(discriminator="kind")]
WallEffect = Annotated[WallsIgnored | WallsBias | WallsBlock | WallsExcess, Field(discriminator="kind")]


class UwbSetup(SensorSetup):
    """The settings of the UWB sensor that the onboard half knows."""

    link: LinkRate = LinkRate(rate=10.0)
    kind: Literal["ranges", "differences"] = "ranges"
    """'ranges' sends a range to each anchor in a message. 'differences' sends packets in turn, each with the difference
    of the ranges to two anchors, as a vehicle that only listens receives them (TDoA); only estimator.kind tight reads
    these."""
    pairs: Pairs = "cycle"
    """the two anchors of each difference: 'cycle' takes each anchor and the next one, 'all' takes all pairs in turn."""
    packets: Annotated[float, Field(ge=0.1, le=1e4)] = 300.0
    """differences per second, evenly spaced [1/s]; each message must have a whole number of them."""
    round: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    """duration of a round of ranging [s]. The n anchors are ranged one after the other in even slots, the last one at
    the message's stamp, so range i (0 to n - 1) is older by the share 1 - (i + 1) / n of this duration. The onboard
    half knows this and moves each range to the stamp with its estimated velocity."""
    behind_walls: Literal["used", "left_out"] | None = None
    """treatment of ranges that, by the map and the estimate, pass a wall: they are 'used' like all others, or
    'left_out'. null leaves them out if the scenario's walls lengthen ranges: the team knows that walls do so, but not
    by how much."""

    def ages(self, n: int) -> np.ndarray:
        """Return the ages of n ranges at their message's stamp (n) [s]."""
        return self.round * (1.0 - np.arange(1, n + 1) / n)

    def rows(self, h: float) -> int:
        """Return the number of differences in a message, with ticks of h [s]."""
        return round(self.packets * self.link.every(h) * h)


class Uwb(UwbSetup):
    """UWB ranging to the room's anchors; by default as in the authors' simulator: 10 Hz, sd 0.0075 d, no walls."""

    link: Link = Link(rate=10.0)
    """rate and delivery of the UWB messages."""
    noise: RangeNoise = ProportionalNoise()
    """noise of each range, used with errors 'white'."""
    errors: Literal["white", "fitted"] = "white"
    """'white' draws `noise` anew for each range. 'fitted' draws the errors fitted to recordings: a constant for each
    anchor, lasting errors, white noise, outliers and their bursts, missing ranges."""
    file: FileName | None = None
    """NOISE.yaml of `ortilo fit`, by a path as in `room`, or one that comes with the package, iasl_2023 or util_2021;
    its range errors become `fitted`."""
    fitted: UwbNoise | None = None
    """the range errors that errors 'fitted' draws."""
    walls: WallEffect = WallsIgnored()
    """effect of walls in the line of sight on a range."""
    max_distance: Positive = 100.0
    """distance beyond which an anchor gives no range [m]."""

    @property
    def sds(self) -> tuple[float, float]:
        """The numbers s_0 [m] and s_1 of the standard deviation s_0 + s_1 d of a range's white noise."""
        if self.errors == "fitted" and self.fitted is not None:
            return self.fitted.of_single_ranges.white, 0.0
        return self.noise.sds

    @model_validator(mode="after")
    def _knows_its_errors(self) -> "Uwb":
        if self.file is not None:
            raise ValueError(f".file: {self.file}: is read by load_scenario alone")
        if self.errors == "fitted" and self.fitted is None:
            raise ValueError(".file: null: must name a NOISE.yaml, iasl_2023 or util_2021 with errors 'fitted'")
        return self
