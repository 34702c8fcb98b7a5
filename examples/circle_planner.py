"""Fly a planner of your own as an element: a circle, as a function of time.

    python examples/circle_planner.py
    ortilo --plugin examples/circle_planner.py rare imu_uwb --corridor 1 --set 'planner={kind: circle}'

An element without a state is one function. One with a state could follow the estimate, or wait for a message.
"""

from typing import Any, Literal

import numpy as np

import ortilo_drake as od


class Circle(od.Frozen):
    """A planner's settings.

    Attributes:
        kind: 'circle'.
        center: of the circle in W [m].
        radius: of the circle [m].
        rate: at which it is flown [rad/s].
        duration: how long [s].
    """

    kind: Literal["circle"]
    center: tuple[float, float, float] = (8.0, 1.0, 1.5)
    radius: float = 0.8
    rate: float = 0.5
    duration: float = 15.0


def say(n: Any, k: int, out: np.ndarray) -> None:
    """Write [r, r_dot, r_ddot] of tick k (9)."""
    angle, w = n.rate * k * n.h, n.rate
    x, y = n.radius * np.cos(angle), n.radius * np.sin(angle)
    out[0], out[1], out[2] = n.center[0] + x, n.center[1] + y, n.center[2]
    out[3], out[4], out[5] = -w * y, w * x, 0.0
    out[6], out[7], out[8] = -w * w * x, -w * w * y, 0.0


def make(belief: od.Belief) -> od.Box:
    """Return the planner of a scenario."""
    its = belief.planner
    return od.box(9, say, numbers={"h": belief.h, "center": its.center, "radius": its.radius, "rate": its.rate})


od.register_planner("circle", Circle, box=make)


def main(**settings: Any) -> Any:
    """Fly scenario 1's vehicle along it; print how far from the circle it came."""
    flight = od.fly("imu_uwb", seed=1, **({"planner": {"kind": "circle"}} | settings)).data
    away = np.linalg.norm(flight["truth"].values[:, :3] - flight["reference"].values, axis=1)
    print(f"circle: largest distance from the reference {away.max():.2f} m")
    return flight


if __name__ == "__main__":
    main()
