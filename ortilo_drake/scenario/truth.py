"""The world's differences from the onboard half's belief.

All other settings are what a team believes and configures: its vehicle, its surveyed room, its sensors. Each entry here
is the world's difference from that: a number that is added, or a factor. The same name with _sd is the standard
deviation of a number that the seed draws and adds to it. By default nothing differs. The onboard half sees none of
this, see belief.py; docs/truths.md has the equations.
"""

from typing import Annotated, NamedTuple

from pydantic import AfterValidator, Field, PlainSerializer

from ortilo_drake.model.typed_yaml import Frozen, Positive

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
    """The body and its rotors.

    Attributes:
        mass_factor: true over believed mass [1]; 1.03 is 3 % heavier than believed.
        mass_factor_sd: spread of that [1].
        inertia_factor: true over believed moments of inertia [1].
        inertia_factor_sd: spread of that [1].
        thrust_factor: true over believed lift of the rotors [1], which makes thrust and the torques of roll and pitch.
        thrust_factor_sd: spread of that [1].
        center_of_gravity: where it is, ahead and to the left of where it is believed to be [m].
        center_of_gravity_sd: spread of each of them [m].
    """

    mass_factor: Factor = 1.0
    mass_factor_sd: FactorSd = 0.0
    inertia_factor: Factor = 1.0
    inertia_factor_sd: FactorSd = 0.0
    thrust_factor: Factor = 1.0
    thrust_factor_sd: FactorSd = 0.0
    center_of_gravity: Pair = (0.0, 0.0)
    center_of_gravity_sd: Sd = 0.0


class ForceTruth(Frozen):
    """A force in W that lasts, beside the scenario's white disturbance.

    Attributes:
        mean: its constant part [N].
        mean_sd: spread of each of its components [N].
        gust_sd: standard deviation of its changing part per axis, first-order Gauss-Markov noise [N].
        gust_time: correlation time of that [s].
    """

    mean: Triple = (0.0, 0.0, 0.0)
    mean_sd: Sd = 0.0
    gust_sd: Sd = 0.0
    gust_time: Positive = 2.0


class ImuTruth(Frozen):
    """Errors of the imu's angles, rates and specific force, beside their white noise.

    Attributes:
        level: added to roll and pitch [rad].
        level_sd: spread of each of them [rad].
        level_walk: random walk of them, its standard deviation after 1 s [rad].
        yaw: added to the yaw [rad].
        yaw_sd: spread of that [rad].
        yaw_walk: random walk of it, its standard deviation after 1 s [rad].
        angles_factor: factor of the angles [1].
        angles_factor_sd: spread of that [1].
        rates: added to the body rates [rad/s].
        rates_sd: spread of each of them [rad/s].
        rates_walk: random walk of them, its standard deviation after 1 s [rad/s].
        rates_factor: factor of the body rates [1].
        rates_factor_sd: spread of that [1].
        specific_force: added to the specific force [m/s^2].
        specific_force_sd: spread of each of its components [m/s^2].
        specific_force_walk: random walk of them, its standard deviation after 1 s [m/s^2].
        specific_force_factor: factor of the specific force [1].
        specific_force_factor_sd: spread of that [1].
    """

    level: Pair = (0.0, 0.0)
    level_sd: Sd = 0.0
    level_walk: Sd = 0.0
    yaw: Number = 0.0
    yaw_sd: Sd = 0.0
    yaw_walk: Sd = 0.0
    angles_factor: Factor = 1.0
    angles_factor_sd: FactorSd = 0.0
    rates: Triple = (0.0, 0.0, 0.0)
    rates_sd: Sd = 0.0
    rates_walk: Sd = 0.0
    rates_factor: Factor = 1.0
    rates_factor_sd: FactorSd = 0.0
    specific_force: Triple = (0.0, 0.0, 0.0)
    specific_force_sd: Sd = 0.0
    specific_force_walk: Sd = 0.0
    specific_force_factor: Factor = 1.0
    specific_force_factor_sd: FactorSd = 0.0


class UwbTruth(Frozen):
    """Errors of the ranges, beside their white noise.

    Attributes:
        bias: added to every range [m].
        bias_sd: spread of that, drawn for each anchor [m].
        factor: factor of all ranges [1].
        factor_sd: spread of that [1].
        slow_sd: standard deviation of first-order Gauss-Markov noise that is added, each anchor's its own [m].
        slow_time: correlation time of that [s].
    """

    bias: Annotated[Number, Each("anchors")] = 0.0
    bias_sd: Sd = 0.0
    factor: Factor = 1.0
    factor_sd: FactorSd = 0.0
    slow_sd: Sd = 0.0
    slow_time: Positive = 2.0


