"""Settings of the paper's estimator: models of noise, forces and biases, and the robust form."""

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, NonNegativeFloat, PlainSerializer

from ortilo_drake.model.typed_yaml import Frozen, Positive, as_pairs
from ortilo_drake.model.white_noise import USUAL_ROOT, white_sd
from ortilo_drake.scenario.onboard import Gate, PositiveVec3


class HuberWeight(Frozen):
    """Huber's weight: beyond a distance c from the prediction, a value weighs less the farther it is."""

    kind: Literal["huber"] = "huber"
    c: Annotated[float, Field(ge=0.1, le=100.0)] = 4.0
    """Mahalanobis distance of a value from its prediction up to which it has full weight [1]; beyond, at distance d,
    its covariance is multiplied by d / c."""


class StudentWeight(Frozen):
    """The weight of Student's t distribution, whose tails are heavier than the Gaussian's."""

    kind: Literal["student_t"]
    dof: Annotated[float, Field(ge=1.0, le=1000.0)] = 5.0
    """degrees of freedom nu [1]; the covariance of a value with m rows at Mahalanobis distance d is multiplied by
    (nu + d^2) / (nu + m) if this factor is more than 1."""


class Adaptation(Frozen):
    """Measurement noise that grows while innovations are larger than their assumed covariance explains."""

    time: Positive = 5.0
    """averaging time of the squared Mahalanobis distance per row of accepted values [s]."""
    tolerates: Annotated[float, Field(ge=1.0, le=100.0)] = 2.0
    """average up to which the noise is left unchanged [1]; the average is 1 if the assumed noise is right."""
    most: Annotated[float, Field(ge=1.0, le=1e4)] = 16.0
    """largest factor on a covariance [1]."""


class Opening(Frozen):
    """Growth of the estimate's covariance when the filter stops trusting the estimate: standard deviations per axis."""

    position: NonNegativeFloat = 0.5
    """standard deviation added to the position [m]."""
    angle: NonNegativeFloat = 0.1
    """standard deviation added to roll, pitch and yaw [rad]."""
    velocity: NonNegativeFloat = 0.3
    """standard deviation added to the velocity [m/s]."""
    rate: NonNegativeFloat = 0.1
    """standard deviation added to the Euler rates [rad/s]."""
    gyroscope: NonNegativeFloat = 0.01
    """standard deviation added to the gyroscope's bias, if it is estimated [rad/s]."""


class Robust(Frozen):
    """The filter's treatment of values beyond their assumed noise; values within it are not affected."""

    gate: Gate = 0.999999
    """probability that a correct value is used [1]: a value is rejected if its squared Mahalanobis distance from the
    filter's prediction exceeds the chi-square quantile."""
    weight: Annotated[HuberWeight | StudentWeight, Field(discriminator="kind")] = HuberWeight()
    """weight of values within the gate."""
    adaptation: Adaptation | None = Adaptation()
    """adaptation of each sensor's assumed noise to its innovations; null for none."""
    reacquire_after: Annotated[float, Field(ge=0.1, le=60.0)] = 1.0
    """time [s] after which a rejected sensor is trusted more than the estimate, if no other sensor that measures the
    same was used meanwhile: the estimate's covariance is then increased by `opening`."""
    opening: Opening = Opening()
    """increase of the estimate's covariance when a sensor is reacquired."""
    drift: Annotated[float, Field(ge=0.1, le=60.0)] | None = 1.0
    """averaging time of the innovations of the imu's angles [s]; if their mean differs from 0, tested with the gate's
    probability, the gyroscope's bias is estimated anew. Only with rates 'measured'; null for no such test."""
    stuck: Annotated[int, Field(ge=2, le=1000)] | None = 3
    """number of successive messages with the same content [1] after which a sensor counts as stuck; it is ignored until
    its values change. null for no such test."""


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
    """variances of roll, pitch and yaw [rad^2]. All variances of the imu are for a sample every 1/30 s; for a sample
    every T seconds the filter uses 1 / (30 T) of them."""
    specific_force: PositiveVec3 = (2.5e-3, 2.5e-3, 2.5e-3)
    """variances of the imu's specific force per axis [m^2/s^4]; read with force 'measured'."""
    rates: PositiveVec3 = (1.0e-6, 1.0e-6, 1.0e-6)
    """variances of the imu's body rates per axis [rad^2/s^2]; read with rates 'measured'."""


class DisturbanceW(Frozen):
    """W = Gamma_d diag(force^2, torque^2) Gamma_d^T / h for a white disturbance that is held over each tick h."""

    kind: Literal["disturbance"] = "disturbance"
    force_density: Positive = 0.27 * USUAL_ROOT
    """noise density of the force per axis [N/sqrt(Hz)]; the default is 0.27 N in a tick of 1/30 s."""
    torque_density: Positive = 0.005 * USUAL_ROOT
    """noise density of the torque per axis [N m/sqrt(Hz)]; the default is 0.005 N m in a tick of 1/30 s."""

    def sds(self, h: float) -> tuple[float, float]:
        """Return the standard deviations of force [N] and torque [N m] in a tick of h [s]."""
        return white_sd(self.force_density, h), white_sd(self.torque_density, h)


class DiagonalW(Frozen):
    """A diagonal W, with a variance for each group of states in a tick of 1/30 s; a tick h [s] has 30 h times these."""

    kind: Literal["diagonal"]
    position: NonNegativeFloat
    """variance of x, y, z [m^2]."""
    angle: NonNegativeFloat
    """variance of roll, pitch, yaw [rad^2]."""
    velocity: NonNegativeFloat
    """variance of the velocity [m^2/s^2]."""
    rate: NonNegativeFloat
    """variance of the Euler rates [rad^2/s^2]."""


