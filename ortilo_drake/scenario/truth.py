"""The world's differences from the onboard half's belief.

All other settings are what a team believes and configures: the vehicle, the surveyed room, the sensors. Each entry here
is a difference of the world from that belief: a number that is added, or a factor. The entry of the same name with _sd
is the standard deviation of a number that the seed draws and adds to the entry. By default nothing differs. The onboard
half sees none of this (belief.py); docs/truths.md has the equations.
"""

from typing import Annotated, NamedTuple

from pydantic import AfterValidator, Field, PlainSerializer

from ortilo_drake.model.typed_yaml import Frozen, Positive, as_pairs

Number = Annotated[float, Field(ge=-100.0, le=100.0)]
Sd = Annotated[float, Field(ge=0.0, le=100.0)]
Factor = Annotated[float, Field(ge=0.5, le=2.0)]
FactorSd = Annotated[float, Field(ge=0.0, le=0.2)]
Pair = tuple[Number, Number]
Triple = tuple[Number, Number, Number]


class Each(NamedTuple):
    """The mark of a field that is drawn for each of the room's `things`: 'anchors' or 'landmarks'."""

    things: str


class VehicleTruth(Frozen):
    """Differences of body and rotors."""

    mass_factor: Factor = 1.0
    """true over believed mass [1]; 1.03 is 3 % heavier than believed."""
    mass_factor_sd: FactorSd = 0.0
    """standard deviation of the drawn part of mass_factor [1]."""
    inertia_factor: Factor = 1.0
    """true over believed moments of inertia [1]."""
    inertia_factor_sd: FactorSd = 0.0
    """standard deviation of the drawn part of inertia_factor [1]."""
    thrust_factor: Factor = 1.0
    """true over believed lift of the rotors [1]; it scales the thrust and the torques of roll and pitch."""
    thrust_factor_sd: FactorSd = 0.0
    """standard deviation of the drawn part of thrust_factor [1]."""
    center_of_gravity: Pair = (0.0, 0.0)
    """true minus believed center of gravity, x (ahead) and y (left) in B [m]."""
    center_of_gravity_sd: Sd = 0.0
    """standard deviation of the drawn part of each coordinate [m]."""


class ForceTruth(Frozen):
    """A lasting force in W, in addition to the scenario's white disturbance."""

    mean: Triple = (0.0, 0.0, 0.0)
    """constant part of the force [N]."""
    mean_sd: Sd = 0.0
    """standard deviation of the drawn part of each component of mean [N]."""
    gust_sd: Sd = 0.0
    """standard deviation per axis of the changing part of the force, first-order Gauss-Markov noise [N]."""
    gust_time: Positive = 2.0
    """correlation time of the changing part [s]."""


class ImuTruth(Frozen):
    """Errors of the IMU's angles, rates and specific force, in addition to their white noise."""

    level: Pair = (0.0, 0.0)
    """bias of roll and pitch [rad]."""
    level_sd: Sd = 0.0
    """standard deviation of the drawn part of each bias [rad]."""
    level_walk: Sd = 0.0
    """random walk of roll and pitch, its standard deviation after 1 s [rad]."""
    yaw: Number = 0.0
    """bias of the yaw [rad]."""
    yaw_sd: Sd = 0.0
    """standard deviation of the drawn part of the bias [rad]."""
    yaw_walk: Sd = 0.0
    """random walk of the yaw, its standard deviation after 1 s [rad]."""
    angles_factor: Factor = 1.0
    """scale factor of the angles [1]."""
    angles_factor_sd: FactorSd = 0.0
    """standard deviation of the drawn part of angles_factor [1]."""
    rates: Triple = (0.0, 0.0, 0.0)
    """bias of the body rates [rad/s]."""
    rates_sd: Sd = 0.0
    """standard deviation of the drawn part of each bias [rad/s]."""
    rates_walk: Sd = 0.0
    """random walk of the body rates, its standard deviation after 1 s [rad/s]."""
    rates_factor: Factor = 1.0
    """scale factor of the body rates [1]."""
    rates_factor_sd: FactorSd = 0.0
    """standard deviation of the drawn part of rates_factor [1]."""
    specific_force: Triple = (0.0, 0.0, 0.0)
    """bias of the specific force [m/s^2]."""
    specific_force_sd: Sd = 0.0
    """standard deviation of the drawn part of each bias [m/s^2]."""
    specific_force_walk: Sd = 0.0
    """random walk of the specific force, its standard deviation after 1 s [m/s^2]."""
    specific_force_factor: Factor = 1.0
    """scale factor of the specific force [1]."""
    specific_force_factor_sd: FactorSd = 0.0
    """standard deviation of the drawn part of specific_force_factor [1]."""


