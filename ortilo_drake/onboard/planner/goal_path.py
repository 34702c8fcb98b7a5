"""A new goal in flight: brake to rest along the present path, and continue from there along another path.

Braking changes the pace, not the path: the vehicle flies r(tau(t)) with, for s = (t - t_0) / T from 0 to 1,

    tau = t_0 + T (s - s^3 + s^4 / 2),    tau' = 1 - 3 s^2 + 2 s^3,    tau'' = -6 s (1 - s) / T,

so it stays on the curve, which avoids all obstacles, and stops at tau = t_0 + T / 2. The acceleration is
r'' tau'^2 + r' tau''; its second term starts and ends at 0. With T = 2 v / a, where v is the path's largest speed from
t_0 on, the acceleration is at most

    |r''| tau'^2 + 3 a s (1 - s)  <=  1.29 a   where the path keeps |r''| <= a,

and at most a where the path's speed is constant, because there the two terms are perpendicular.
"""

from typing import Final

import numpy as np
from pydrake.trajectories import PiecewisePolynomial, Trajectory

LEAST: Final = 0.4  # shortest braking time, also from rest [s]
KNOTS: Final = 0.05  # longest time between two knots of the braking [s]
PIECES: Final = 16  # smallest number of pieces of the braking
INSTANT: Final = 1e-6  # a shorter rest is left out [s]


def brake(trajectory: Trajectory, t: float, acceleration: float) -> PiecewisePolynomial:
    """Return the braking to rest along a flight's path p_WB(t) (3 rows) from the time t [s]; the path ends at rest.

    The result is cubic between knots that lie on the path. Within the limits of scenario.GcsPlanner it stays within
    1e-5 m of the path. At t, r and r_dot are continuous up to rounding, and r_ddot up to 1 % of its limit
    `acceleration` [m/s^2].
    """
    end = trajectory.end_time()
    velocity = trajectory.MakeDerivative(1)
    left = max(0.0, end - t)
    ahead = velocity.vector_values(np.linspace(min(t, end), end, int(left / KNOTS) + 2))
    v = float(np.linalg.norm(ahead, axis=0).max()) if left > 0.0 else 0.0
    T = max(2.0 * v / acceleration, LEAST)
    s = np.linspace(0.0, 1.0, max(PIECES, int(np.ceil(T / KNOTS))) + 1)
    tau = t + T * (s - s**3 + s**4 / 2.0)
    pace = np.where(tau < end, 1.0 - 3.0 * s**2 + 2.0 * s**3, 0.0)
    tau = np.minimum(tau, end)
    return PiecewisePolynomial.CubicHermite(
        t + T * s, trajectory.vector_values(tau), velocity.vector_values(tau) * pace
    )


def join_paths(first: PiecewisePolynomial, path: PiecewisePolynomial, t: float) -> PiecewisePolynomial:
    """Return the flight `first`, which ends at rest, then a rest until the time t [s], then `path`, which ends at rest.

    If `first` ends later than t, the path begins at the end of `first`.
    """
    before, after = knots(first), knots(path)
    end = before[0, -1]
    begin = t if t > end + INSTANT else end
    after[0] += begin - after[0, 0]
    # The path starts where `first` ends, up to a solver's tolerance. Its first knot is replaced to avoid a jump.
    after[1:, 0] = before[1:, -1]
    return through(np.hstack([before, after if begin > end else after[:, 1:]]))


def knots(trajectory: PiecewisePolynomial) -> np.ndarray:
    """Return t, r, r_dot (7, n) at the breaks of a piecewise cubic with continuous r_dot; they determine the cubic."""
    t = np.array(trajectory.get_segment_times())
    return np.vstack([t, trajectory.vector_values(t), trajectory.MakeDerivative(1).vector_values(t)])


def through(knots: np.ndarray) -> PiecewisePolynomial:
    """Return the piecewise cubic through knots t, r, r_dot (7, n)."""
    return PiecewisePolynomial.CubicHermite(knots[0], knots[1:4], knots[4:7])
