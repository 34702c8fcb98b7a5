"""Fly a sensor of your own: a barometer, whose height drifts with the weather.

    python examples/barometer.py
    ortilo --plugin examples/barometer.py fly nominal_imu_uwb --set 'sensors=[uwb, imu, barometer]'

A sensor is one description: its settings, the System that is it in the world, what it tells the filter, and how well.
Handler, filter, floor, tables, logs and hardware-in-the-loop take it from there.
"""

import numpy as np

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


def make_world(scenario: od.Scenario, room: od.Room) -> od.StateSensor:
    """Return the barometer in the world: its payload is the height z, with noise and drift."""
    settings = scenario.barometer

    def measure(x: np.ndarray, v: np.ndarray, t: float) -> list[float]:
        return [x[2] + settings.sd * v[0] + settings.drift * np.sin(2.0 * np.pi * t / settings.period)]

    return od.StateSensor("barometer", 1, 1, measure, scenario.seed, scenario.h)


def row_sd(scenario: od.Scenario, room: od.Room, states: np.ndarray) -> np.ndarray:
    """Return the noise of its row at true states (n, 12)."""
    return np.full((len(states), 1), scenario.barometer.sd)


od.register_sensor(
    od.Sensor(
        "barometer",
        Barometer,
        rows=(od.row("z_baro", z=1.0),),
        make_world=make_world,
        sd=row_sd,
        V=lambda scenario: np.array([[scenario.barometer.sd**2 + scenario.barometer.drift**2]]),
    )
)


def main(**settings: object) -> od.Flight:
    """Fly scenario 1 with and without it, and print the error of the height.

    The filter is the paper's: the default one reads the accelerometer, and a barometer tells it little that is new.
    """
    without = od.fly("nominal_imu_uwb", **settings)
    flight = od.fly("nominal_imu_uwb", sensors=["uwb", "imu", "barometer"], **settings)
    for name, flown in (("without", without), ("with   ", flight)):
        error = np.sqrt(np.mean(flown.error.sel(axis="z").values ** 2))
        print(f"{name} barometer: RMS error of the height {error:.3f} m; {flown}")
    return flight


if __name__ == "__main__":
    main()
