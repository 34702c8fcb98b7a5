"""The world's differences from the onboard half's belief.

All other settings are what a team believes and configures: its vehicle, its surveyed room, its sensors. Each entry here
is the world's difference from that: a number that is added, or a factor. The same name with _sd is the standard
deviation of a number that the seed draws and adds to it. By default nothing differs. The onboard half sees none of
this, see belief.py; docs/truths.md has the equations.
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
    """A field's mark: it is drawn for each of the room's `things`, its 'anchors' or 'landmarks'."""

    things: str


class VehicleTruth(Frozen):
    """The body and its rotors."""

    mass_factor: Factor = 1.0
    """true over believed mass [1]; 1.03 is 3 % heavier than believed."""
    mass_factor_sd: FactorSd = 0.0
    """spread of that [1]."""
    inertia_factor: Factor = 1.0
    """true over believed moments of inertia [1]."""
    inertia_factor_sd: FactorSd = 0.0
    """spread of that [1]."""
    thrust_factor: Factor = 1.0
    """true over believed lift of the rotors [1], which makes thrust and the torques of roll and pitch."""
    thrust_factor_sd: FactorSd = 0.0
    """spread of that [1]."""
    center_of_gravity: Pair = (0.0, 0.0)
    """where it is, ahead and to the left of where it is believed to be [m]."""
    center_of_gravity_sd: Sd = 0.0
    """spread of each of them [m]."""


class ForceTruth(Frozen):
    """A force in W that lasts, beside the scenario's white disturbance."""

    mean: Triple = (0.0, 0.0, 0.0)
    """its constant part [N]."""
    mean_sd: Sd = 0.0
    """spread of each of its components [N]."""
    gust_sd: Sd = 0.0
    """standard deviation of its changing part per axis, first-order Gauss-Markov noise [N]."""
    gust_time: Positive = 2.0
    """correlation time of that [s]."""


class ImuTruth(Frozen):
    """Errors of the imu's angles, rates and specific force, beside their white noise."""

    level: Pair = (0.0, 0.0)
    """added to roll and pitch [rad]."""
    level_sd: Sd = 0.0
    """spread of each of them [rad]."""
    level_walk: Sd = 0.0
    """random walk of them, its standard deviation after 1 s [rad]."""
    yaw: Number = 0.0
    """added to the yaw [rad]."""
    yaw_sd: Sd = 0.0
    """spread of that [rad]."""
    yaw_walk: Sd = 0.0
    """random walk of it, its standard deviation after 1 s [rad]."""
    angles_factor: Factor = 1.0
    """factor of the angles [1]."""
    angles_factor_sd: FactorSd = 0.0
    """spread of that [1]."""
    rates: Triple = (0.0, 0.0, 0.0)
    """added to the body rates [rad/s]."""
    rates_sd: Sd = 0.0
    """spread of each of them [rad/s]."""
    rates_walk: Sd = 0.0
    """random walk of them, its standard deviation after 1 s [rad/s]."""
    rates_factor: Factor = 1.0
    """factor of the body rates [1]."""
    rates_factor_sd: FactorSd = 0.0
    """spread of that [1]."""
    specific_force: Triple = (0.0, 0.0, 0.0)
    """added to the specific force [m/s^2]."""
    specific_force_sd: Sd = 0.0
    """spread of each of its components [m/s^2]."""
    specific_force_walk: Sd = 0.0
    """random walk of them, its standard deviation after 1 s [m/s^2]."""
    specific_force_factor: Factor = 1.0
    """factor of the specific force [1]."""
    specific_force_factor_sd: FactorSd = 0.0
    """spread of that [1]."""


class UwbTruth(Frozen):
    """Errors of the ranges, beside their white noise."""

    bias: Annotated[Number, Each("anchors")] = 0.0
    """added to every range [m]."""
    bias_sd: Sd = 0.0
    """spread of that, drawn for each anchor [m]."""
    factor: Factor = 1.0
    """factor of all ranges [1]."""
    factor_sd: FactorSd = 0.0
    """spread of that [1]."""
    slow_sd: Sd = 0.0
    """standard deviation of first-order Gauss-Markov noise that is added, each anchor's its own [m]."""
    slow_time: Positive = 2.0
    """correlation time of that [s]."""


