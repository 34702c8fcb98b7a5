"""Settings of the paper's estimator: its models of noise, forces and biases, and the robust form."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, NonNegativeFloat, PlainSerializer

from ortilo_drake.model.typed_yaml import Frozen, Positive, as_pairs
from ortilo_drake.model.white_noise import USUAL_ROOT, white_sd
from ortilo_drake.scenario.onboard import Gate, PositiveVec3


class HuberWeight(Frozen):
    """Huber's weight: a value weighs less the farther it is, from some distance on."""

    kind: Literal["huber"] = "huber"
    c: Annotated[float, Field(ge=0.1, le=100.0)] = 4.0
    """Mahalanobis distance d of a value from its prediction up to which it weighs in full; beyond, its covariance is
    taken d / c times as large [1]."""


class StudentWeight(Frozen):
    """The weight of Student's t distribution, whose tails are longer than the Gaussian's."""

    kind: Literal["student_t"]
    dof: Annotated[float, Field(ge=1.0, le=1000.0)] = 5.0
    """degrees of freedom nu; the covariance of a value of m rows is taken (nu + d^2) / (nu + m) times as large where
    that is more than 1 [1]."""


class Adaptation(Frozen):
    """Noise that is taken for larger while innovations are larger than believed."""

    time: Positive = 5.0
    """over which the squared Mahalanobis distance of accepted values, per row, is averaged [s]."""
    tolerates: Annotated[float, Field(ge=1.0, le=100.0)] = 2.0
    """average up to which the noise stays what it is believed to be [1]; it is 1 where all is right."""
    most: Annotated[float, Field(ge=1.0, le=1e4)] = 16.0
    """factor on a covariance at most [1]."""


class Opening(Frozen):
    """By how much the filter believes its estimate less where it is opened; standard deviations per axis."""

    position: NonNegativeFloat = 0.5
    """[m]."""
    angle: NonNegativeFloat = 0.1
    """of roll, pitch and yaw [rad]."""
    velocity: NonNegativeFloat = 0.3
    """[m/s]."""
    rate: NonNegativeFloat = 0.1
    """of the Euler rates [rad/s]."""
    gyroscope: NonNegativeFloat = 0.01
    """of the gyroscope's bias, where it is estimated [rad/s]."""


class Robust(Frozen):
    """The filter's treatment of values beyond their believed noise; no effect on values within it."""

    gate: Gate = 0.999999
    """probability that a correct value is used [1]: a value is rejected if its squared Mahalanobis distance from the
    filter's prediction exceeds the chi-square quantile."""
    weight: Annotated[HuberWeight | StudentWeight, Field(discriminator="kind")] = HuberWeight()
    """how much values within the gate count."""
    adaptation: Adaptation | None = Adaptation()
    """how the believed noise of each sensor follows its innovations; null keeps it."""
    reacquire_after: Annotated[float, Field(ge=0.1, le=60.0)] = 1.0
    """if a sensor was rejected for so long [s], and no other that measures the same was used, it is trusted more than
    the estimate: the estimate's covariance is increased."""
    opening: Opening = Opening()
    """by how much."""
    drift: Annotated[float, Field(ge=0.1, le=60.0)] | None = 1.0
    """time over which innovations of the imu's angles are averaged [s]; if their mean is not 0, by the gate's
    probability, the gyroscope's bias is estimated anew. Only with rates 'measured'; null for no such test."""
    stuck: Annotated[int, Field(ge=2, le=1000)] | None = 3
    """after so many messages [1] in a row with the same content a sensor counts as stuck; it is ignored until its
    values change. null for no such test."""


InitialSd = Annotated[float, Field(ge=1e-6, le=1e3)]


# Mappings in a file, kept as pairs such as (sensor, probability).
_AsDict = PlainSerializer(dict, return_type=dict[str, float])
Gates = Annotated[dict[str, Gate], AfterValidator(as_pairs), _AsDict]
RowSds = Annotated[dict[str, Positive], AfterValidator(as_pairs), _AsDict]


class Noise(Frozen):
    """The filter's measurement noise V.

    A position sensor set to null takes its covariance from each fix: geometry and sensor noise.
    """

    uwb: PositiveVec3 | None = None
    """variances of a uwb fix per axis [m^2]."""
    camera: PositiveVec3 | None = None
    """variances of a camera fix per axis [m^2]."""
    imu: PositiveVec3 = (1.0e-4, 1.0e-4, 1.0e-4)
    """variances of roll, pitch and yaw [rad^2], as those below of a sample every 1/30 s; a sample every T seconds is
    believed to have 1 / (30 T) of them."""
    specific_force: PositiveVec3 = (2.5e-3, 2.5e-3, 2.5e-3)
    """variances of the imu's specific force per axis [m^2/s^4]; read with force 'measured'."""
    rates: PositiveVec3 = (1.0e-6, 1.0e-6, 1.0e-6)
    """variances of the imu's body rates per axis [rad^2/s^2]; read with rates 'measured'."""


class DisturbanceW(Frozen):
    """W = Gamma_d diag(force^2, torque^2) Gamma_d^T / h of a white disturbance held over each tick h."""

    kind: Literal["disturbance"] = "disturbance"
    force_density: Positive = 0.27 * USUAL_ROOT
    """of the force per axis [N/sqrt(Hz)]; the default is 0.27 N in a tick of 1/30 s."""
    torque_density: Positive = 0.005 * USUAL_ROOT
    """of the torque per axis [N m/sqrt(Hz)]; the default is 0.005 N m in a tick of 1/30 s."""

    def sds(self, h: float) -> tuple[float, float]:
        """Return the standard deviations of force [N] and torque [N m] in a tick [s]."""
        return white_sd(self.force_density, h), white_sd(self.torque_density, h)


