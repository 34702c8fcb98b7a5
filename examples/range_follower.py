"""Fly an estimator of your own as an element: it follows the ranges, and the IMU predicts between them.

    python examples/range_follower.py

An element with a state has two functions: its output, and its step to the next tick. This one has the vehicle's
twelve states; its covariance is a setting, not computed.
"""

from typing import Any, Literal

import numpy as np

import ortilo_drake as od
from ortilo_drake.model.equations import euler_rates, rotation


class RangeFollower(od.Frozen):
    """An estimator's settings.

    Attributes:
        kind: 'range_follower'.
        gain: share of a range's error that corrects the position.
        sd: of the error of each state, as it claims.
    """

    kind: Literal["range_follower"]
    gain: float = 0.25
    sd: float = 0.1


def say(n: Any, x: np.ndarray, out: np.ndarray) -> None:
    """Write the estimate (12) and its covariance row by row (144)."""
    out[:] = 0.0
    out[:12] = x
    for i in range(12):
        out[12 + 13 * i] = n.sd**2


def step(n: Any, uwb: np.ndarray, imu: np.ndarray, anchors: np.ndarray, x: np.ndarray) -> None:
    """Correct the position by each range, predict it by the accelerometer, and take the IMU's attitude."""
    if uwb[0] != 0.0:
        for i in range(len(anchors)):
            if uwb[2 + len(anchors) + i] > 0.0:
                away = x[:3] - anchors[i]
                distance = np.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2)
                correction = n.gain * (uwb[2 + i] - distance) / distance * away
                x[:3] += correction
                x[6:9] += 0.3 * correction
    R_WB = rotation(imu[2:5])
    for i in range(3):
        a = R_WB[i, 0] * imu[8] + R_WB[i, 1] * imu[9] + R_WB[i, 2] * imu[10] - (9.81 if i == 2 else 0.0)
        x[i] += n.h * x[6 + i]
        x[6 + i] += n.h * a
    x[3:6] = imu[2:5]
    rates = euler_rates(imu[2:5], imu[5:8])
    for i in range(3):
        x[9 + i] = rates[i]


def make(belief: od.Belief, xbar_0: np.ndarray) -> od.Box:
    """Return the estimator of a scenario, which begins at the first estimate (15)."""
    numbers = {"gain": belief.estimator.gain, "sd": belief.estimator.sd, "h": belief.h}
    anchors = belief.load_room().anchor_positions
    return od.box(156, say, step, numbers=numbers, tables={"anchors": anchors}, state={"x": xbar_0[:12]})


od.register_estimator("range_follower", RangeFollower, box=make)


def main(**settings: Any) -> Any:
    """Fly scenario 1 without its blackouts; print where it ends."""
    scenario = od.load_scenario("imu_uwb", estimator={"kind": "range_follower"}, uwb__link__blackouts=[], **settings)
    flight = od.fly(scenario, seed=1).data
    print("range follower: ends at", flight["truth"].values[-1, :3], "lost:", flight.attrs["lost"])
    return flight


if __name__ == "__main__":
    main()
