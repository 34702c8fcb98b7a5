"""Fly a servo of your own as an element: a cascade from position to acceleration, angles and torques.

    python examples/cascade_servo.py
    ortilo --plugin examples/cascade_servo.py rare imu_uwb --corridor 1 --set 'servo={kind: cascade}'

An element is a plain function whose parameters are its wiring. What a servo may read: docs/how_to/own_parts.md.
"""

from typing import Any, Literal

import numpy as np

import ortilo_drake as od


class Cascade(od.Frozen):
    """A servo's settings.

    Attributes:
        kind: 'cascade'.
        position: acceleration over position error [1/s^2].
        velocity: acceleration over velocity error [1/s].
    """

    kind: Literal["cascade"]
    position: float = 1.0
    velocity: float = 1.6


def say(n: Any, estimate: np.ndarray, reference: np.ndarray, out: np.ndarray) -> None:
    """Write u = [f_T, tau], from the estimate (15) and [r, r_dot, r_ddot] (9), at heading 0."""
    r, v_r, p, v = reference[0:3], reference[3:6], estimate[0:3], estimate[6:9]
    a = reference[6:9] + n.position * (r - p) + n.velocity * (v_r - v)
    angles = np.array([-a[1] / 9.81, a[0] / 9.81, 0.0])
    out[0] = n.mass * (9.81 + a[2])
    out[1:4] = n.inertia * (20.0 * (angles - estimate[3:6]) - 9.0 * estimate[9:12])


def make(belief: od.Belief) -> od.Box:
    """Return the servo of a scenario."""
    its, vehicle = belief.servo, belief.vehicle
    numbers = {"mass": vehicle.mass, "inertia": vehicle.inertia, "position": its.position, "velocity": its.velocity}
    return od.box(4, say, numbers=numbers)


def gain(belief: od.Belief) -> np.ndarray:
    """Return L (4, 15) of `say` about hover, which ortilo analyze and the linear theory use."""
    its, (Ix, Iy, Iz) = belief.servo, belief.vehicle.inertia
    L, both = np.zeros((4, 15)), np.array([its.position, its.velocity])  # on p and v, x, y and z apart
    L[0, [2, 8]] = belief.vehicle.mass * both
    L[1, [1, 7]], L[1, [3, 9]] = -20.0 * Ix / 9.81 * both, Ix * np.array([20.0, 9.0])
    L[2, [0, 6]], L[2, [4, 10]] = 20.0 * Iy / 9.81 * both, Iy * np.array([20.0, 9.0])
    L[3, [5, 11]] = Iz * np.array([20.0, 9.0])
    return L


od.register_servo("cascade", Cascade, box=make, gain=gain)


def main(**settings: Any) -> Any:
    """Fly scenario 1 with it; print where it ends."""
    flight = od.fly("imu_uwb", seed=1, servo={"kind": "cascade"}, **settings).data
    print("cascade: ends at", flight["truth"].values[-1, :3], "lost:", flight.attrs["lost"])
    return flight


if __name__ == "__main__":
    main()
