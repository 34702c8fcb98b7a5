"""The ways in which a world may differ from what the onboard half assumes, each described by one number.

'careful' is the size that a careful team leaves: a weighed vehicle, a levelled IMU, a tape-measured room
(realistic.yaml has about the same, all at once).
"""

from typing import Final

from ortilo_drake.model.parts import known_sensors
from ortilo_drake.scenario import Scenario
from ortilo_drake.sensors.described import described
from ortilo_drake.sensors.imu import reads
from ortilo_drake.sensors.mismatch import Mismatch, Settings, of_truth

OF_ALL: Final = (
    Mismatch("mass higher by [%]", of_truth("vehicle.mass_factor", 0.01, 1.0), 3.0, (-10.0, 0.5, 2.0, 10.0), 50.0),
    Mismatch("thrust lower by [%]", of_truth("vehicle.thrust_factor", -0.01, 1.0), 2.0, (2.0, 10.0), 40.0),
    Mismatch(
        "center of gravity ahead by [mm]",
        lambda value: (("truth.vehicle.center_of_gravity", (1e-3 * value, 0.0)),),
        2.0,
        (2.0, 10.0),
        200.0,
    ),
    Mismatch("force in y [N]", lambda value: (("truth.force.mean", (0.0, value, 0.0)),), 0.1, (0.1, 0.5), 6.4),
    Mismatch("gusts of sd [N]", of_truth("force.gust_sd"), 0.1, (0.1, 0.5), 6.4),
    Mismatch("clocks behind by [ms]", of_truth("clock.offset", 1e-3), 5.0, (5.0, 20.0), 480.0),
)
TOGETHER: Final = "all together, times a careful team's"


def known_mismatches() -> tuple[Mismatch, ...]:
    """Return all mismatches, including those of all sensors."""
    return (*OF_ALL, *(m for name in known_sensors() for m in described(name).mismatches))


def mismatches_of(scenario: Scenario) -> tuple[Mismatch, ...]:
    """Return the mismatches that change anything for the sensors of a scenario."""
    flown = (m for name in scenario.sensors for m in described(name).mismatches)
    return (*OF_ALL, *(m for m in flown if not m.of_rates or reads(scenario, "rates")))


def all_together(mismatches: tuple[Mismatch, ...]) -> Mismatch:
    """Return all mismatches at once, each at its careful value times the one number."""

    def settings(value: float) -> Settings:
        return tuple(entry for m in mismatches for entry in m.settings(value * m.careful))

    largest = min(m.largest / m.careful for m in mismatches if m.largest is not None)
    return Mismatch(TOGETHER, settings, 1.0, (1.0,), largest)