class SensorTruth(Frozen):
    """Errors of a registered sensor, beside its noise, for each number of its payload, in that number's unit.

    A list is as long as the payload; an empty one stands for no such error.

    Attributes:
        bias: added to each.
        bias_sd: spread of each of them.
        factor: factor of each [1].
        factor_sd: spread of each of them [1].
        slow_sd: standard deviations of first-order Gauss-Markov noise that is added.
        slow_time: correlation time of that [s].
    """

    bias: Annotated[tuple[Number, ...], Field(max_length=64)] = ()
    bias_sd: Annotated[tuple[Sd, ...], Field(max_length=64)] = ()
    factor: Annotated[tuple[Factor, ...], Field(max_length=64)] = ()
    factor_sd: Annotated[tuple[FactorSd, ...], Field(max_length=64)] = ()
    slow_sd: Annotated[tuple[Sd, ...], Field(max_length=64)] = ()
    slow_time: Positive = 2.0


class SurveyTruth(Frozen):
    """The true places of anchors and landmarks: the room's file holds the surveyed ones.

    Attributes:
        anchors: from where every anchor was surveyed to where it is [m].
        anchors_sd: spread of that, drawn for each anchor and axis [m].
        landmarks: from where every landmark was surveyed to where it is [m].
        landmarks_sd: spread of that, drawn for each landmark and axis [m].
    """

    anchors: Annotated[Triple, Each("anchors")] = (0.0, 0.0, 0.0)
    anchors_sd: Sd = 0.0
    landmarks: Annotated[Triple, Each("landmarks")] = (0.0, 0.0, 0.0)
    landmarks_sd: Sd = 0.0


class CameraTruth(Frozen):
    """The camera's true mounting and lens.

    Attributes:
        position: from where it is believed to be to where it is, in B [m].
        position_sd: spread of each component [m].
        angles: roll, pitch and yaw by which it is turned from looking ahead, about its own centre [rad].
        angles_sd: spread of each of them [rad].
        focal_factor: true over believed focal length [1].
        focal_factor_sd: spread of that [1].
    """

    position: Triple = (0.0, 0.0, 0.0)
    position_sd: Sd = 0.0
    angles: Triple = (0.0, 0.0, 0.0)
    angles_sd: Sd = 0.0
    focal_factor: Factor = 1.0
    focal_factor_sd: FactorSd = 0.0


class ClockTruth(Frozen):
    """The sensors' clocks beside that of imu and onboard computer; each sensor but the imu has one of its own.

    Attributes:
        offset: age of a measurement beyond its stamp at the start [s].
        offset_sd: spread of that, drawn for each sensor [s].
        drift: by how much more in every second [1].
        drift_sd: spread of that, drawn for each sensor [1].
    """

    offset: Annotated[float, Field(ge=-0.5, le=0.5)] = 0.0
    offset_sd: Annotated[float, Field(ge=0.0, le=0.1)] = 0.0
    drift: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 0.0
    drift_sd: Annotated[float, Field(ge=0.0, le=1e-3)] = 0.0


class StartTruth(Frozen):
    """The vehicle's true start; the filter's first estimate is the start of the path, under the held heading.

    Attributes:
        position: from where it is believed to start to where it does [m].
        position_sd: spread of each component [m].
        yaw: true less believed yaw at the start [rad].
        yaw_sd: spread of that [rad].
    """

    position: Triple = (0.0, 0.0, 0.0)
    position_sd: Sd = 0.0
    yaw: Number = 0.0
    yaw_sd: Sd = 0.0


def _as_pairs(sensors: dict[str, SensorTruth]) -> tuple[tuple[str, SensorTruth], ...]:
    """Return a mapping as sorted pairs, by which a frozen model has a hash."""
    return tuple(sorted(sensors.items(), key=lambda item: item[0]))


# A mapping in a file, kept as pairs: dict(sensors) is the mapping again.
SensorTruths = Annotated[
    dict[str, SensorTruth], AfterValidator(_as_pairs), PlainSerializer(dict, return_type=dict[str, SensorTruth])
]


class Truth(Frozen):
    """The world's differences from the onboard half's belief.

    Attributes:
        vehicle: the body and its rotors.
        force: a steady force on the body.
        imu: angles, rates and specific force.
        uwb: ranges.
        sensors: registered sensors, by name; of those that fly.
        survey: anchors and landmarks.
        camera: its mounting and lens.
        clock: of the sensors.
        start: the first estimate.
    """

    vehicle: VehicleTruth = VehicleTruth()
    force: ForceTruth = ForceTruth()
    imu: ImuTruth = ImuTruth()
    uwb: UwbTruth = UwbTruth()
    sensors: SensorTruths = Field(default={}, validate_default=True)
    survey: SurveyTruth = SurveyTruth()
    camera: CameraTruth = CameraTruth()
    clock: ClockTruth = ClockTruth()
    start: StartTruth = StartTruth()
