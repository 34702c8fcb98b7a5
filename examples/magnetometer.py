"""Fly a sensor of your own with the paper's filter and with the tight one: a magnetometer, which measures the heading.

    python examples/magnetometer.py
    ortilo --plugin examples/magnetometer.py fly tight_imu_uwb --set 'sensors=[uwb, imu, magnetometer]'

It measures the field in the body's frame. Onboard the field is levelled by the estimated roll and pitch; the direction
of its horizontal part gives the heading. An error of roll and pitch adds a part of the vertical field.
"""

from collections import namedtuple

import numpy as np
from numba import njit

import ortilo_drake as od


class Magnetometer(od.SensorSettings):
    """A magnetometer.

    Attributes:
        link: how its messages reach the vehicle.
        sd: noise of each axis [uT].
    """

    sd: float = 0.8


NORTH, UP = 20.0, -44.0  # the earth's field [uT], along x and z of W
Numbers = namedtuple("Numbers", ("sd", "north", "up"))  # what the functions below know


@njit
def measure(its: Numbers, x: np.ndarray, v: np.ndarray, t: float) -> np.ndarray:
    """Return the field in B (3) at state x (12), with noise; v are three standard normal numbers."""
    (sf, st, ss), (cf, ct, cs) = np.sin(x[3:6]), np.cos(x[3:6])
    a, b, c = cs * its.north, -ss * its.north, its.up  # turned by the heading, then by pitch and roll
    d, e = ct * a - st * c, st * a + ct * c
    return np.array([d, cf * b + sf * e, cf * e - sf * b]) + its.sd * v


@njit
def solve(its: Numbers, m: np.ndarray, xhat: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return the heading [rad] and its variance, of the field in B (3) and the estimate."""
    (sf, st), (cf, ct) = np.sin(xhat[3:5]), np.cos(xhat[3:5])
    psi = np.arctan2(sf * m[2] - cf * m[1], ct * m[0] + st * (sf * m[1] + cf * m[2]))
    psi += 2.0 * np.pi * np.round((xhat[5] - psi) / (2.0 * np.pi))
    leaks = its.up**2 * max(P[3, 3], P[4, 4])
    return np.array([psi, (its.sd**2 + leaks) / its.north**2])


def numbers(scenario: od.Belief, room: od.Room) -> Numbers:
    """Return the numbers of a scenario's magnetometer."""
    return Numbers(scenario.settings_of("magnetometer").sd, NORTH, UP)


COMPILED = od.Compiled(numbers, payload=3, noises=3, measure=measure, solve=solve)
od.register_sensor(
    od.Sensor(
        "magnetometer",
        Magnetometer,
        rows=(od.row("psi_mag", psi=1.0),),
        sd=lambda scenario, room, states: np.full((len(states), 1), scenario.magnetometer.sd / NORTH),
        compiled=COMPILED,
    )
)


def main(**settings: object) -> None:
    """Fly scenario 1 with it and either filter; print the error of the heading."""
    for name in ("imu_uwb", "tight_imu_uwb"):
        data = od.fly(name, sensors=["uwb", "imu", "magnetometer"], **settings).data
        e = data["estimate"].sel(xbar="psi") - data["truth"].sel(state="psi")
        print(f"{name}: RMS error of the heading {np.sqrt(np.mean(e.values**2)):.4f} rad")


if __name__ == "__main__":
    main()