class UwbTruth(Frozen):
    """Errors of the ranges, in addition to their white noise."""

    bias: Annotated[Number, Each("anchors")] = 0.0
    """length added to every range [m]."""
    bias_sd: Sd = 0.0
    """standard deviation of the part of bias that is drawn for each anchor [m]."""
    factor: Factor = 1.0
    """scale factor of all ranges [1]."""
    factor_sd: FactorSd = 0.0
    """standard deviation of the drawn part of factor [1]."""
    slow_sd: Sd = 0.0
    """standard deviation of added first-order Gauss-Markov noise, independent for each anchor [m]."""
    slow_time: Positive = 2.0
    """correlation time of the Gauss-Markov noise [s]."""


class SensorTruth(Frozen):
    """Errors of a registered sensor, in addition to its noise, for each number of its payload in that number's unit.

    Each list is as long as the payload; an empty list stands for no such error.
    """

    bias: Annotated[tuple[Number, ...], Field(max_length=64)] = ()
    """bias of each number."""
    bias_sd: Annotated[tuple[Sd, ...], Field(max_length=64)] = ()
    """standard deviation of the drawn part of each bias."""
    factor: Annotated[tuple[Factor, ...], Field(max_length=64)] = ()
    """scale factor of each number [1]."""
    factor_sd: Annotated[tuple[FactorSd, ...], Field(max_length=64)] = ()
    """standard deviation of the drawn part of each factor [1]."""
    slow_sd: Annotated[tuple[Sd, ...], Field(max_length=64)] = ()
    """standard deviation of first-order Gauss-Markov noise that is added to each number."""
    slow_time: Positive = 2.0
    """correlation time of the Gauss-Markov noise [s]."""


class SurveyTruth(Frozen):
    """Survey errors: the true minus the surveyed positions, which the room's file holds, of anchors and landmarks."""

    anchors: Annotated[Triple, Each("anchors")] = (0.0, 0.0, 0.0)
    """vector from the surveyed to the true position of every anchor in W [m]."""
    anchors_sd: Sd = 0.0
    """standard deviation of the part of anchors that is drawn for each anchor and axis [m]."""
    landmarks: Annotated[Triple, Each("landmarks")] = (0.0, 0.0, 0.0)
    """vector from the surveyed to the true position of every landmark in W [m]."""
    landmarks_sd: Sd = 0.0
    """standard deviation of the part of landmarks that is drawn for each landmark and axis [m]."""


class CameraTruth(Frozen):
    """Errors of the camera's mounting and lens."""

    position: Triple = (0.0, 0.0, 0.0)
    """vector from the believed to the true position of the camera in B [m]."""
    position_sd: Sd = 0.0
    """standard deviation of the drawn part of each coordinate [m]."""
    angles: Triple = (0.0, 0.0, 0.0)
    """roll, pitch and yaw by which the camera is turned about its own centre from looking ahead [rad]."""
    angles_sd: Sd = 0.0
    """standard deviation of the drawn part of each angle [rad]."""
    focal_factor: Factor = 1.0
    """true over believed focal length [1]."""
    focal_factor_sd: FactorSd = 0.0
    """standard deviation of the drawn part of focal_factor [1]."""


class ClockTruth(Frozen):
    """Errors of the sensors' clocks; each sensor but the imu has its own clock, apart from the onboard computer's."""

    offset: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    """age of a measurement beyond its stamp at the start of the flight [s]."""
    offset_sd: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    """standard deviation of the part of offset that is drawn for each sensor [s]."""
    drift: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 0.0
    """growth of the offset per second [1]."""
    drift_sd: Annotated[float, Field(ge=0.0, le=1e-3)] = 0.0
    """standard deviation of the part of drift that is drawn for each sensor [1]."""


class StartTruth(Frozen):
    """Errors of the start; the filter's first estimate is the start of the path, under the held heading."""

    position: Triple = (0.0, 0.0, 0.0)
    """vector from the believed to the true start in W [m]."""
    position_sd: Sd = 0.0
    """standard deviation of the drawn part of each coordinate [m]."""
    yaw: Number = 0.0
    """true minus believed yaw at the start [rad]."""
    yaw_sd: Sd = 0.0
    """standard deviation of the drawn part of yaw [rad]."""


SensorTruths = Annotated[
    dict[str, SensorTruth], AfterValidator(as_pairs), PlainSerializer(dict, return_type=dict[str, SensorTruth])
]


class Truth(Frozen):
    """The world's differences from the onboard half's belief."""

    vehicle: VehicleTruth = VehicleTruth()
    """errors of mass, inertia, thrust and center of gravity."""
    force: ForceTruth = ForceTruth()
    """a lasting force on the body."""
    imu: ImuTruth = ImuTruth()
    """errors of angles, rates and specific force."""
    uwb: UwbTruth = UwbTruth()
    """errors of ranges."""
    sensors: SensorTruths = Field(default={}, validate_default=True)
    """errors of registered sensors that fly, by the sensor's name."""
    survey: SurveyTruth = SurveyTruth()
    """survey errors of anchors and landmarks."""
    camera: CameraTruth = CameraTruth()
    """errors of the camera's mounting and lens."""
    clock: ClockTruth = ClockTruth()
    """errors of the sensors' clocks."""
    start: StartTruth = StartTruth()
    """errors of the first estimate."""