class Walks(Frozen):
    """The random walks of force, torque and sensor biases, which start about 0; see estimator.force."""

    force_sd: NonNegativeFloat = 1.5
    """initial standard deviation of the disturbance force per axis [N]."""
    force_rate: NonNegativeFloat = 0.011
    """random walk of the force: standard deviation of its change over the square root of time [N/s^(1/2)]."""
    torque_sd: NonNegativeFloat = 0.0
    """initial standard deviation of the disturbance torque in B [N m], for example from a wrong centre of gravity; with
    0 the filter estimates no torque."""
    torque_rate: NonNegativeFloat = 0.0001
    """random walk of the torque, as force_rate [N m/s^(1/2)]."""
    accelerometer_sd: NonNegativeFloat = 0.2
    """initial standard deviation of the specific force's bias per axis [m/s^2]; not read after a standstill."""
    accelerometer_rate: NonNegativeFloat = 0.0005
    """random walk of the specific force's bias, as force_rate [m/s^(5/2)]."""
    gyroscope_sd: NonNegativeFloat = 0.0003
    """initial standard deviation of the body rates' bias per axis [rad/s]; read with rates 'measured' and without a
    standstill (imu.standstill)."""
    gyroscope_rate: NonNegativeFloat = 1.0e-5
    """random walk of the body rates' bias, as force_rate [rad/s^(3/2)]."""


class Biases(Frozen):
    """Slow errors with known standard deviations; the filter estimates those whose sd is not 0.

    Each varies as a stationary first-order Gauss-Markov process.
    """

    uwb_sd: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (0.0, 0.0, 0.0)
    """bias of uwb fixes per axis [m], from errors of the anchors' survey and of ranges."""
    camera_sd: tuple[NonNegativeFloat, NonNegativeFloat, NonNegativeFloat] = (0.0, 0.0, 0.0)
    """bias of camera fixes per axis [m], from errors of the landmarks' survey and of the camera's attitude."""
    level_sd: NonNegativeFloat = 0.0
    """bias of the imu's roll and pitch [rad]; only a fix with method 'pose' can distinguish it from a force."""
    yaw_sd: NonNegativeFloat = 0.0
    """bias of the imu's yaw [rad]; observable through fixes with method 'known_tilt' or 'pose'."""
    row_sd: RowSds = Field(default={}, validate_default=True)
    """lasting error of any other row of y by its name, such as {z_alt: 0.02} [its unit], for sensors of your own."""
    uwb_time: Positive = 20.0
    """correlation time of the uwb fixes' bias [s], about as long as the same anchors are near."""
    camera_time: Positive = 20.0
    """correlation time of the camera fixes' bias [s], about as long as the filter's attitude error lasts or the same
    landmarks are in view."""
    imu_time: Positive = 300.0
    """correlation time of the imu's biases [s]."""
    row_time: Positive = 20.0
    """correlation time of the errors in row_sd [s]."""


class IntermittentFilter(Frozen):
    """The paper's estimator: fixes, their gates, and the intermittent Kalman filter."""

    kind: Literal["intermittent"] = "intermittent"
    W: Annotated[DisturbanceW | DiagonalW, Field(discriminator="kind")] = DisturbanceW()
    """process noise covariance."""
    V: Noise = Noise()
    """measurement noise."""
    initial_sd: tuple[InitialSd, InitialSd, InitialSd, InitialSd] = (0.05, 0.02, 0.05, 0.05)
    """standard deviations of the initial position [m], angles [rad], velocity [m/s] and Euler rates [rad/s]; the start
    of a flight has no such error, so NEES starts at 0."""
    delay: Literal["ignore", "drop", "replay"] = "ignore"
    """treatment of late measurements. 'ignore' uses them as if they were current. 'drop' does the same, but only up to
    one tick of age, the latency of a detector. 'replay' uses them at their stamp and repeats the filter from there."""
    horizon: Annotated[float, Field(gt=0.0, le=2.0)] = 0.5
    """greatest age of a measurement that 'replay' uses [s]; older measurements are not used."""
    integrator: Literal["literal", "hold", "estimate"] = "hold"
    """'literal' and 'hold' integrate r minus the measured position, as printed, and are part of the filter's model; if
    no fix arrives, 'literal' integrates r itself and 'hold' stops. 'estimate' integrates r - xhat, as in the authors'
    code."""
    force: Literal["none", "thrust", "measured"] = "none"
    """estimation of the disturbance force, which includes the effects of a wrong mass and a tilted imu. 'none', as in
    the paper: no estimate. 'thrust': from fixes, thrust and attitude. 'measured': also from the imu's specific force,
    whose bias the filter then estimates. The servo counteracts the force."""
    rates: Literal["none", "measured"] = "none"
    """'measured' also uses the imu's body rates and estimates their bias; only with force 'measured'. 'none', as in the
    paper, uses only the angles."""
    walks: Walks = Walks()
    """random walks of the force and of the biases of accelerometer and gyroscope."""
    biases: Biases = Biases()
    """slow errors of fixes and angles that the filter also estimates; only with force 'thrust' or 'measured'. The gates
    ignore them."""
    gates: Gates = Field(default={}, validate_default=True)
    """probability [1] by sensor, such as {uwb: 0.99}. A fix is ignored if its squared Mahalanobis distance from the
    filter's prediction exceeds the chi-square quantile of its sensor's gate. A sensor without a gate is not tested."""
    robust: Robust | None = None
    """protection against wrong measurements: gates, weights, re-acquisition, noise that follows the innovations, stuck
    sensors. {} has all of them; null, as in the paper, has none."""
