"""Frequency response of a sampled loop and the places where it meets the real axis and the unit circle.

A loop is (A, B, C): z s = A s + B a, v = C s, closed by a = -v. Frequencies omega are in rad a tick, 0 < omega <= pi.

python-control's stability_margins (0.10.2) is not used. Its polynomials of order 27 have roots crowded about 1: half of
the margins of nominal_imu_uwb_yolo's 26 single-channel loops come out wrong by more than 1e-6, some by a factor of 10.
On frequency data it leaves out omega = pi, where loops with true velocities have their gain margin.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

LOWEST = 1e-4  # rad a tick; below it |L| only rises, by the double integrators and the integral action


class OpenLoop(NamedTuple):
    """s_{k+1} = A s_k + B a_k, v_k = C s_k; the loop is closed by a = -v."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray


def response(loop: OpenLoop, omega: np.ndarray) -> np.ndarray:
    """Return L(e^{j omega}) = C (e^{j omega} I - A)^-1 B for every omega (k x p x m)."""
    n = len(loop.A)
    z = np.exp(1j * np.atleast_1d(omega))
    return loop.C @ np.linalg.solve(
        z[:, None, None] * np.eye(n) - loop.A, np.broadcast_to(loop.B, (len(z), *loop.B.shape))
    )


def one_channel(loop: OpenLoop, channel: int) -> OpenLoop:
    """Return the loop of one channel with all others closed."""
    others = [k for k in range(loop.B.shape[1]) if k != channel]
    A = loop.A - loop.B[:, others] @ loop.C[others]
    return OpenLoop(A, loop.B[:, [channel]], loop.C[[channel]])


def closed(loop: OpenLoop, factor: complex | np.ndarray = 1.0) -> np.ndarray:
    """Return A - B diag(factor) C, the closed loop with each channel's gain multiplied."""
    return loop.A - loop.B @ (np.broadcast_to(factor, loop.B.shape[1])[:, None] * loop.C)


def spectral_radius(A: np.ndarray) -> float:
    """Return the largest modulus of an eigenvalue."""
    return float(abs(np.linalg.eigvals(A)).max())


def frequency_grid() -> np.ndarray:
    """Return frequencies from LOWEST to pi, evenly spaced in their logarithm."""
    return np.geomspace(LOWEST, math.pi, 1500)


def _scalar(loop: OpenLoop, omega: float) -> complex:
    return complex(response(loop, np.array([omega]))[0, 0, 0])


def crossings(loop: OpenLoop, omega: np.ndarray, values: np.ndarray, kind: str) -> list[float]:
    """Return the frequencies at which a scalar loop has |L| = 1 ('gain') or Im L = 0 ('phase'), ascending.

    Args:
        loop: a loop of one channel.
        omega: frequencies, ascending; two crossings between neighbouring frequencies are missed.
        values: L there.
        kind: 'gain' or 'phase'.
    """

    def measure(L: np.ndarray) -> np.ndarray:
        return np.log(np.abs(L)) if kind == "gain" else np.sin(np.angle(L))

    m = measure(values)
    # At omega = pi the imaginary part is 0 up to rounding. The last step is left out here; the caller adds pi.
    changes = np.flatnonzero((m[:-1] * m[1:] < 0.0) & ((kind == "gain") | (np.arange(len(m) - 1) < len(m) - 2)))
    found = []
    for k in changes:
        if kind == "phase" and values[k].real > 0.0:
            continue  # the positive real axis, or the cut of the angle
        found.append(
            brentq(lambda w: float(measure(np.array(_scalar(loop, w)))), omega[k], omega[k + 1], xtol=1e-14, rtol=1e-13)
        )
    return found


def peak(function: Callable[[float], float], omega: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Return the largest value of a function over frequency, refined about the grid's best point, and its frequency.

    Args:
        function: of one frequency, to a float.
        omega: grid.
        values: the function on it.
    """
    k = int(values.argmax())
    low, high = omega[max(k - 1, 0)], omega[min(k + 1, len(omega) - 1)]
    best = minimize_scalar(lambda w: -function(w), bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    if -best.fun > values[k]:
        return float(-best.fun), float(best.x)
    return float(values[k]), float(omega[k])
