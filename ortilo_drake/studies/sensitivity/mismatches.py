"""The ways in which a world may differ from what the onboard half believes, each by one number.

'careful' is what a careful team leaves: a weighed vehicle, a levelled IMU, a tape-measured room (realistic.yaml has
about the same, all at once).
"""

from collections.abc import Callable
from math import radians
from typing import Any, Final, NamedTuple

from ortilo_drake.scenario import Scenario

Settings = tuple[tuple[str, Any], ...]  # keys of a scenario with their values


class Mismatch(NamedTuple):
    """A mismatch.

    Attributes:
        name: what it is, with the unit of its value.
        settings: the scenario's keys for a value.
        careful: the value that a careful team leaves.
        given: values that are flown.
        largest: value up to which a limit is searched; None for what is there or not.
        sensor: without which it changes nothing (the gyroscope: unless the filter reads it); None if it always does.
    """

    name: str
    settings: Callable[[float], Settings]
    careful: float
    given: tuple[float, ...]
    largest: float | None
    sensor: str | None = None


def _set(key: str, scale: float = 1.0, start: float = 0.0) -> Callable[[float], Settings]:
    return lambda value: ((f"truth.{key}", start + scale * value),)


MISMATCHES: Final = (
    Mismatch("mass higher by [%]", _set("vehicle.mass_factor", 0.01, 1.0), 3.0, (-10.0, 0.5, 2.0, 10.0), 50.0),
    Mismatch("thrust lower by [%]", _set("vehicle.thrust_factor", -0.01, 1.0), 2.0, (2.0, 10.0), 40.0),
    Mismatch(
        "center of gravity ahead by [mm]",
        lambda value: (("truth.vehicle.center_of_gravity", (1e-3 * value, 0.0)),),
        2.0,
        (2.0, 10.0),
        200.0,
    ),
    Mismatch("force in y [N]", lambda value: (("truth.force.mean", (0.0, value, 0.0)),), 0.1, (0.1, 0.5), 6.4),
    Mismatch("gusts of sd [N]", _set("force.gust_sd"), 0.1, (0.1, 0.5), 6.4),
    Mismatch(
        "level of the IMU in roll [deg]",
        lambda value: (("truth.imu.level", (radians(value), 0.0)),),
        0.3,
        (0.1, 0.5),
        10.0,
    ),
    Mismatch("yaw of the IMU [deg]", _set("imu.yaw", radians(1.0)), 1.0, (2.0,), 64.0),
    Mismatch(
        "gyroscope biased by [mrad/s] about each axis",
        lambda value: (("truth.imu.rates", (1e-3 * value,) * 3),),
        0.3,
        (1.0,),
        100.0,
        "gyroscope",
    ),
    Mismatch("range biases of sd [cm]", _set("uwb.bias_sd", 0.01), 5.0, (5.0,), 160.0, "uwb"),
    Mismatch("anchors surveyed to sd [cm]", _set("survey.anchors_sd", 0.01), 3.0, (5.0,), 160.0, "uwb"),
    Mismatch("landmarks surveyed to sd [cm]", _set("survey.landmarks_sd", 0.01), 3.0, (5.0,), 160.0, "camera"),
    Mismatch(
        "only the sizes of landmarks known, not their shapes",
        lambda value: (("landmark_fix.shapes", "boxes"),),
        1.0,
        (1.0,),
        None,
        "camera",
    ),
    Mismatch("camera turned by sd [deg]", _set("camera.angles_sd", radians(1.0)), 0.5, (1.0,), 32.0, "camera"),
    Mismatch("clocks behind by [ms]", _set("clock.offset", 1e-3), 5.0, (5.0, 20.0), 480.0),
)


def mismatches_of(scenario: Scenario) -> tuple[Mismatch, ...]:
    """Return the mismatches that change anything with the sensors of a scenario."""
    reads_rates = getattr(scenario.estimator, "rates", "none") == "measured"
    sensors = (None, *scenario.sensors, *(["gyroscope"] if reads_rates else []))
    return tuple(m for m in MISMATCHES if m.sensor in sensors)


def all_together(mismatches: tuple[Mismatch, ...]) -> Mismatch:
    """Return all mismatches at once, each at its careful value times the one number."""

    def settings(value: float) -> Settings:
        return tuple(entry for m in mismatches for entry in m.settings(value * m.careful))

    largest = min(m.largest / m.careful for m in mismatches if m.largest is not None)
    return Mismatch("all together, times a careful team's", settings, 1.0, (1.0,), largest)
