"""Fly a sensor of your own: a barometer, whose height drifts with the weather.

    python examples/barometer.py
    ortilo --plugin examples/barometer.py fly nominal_imu_uwb --set 'sensors=[uwb, imu, barometer]'

A sensor is one description: its settings, what it measures in the world, what the filter reads, and with which noise.
Handler, filter, floor, tables, logs and hardware in the loop follow from it.
"""

from collections import namedtuple

import numpy as np
from numba import njit

import ortilo_drake as od


class Barometer(od.SensorSettings):
    """A barometer.

    Attributes:
        sd: noise of each height [m].
        drift: amplitude of the slow error [m].
        period: of the slow error [s].
        link: how its messages reach the vehicle.
    """

    sd: float = 0.1
    drift: float = 0.05
    period: float = 60.0


Numbers = namedtuple("Numbers", ("sd", "drift", "period"))  # the settings that measure knows


@njit
def measure(its: Numbers, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
    """Return the payload, the height z with noise and drift, at state x (12); v is one standard normal number."""
    return np.array([x[2] + its.sd * v[0] + its.drift * np.sin(2.0 * np.pi * t / its.period)])


def numbers(scenario: od.Belief, room: od.Room) -> Numbers:
    """Return the numbers of a scenario's barometer."""
    return Numbers(*(getattr(scenario.settings_of("barometer"), name) for name in Numbers._fields))


COMPILED = od.Compiled(numbers, payload=1, noises=1, measure=measure)


def row_sd(scenario: od.Scenario, room: od.Room, states: np.ndarray) -> np.ndarray:
    """Return the noise of its row at true states (n, 12)."""
    return np.full((len(states), 1), scenario.barometer.sd)


od.register_sensor(
    od.Sensor(
        "barometer",
        Barometer,
        rows=(od.row("z_baro", z=1.0),),
        sd=row_sd,
        V=lambda scenario: np.array([[scenario.barometer.sd**2 + scenario.barometer.drift**2]]),
        compiled=COMPILED,  # so that thousands of flights fly with it, see docs/how_to/ensemble.md
    )
)


def main(**settings: object) -> od.Flight:
    """Fly scenario 1, whose filter reads no accelerometer, with and without it; print the error of the height."""
    without = od.fly("nominal_imu_uwb", **settings)
    flight = od.fly("nominal_imu_uwb", sensors=["uwb", "imu", "barometer"], **settings)
    for name, flown in (("without", without), ("with   ", flight)):
        error = np.sqrt(np.mean(flown.error.sel(axis="z").values ** 2))
        print(f"{name} barometer: RMS error of the height {error:.3f} m; {flown}")
    return flight


if __name__ == "__main__":
    main()