class SensorTruth(Frozen):
    """Errors of a registered sensor, beside its noise, for each number of its payload, in that number's unit.

    A list is as long as the payload; an empty one stands for no such error.
    """

    bias: Annotated[tuple[Number, ...], Field(max_length=64)] = ()
    """added to each."""
    bias_sd: Annotated[tuple[Sd, ...], Field(max_length=64)] = ()
    """spread of each of them."""
    factor: Annotated[tuple[Factor, ...], Field(max_length=64)] = ()
    """factor of each [1]."""
    factor_sd: Annotated[tuple[FactorSd, ...], Field(max_length=64)] = ()
    """spread of each of them [1]."""
    slow_sd: Annotated[tuple[Sd, ...], Field(max_length=64)] = ()
    """standard deviations of first-order Gauss-Markov noise that is added."""
    slow_time: Positive = 2.0
    """correlation time of that [s]."""


class SurveyTruth(Frozen):
    """The true places of anchors and landmarks: the room's file holds the surveyed ones."""

    anchors: Annotated[Triple, Each("anchors")] = (0.0, 0.0, 0.0)
    """from where every anchor was surveyed to where it is [m]."""
    anchors_sd: Sd = 0.0
    """spread of that, drawn for each anchor and axis [m]."""
    landmarks: Annotated[Triple, Each("landmarks")] = (0.0, 0.0, 0.0)
    """from where every landmark was surveyed to where it is [m]."""
    landmarks_sd: Sd = 0.0
    """spread of that, drawn for each landmark and axis [m]."""


class CameraTruth(Frozen):
    """The camera's true mounting and lens."""

    position: Triple = (0.0, 0.0, 0.0)
    """from where it is believed to be to where it is, in B [m]."""
    position_sd: Sd = 0.0
    """spread of each component [m]."""
    angles: Triple = (0.0, 0.0, 0.0)
    """roll, pitch and yaw by which it is turned from looking ahead, about its own centre [rad]."""
    angles_sd: Sd = 0.0
    """spread of each of them [rad]."""
    focal_factor: Factor = 1.0
    """true over believed focal length [1]."""
    focal_factor_sd: FactorSd = 0.0
    """spread of that [1]."""


class ClockTruth(Frozen):
    """The sensors' clocks beside that of imu and onboard computer; each sensor but the imu has one of its own."""

    offset: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    """age of a measurement beyond its stamp at the start [s]."""
    offset_sd: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    """spread of that, drawn for each sensor [s]."""
    drift: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 0.0
    """by how much more in every second [1]."""
    drift_sd: Annotated[float, Field(ge=0.0, le=1e-3)] = 0.0
    """spread of that, drawn for each sensor [1]."""


class StartTruth(Frozen):
    """The vehicle's true start; the filter's first estimate is the start of the path, under the held heading."""

    position: Triple = (0.0, 0.0, 0.0)
    """from where it is believed to start to where it does [m]."""
    position_sd: Sd = 0.0
    """spread of each component [m]."""
    yaw: Number = 0.0
    """true less believed yaw at the start [rad]."""
    yaw_sd: Sd = 0.0
    """spread of that [rad]."""


SensorTruths = Annotated[
    dict[str, SensorTruth], AfterValidator(as_pairs), PlainSerializer(dict, return_type=dict[str, SensorTruth])
]


class Truth(Frozen):
    """The world's differences from the onboard half's belief."""

    vehicle: VehicleTruth = VehicleTruth()
    """the body and its rotors."""
    force: ForceTruth = ForceTruth()
    """a steady force on the body."""
    imu: ImuTruth = ImuTruth()
    """angles, rates and specific force."""
    uwb: UwbTruth = UwbTruth()
    """ranges."""
    sensors: SensorTruths = Field(default={}, validate_default=True)
    """registered sensors, by name; of those that fly."""
    survey: SurveyTruth = SurveyTruth()
    """anchors and landmarks."""
    camera: CameraTruth = CameraTruth()
    """its mounting and lens."""
    clock: ClockTruth = ClockTruth()
    """of the sensors."""
    start: StartTruth = StartTruth()
    """the first estimate."""
