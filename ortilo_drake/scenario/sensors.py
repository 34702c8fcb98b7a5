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
    """A sensor, as the onboard half knows it."""

    link: LinkRate = LinkRate()
    """rate of its messages."""


class ImuSetup(SensorSetup):
    """The imu, as the onboard half knows it."""

    standstill: Annotated[float, Field(ge=0.0, le=3600.0)] = 0.0
    """how long the vehicle rests on the floor before take-off [s], which calibrates gyroscope and accelerometer; 0 for
    not at all. A filter's first covariance of their biases follows from it."""


class Ahrs(Frozen):
    """An attitude filter without a magnetometer: a complementary filter that takes the specific force for gravity.

    Its roll and pitch are drawn to those of the specific force, so they err while the vehicle accelerates; nothing
    holds its yaw, which drifts. Walks of the angles are truth.imu's.
    """

    time: Positive = 5.0
    """in which roll and pitch follow the specific force, the reciprocal of the filter's gain [s]."""
    drift_sd: Annotated[float, Field(ge=0.0, le=1.0)] = 0.0
    """standard deviation of the rate at which the yaw drifts, drawn by seed [rad/s]."""


class Imu(ImuSetup):
    """An IMU with its own attitude filter: white noise on each output, of sd density / sqrt(period of its samples)."""

    link: Link = Link()
    """rate and delivery of its messages."""
    angle_density: NonNegativeFloat = 0.01 * USUAL_ROOT
    """of roll, pitch and yaw [rad/sqrt(Hz)]; the default is 0.01 rad at 30 Hz."""
    rate_density: NonNegativeFloat = 0.01 * USUAL_ROOT
    """of the body rates per axis [rad/s/sqrt(Hz)]; the default is 0.01 rad/s at 30 Hz."""
    specific_force_density: NonNegativeFloat = 0.05 * USUAL_ROOT
    """of the specific force per axis [m/s^2/sqrt(Hz)]; the default is 0.05 m/s^2 at 30 Hz."""
    ahrs: Ahrs | None = None
    """error of its attitude filter under acceleration; null for none."""

    def sds(self, period: float) -> tuple[float, float, float]:
        """Return the standard deviations of angles, rates and specific force of a sample every so many seconds."""
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
    """Range noise with a floor: its standard deviation is a constant and a share of the distance."""

    kind: Literal["affine"]
    sd: NonNegativeFloat = 0.03
    """standard deviation at distance 0 [m]."""
    fraction: NonNegativeFloat = 0.002
    """its growth over distance [1]."""


class WallsIgnored(Frozen):
    """Radio passes through walls unchanged."""

    kind: Literal["none"] = "none"


class WallsBias(Frozen):
    """Each wall in the line of sight lengthens a range; not the wall that holds the anchor."""

    kind: Literal["bias"]
    per_wall: NonNegativeFloat = 0.3
    """how much longer a wall makes it [m]."""


class WallsBlock(Frozen):
    """A wall in the line of sight blocks a range; not the wall that holds the anchor."""

    kind: Literal["block"]


class WallsExcess(Frozen):
    """Each wall in the line of sight lengthens a range by an exponential length; not the wall that holds the anchor.

    The length of each anchor's ranges changes slowly, so that they come out too long in bursts: for as long as there is
    a wall between.
    """

    kind: Literal["excess"]
    mean: NonNegativeFloat = 0.3
    """of the length that a wall adds [m]; its standard deviation is the same, its skewness 2."""
    time: Positive = 1.0
    """correlation time of it [s]."""


RangeNoise = Annotated[ProportionalNoise | ConstantNoise | AffineNoise, Field(discriminator="kind")]
WallEffect = Annotated[WallsIgnored | WallsBias | WallsBlock | WallsExcess, Field(discriminator="kind")]


class UwbSetup(SensorSetup):
    """The uwb sensor, as the onboard half knows it."""

    link: LinkRate = LinkRate(rate=10.0)
    kind: Literal["ranges", "differences"] = "ranges"
    """'ranges' has a range to each anchor in a message; 'differences' has packets in turn, each with the difference of
    the ranges to two anchors, as a vehicle receives them that only listens (TDoA). Only estimator.kind tight reads
    these."""
    pairs: Pairs = "cycle"
    """the two anchors of each difference: 'cycle' takes each anchor and the next one, 'all' every two in turn."""
    packets: Annotated[float, Field(ge=0.1, le=1e4)] = 300.0
    """differences in a second, evenly spaced [1/s]: a whole number in each message."""
    round: Annotated[float, Field(ge=0.0, le=0.2)] = 0.0
    """how long a round of ranging takes [s]: the anchors are ranged one after the other in n even slots, the last one
    at the message's stamp, so that range i of 0 to n - 1 is (1 - (i + 1) / n) of it older. The onboard half knows that
    and takes each range on to the stamp by the velocity that it believes."""
    behind_walls: Literal["used", "left_out"] | None = None
    """treatment of ranges that, by the map and the estimate, pass a wall: they are 'used' as any other, or 'left_out'.
    null leaves them out where the scenario's walls lengthen ranges: that they do is known to who flies there, by how
    much is not."""

    def ages(self, n: int) -> np.ndarray:
        """Return by how much each of n ranges is older than its message's stamp (n) [s]."""
        return self.round * (1.0 - np.arange(1, n + 1) / n)

    def rows(self, h: float) -> int:
        """Return the number of differences in a message, with ticks of h [s]."""
        return round(self.packets * self.link.every(h) * h)


class Uwb(UwbSetup):
    """UWB ranging to the room's anchors; by default the authors' simulator: 10 Hz, sd 0.0075 d, no walls."""

    link: Link = Link(rate=10.0)
    """rate and delivery of its messages."""
    noise: RangeNoise = ProportionalNoise()
    """noise of each range, where errors are white."""
    errors: Literal["white", "fitted"] = "white"
    """'white' draws `noise` anew for each range; 'fitted' draws the errors fitted to recordings: each anchor's
    constant, lasting errors, white noise, outliers and their bursts, missing ranges."""
    file: FileName | None = None
    """NOISE.yaml of `ortilo fit`, or one that comes with the package, iasl_2023 or util_2021; its errors of the ranges
    become `fitted`. A path is relative as a room's is."""
    fitted: UwbNoise | None = None
    """the values of errors 'fitted'."""
    walls: WallEffect = WallsIgnored()
    """what walls in the line of sight do to a range."""
    max_distance: Positive = 100.0
    """farther anchors give no range [m]."""

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