class DiagonalW(Frozen):
    """W diagonal, a variance for each group of states in a tick of 1/30 s; a tick h has 30 h of it."""

    kind: Literal["diagonal"]
    position: NonNegativeFloat
    """of x, y, z [m^2]."""
    angle: NonNegativeFloat
    """of roll, pitch, yaw [rad^2]."""
    velocity: NonNegativeFloat
    """of the velocity [m^2/s^2]."""
    rate: NonNegativeFloat
    """of the Euler rates [rad^2/s^2]."""


class Walks(Frozen):
    """The random walks of force, torque and accelerometer bias, about 0 at first; see estimator.force."""

    force_sd: NonNegativeFloat = 1.5
    """standard deviation of the disturbance force per axis at first [N]."""
    force_rate: NonNegativeFloat = 0.011
    """of its change, times the square root of the time that it takes [N/s^(1/2)]."""
    torque_sd: NonNegativeFloat = 0.0
    """of the disturbance torque in B at first [N m], for example from a wrong centre of gravity; with 0 the filter
    estimates none."""
    torque_rate: NonNegativeFloat = 0.0001
    """of its change, likewise [N m/s^(1/2)]."""
    accelerometer_sd: NonNegativeFloat = 0.2
    """of the bias of the specific force per axis at first [m/s^2]; not read after a standstill."""
    accelerometer_rate: NonNegativeFloat = 0.0005
    """of its change, likewise [m/s^(5/2)]."""
    gyroscope_sd: NonNegativeFloat = 0.0003
    """of the bias of the body rates per axis at first [rad/s]; read with rates 'measured' and without a standstill,
    imu.standstill."""
    gyroscope_rate: NonNegativeFloat = 1.0e-5
    """of its change, likewise [rad/s^(3/2)]."""


class Biases(Frozen):
    """Slow errors with known standard deviations; the filter estimates those whose sd is not 0.

    Each varies as a stationary first-order Gauss-Markov process.
    """

    uwb_sd: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (0.0, 0.0, 0.0)
    """standard deviation of a bias of uwb fixes per axis [m]: survey of the anchors, ranges."""
    camera_sd: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (0.0, 0.0, 0.0)
    """of camera fixes per axis [m]: survey of the landmarks, attitude of the camera."""
    level_sd: NonNegativeFloat = 0.0
    """of the imu's roll and pitch [rad]; only a fix with method 'pose' tells it from a force."""
    yaw_sd: NonNegativeFloat = 0.0
    """of the imu's yaw [rad]; seen by fixes with method 'known_tilt' or 'pose'."""
    row_sd: RowSds = Field(default={}, validate_default=True)
    """lasting error of any other row of y by its name, such as {z_alt: 0.02} [its unit], for sensors of your own."""
    uwb_time: Positive = 20.0
    """correlation time of the uwb fixes' bias [s], about as long as the same anchors are near."""
    camera_time: Positive = 20.0
    """of the camera fixes' [s]: that of the filter's attitude error, or of the same landmarks in view."""
    imu_time: Positive = 300.0
    """of the imu's biases [s]."""
    row_time: Positive = 20.0
    """of those in row_sd [s]."""


class IntermittentFilter(Frozen):
    """The paper's estimator: fixes, their gates, and the intermittent Kalman filter."""

    kind: Literal["intermittent"] = "intermittent"
    W: Annotated[DisturbanceW | DiagonalW, Field(discriminator="kind")] = DisturbanceW()
    """process noise covariance."""
    V: Noise = Noise()
    """measurement noise."""
    initial_sd: tuple[InitialSd, InitialSd, InitialSd, InitialSd] = (0.05, 0.02, 0.05, 0.05)
    """standard deviations of its initial position [m], angles [rad], velocity [m/s] and Euler rates [rad/s]; flights
    start without one, so NEES starts at 0."""
    delay: Literal["ignore", "drop", "replay"] = "ignore"
    """how late measurements are used. 'ignore' uses them as if they were current; 'drop' does too, but none older than
    one tick, which a detector itself takes; 'replay' uses them at their stamp and runs the filter again from there."""
    horizon: Annotated[float, Field(gt=0.0, le=2.0)] = 0.5
    """how far back 'replay' goes [s]; older measurements are not used."""
    integrator: Literal["literal", "hold", "estimate"] = "hold"
    """'literal' and 'hold' integrate r less the measured position, as printed, and are part of the filter's model;
    where no fix arrived 'literal' integrates r itself, 'hold' keeps still. 'estimate' integrates r - xhat, as in the
    authors' code."""
    force: Literal["none", "thrust", "measured"] = "none"
    """how the filter estimates the disturbance force, which includes the effects of a wrong mass and a tilted imu.
    'none', as in the paper: not at all. 'thrust': from fixes, thrust and attitude. 'measured': from the imu's specific
    force as well, whose bias it estimates. The servo counters the force."""
    rates: Literal["none", "measured"] = "none"
    """'measured' uses the imu's body rates as well, whose bias it estimates; only with force 'measured'. 'none', as in
    the paper, uses the angles alone."""
    walks: Walks = Walks()
    """how force and the biases of accelerometer and gyroscope vary."""
    biases: Biases = Biases()
    """errors of fixes and yaw that the filter estimates as well; only with force 'thrust' or 'measured'. The gates do
    not know of them."""
    gates: Gates = Field(default={}, validate_default=True)
    """probability [1] by sensor, such as {uwb: 0.99}. A fix is ignored if its squared Mahalanobis distance from the
    filter's prediction exceeds the chi-square quantile of its sensor's gate; no gate, no such test."""
    robust: Robust | None = None
    """protection against wrong measurements: gates, weights, re-acquisition, noise that follows the innovations, stuck
    sensors. {} has all of them; null, as in the paper, none."""
