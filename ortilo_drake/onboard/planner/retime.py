"""From a path to a flight along the path: at constant speed, from rest to rest, within an acceleration limit.

Along the path's length s, with curvature kappa and v = s_dot, the acceleration has the two components

    a_t = dv/dt = 1/2 d(v^2)/ds,      a_n = kappa v^2,      a_t^2 + a_n^2 <= a_max^2.

A forward and a backward pass over s give the fastest v(s) (Bobrow, Dubowsky and Gibson, 1985). The acceleration of
this v(s) jumps, which a vehicle that tilts to accelerate cannot follow. So s(t) is averaged over a short window. The
average has continuous acceleration and keeps both limits, on v and on dv/dt.
"""

import math

import numpy as np
from pydrake.trajectories import PiecewisePolynomial, Trajectory

from ortilo_drake.model.typed_yaml import InputError

SAMPLES = 4000  # number of samples of the path
STEP = 0.002  # time step before the knots are chosen [s]
WINDOW = 0.8  # time window over which s(t) is averaged [s]
KNOTS = 0.15  # longest time between two knots of the result [s]
TOLERANCE = 0.005  # relative amount by which the result may exceed a limit
LONGEST = 36_000.0  # longest flight [s]
TIGHTEST = 0.25  # a path that needs limits below this share of the given ones is refused


def integral(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Return the integral (n) of y over x from x_0 on, by the trapezoidal rule.

    Same bits as scipy.integrate.cumulative_trapezoid, whose import takes a quarter of a second.
    """
    return np.concatenate(([0.0], np.cumsum(np.diff(x) * (y[1:] + y[:-1]) / 2.0)))


def fastest_speed(ds: np.ndarray, kappa: np.ndarray, speed: float, acceleration: float) -> np.ndarray:
    """Return v (n) [m/s] along a path: v <= speed, |(a_t, a_n)| <= acceleration [m/s^2], v = 0 at both ends.

    The path's samples are ds (n - 1) [m] apart and have curvatures kappa (n) [1/m]. Not compiled, as compiling takes
    longer than this loop.
    """
    w = np.minimum(speed * speed, acceleration / np.maximum(kappa, 1.0e-9)).tolist()  # v^2
    w[0] = w[-1] = 0.0
    steps, bends, most = ds.tolist(), kappa.tolist(), acceleration * acceleration
    for i in range(1, len(w)):
        a_n = bends[i - 1] * w[i - 1]
        w[i] = min(w[i], w[i - 1] + 2.0 * math.sqrt(max(0.0, most - a_n * a_n)) * steps[i - 1])
    for i in range(len(w) - 2, -1, -1):
        a_n = bends[i + 1] * w[i + 1]
        w[i] = min(w[i], w[i + 1] + 2.0 * math.sqrt(max(0.0, most - a_n * a_n)) * steps[i])
    return np.sqrt(w)


def averaged_length(ds: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the times t (m) [s] of the result's knots, from 0 on, and s(t) (m) [m] averaged over WINDOW.

    The path's samples are ds (n - 1) [m] apart, with the speed v (n) [m/s], 0 at both ends; between samples the speed
    is linear in time. InputError if the flight takes longer than LONGEST.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):  # a speed may have underflowed to 0
        t_v = np.concatenate([[0.0], np.cumsum(2.0 * ds / (v[1:] + v[:-1]))])
    duration = t_v[-1] + WINDOW
    if not duration <= LONGEST:
        raise InputError(f"takes {duration:g} s at this speed and acceleration, must not exceed {LONGEST:g} s")
    fine = np.linspace(0.0, duration, int(np.ceil(duration / STEP)) + 1)
    s = integral(np.interp(fine, t_v, v), fine)
    # The mean over the window that ends at t: the averaged motion also starts at 0 and ends one window later.
    v_mean = (s - np.interp(fine - WINDOW, fine, s)) / WINDOW
    s_mean = integral(v_mean, fine)
    t = np.linspace(0.0, duration, max(3, int(np.ceil(duration / KNOTS)) + 1))
    return t, np.interp(t, fine, s_mean) * (ds.sum() / s_mean[-1])


def largest(trajectory: Trajectory, order: int) -> float:
    """Return the largest norm of a trajectory's derivative of this order, over dense samples."""
    duration = trajectory.end_time() - trajectory.start_time()
    times = np.linspace(trajectory.start_time(), trajectory.end_time(), int(duration / KNOTS) * 8 + 9)
    return float(np.linalg.norm(trajectory.MakeDerivative(order).vector_values(times), axis=0).max())


def retime(path: Trajectory, speed: float, acceleration: float) -> PiecewisePolynomial:
    """Return a flight along a path with continuous acceleration; speed and acceleration are 0 at both ends.

    The flight has the ``speed`` [m/s] wherever the acceleration limit [m/s^2] allows, and keeps both limits up to
    TOLERANCE. The path r(u) has any dimension and a continuous second derivative. InputError if the path turns too
    sharply for the limits.
    """
    u = np.linspace(path.start_time(), path.end_time(), SAMPLES)
    r = path.vector_values(u)
    dr, ddr = path.MakeDerivative(1).vector_values(u), path.MakeDerivative(2).vector_values(u)
    ds = np.linalg.norm(np.diff(r, axis=1), axis=0)
    squared = np.sum(dr**2, axis=0)
    squared = np.maximum(squared, 1e-12 * squared.max())  # r' = 0 where the path halts and turns back
    across = ddr - dr * (np.sum(dr * ddr, axis=0) / squared)
    kappa = np.linalg.norm(across, axis=0) / squared
    s = np.concatenate([[0.0], np.cumsum(ds)])
    v_limit, a_limit = speed, acceleration
    # The average mixes speeds from before and after a bend. If this exceeds a limit, use a tighter limit.
    while min(v_limit / speed, a_limit / acceleration) > TIGHTEST:
        t, s_t = averaged_length(ds, fastest_speed(ds, kappa, v_limit, a_limit))
        knots = path.vector_values(np.interp(s_t, s, u))
        rest = np.zeros(len(knots))
        flight = PiecewisePolynomial.CubicWithContinuousSecondDerivatives(t, knots, rest, rest)
        v_excess, a_excess = largest(flight, 1) / speed, largest(flight, 2) / acceleration
        if max(v_excess, a_excess) <= 1.0 + TOLERANCE:
            return flight
        v_limit /= max(1.0, v_excess)
        a_limit /= max(1.0, a_excess)
    x, y = r[:2, int(np.argmax(kappa))]
    raise InputError(f"path: turns too sharply at ({x:.3g}, {y:.3g}) to be flown smoothly")
