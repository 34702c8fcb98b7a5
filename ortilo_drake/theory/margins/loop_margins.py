"""Loop margins at the plant's input: the errors of gain, phase or timing at which the closed loop becomes unstable.

The loop is the sampled one that flies: hover model under a zero-order hold, steady predictor, integrator and LQ gain
(input_loop). Margins of one channel, with the others closed and the closed loop stable (Nyquist; Franklin, Powell,
Workman, Digital Control of Dynamic Systems, chapter 7; L is scalar):

- gain margins: the nearest factors above and below 1 at which 1 + k L(e^{j omega}) = 0, where L is real and negative;
- phase margin: the least |arg(-L)| where |L| = 1;
- delay margin: the least (arg(-L) mod 2 pi) / omega there. A delay of d whole ticks is z^-d = e^{-j omega d}, so for
  whole ticks it is exact: the loop is stable with floor(ticks) more ticks of delay and unstable with one beyond;
- disk margin: alpha = 2 / max |S - T|. The loop is stable with every factor f, gain and phase together, for which
  |f - 1| / |f + 1| < alpha / 2 (Seiler, Packard, Gahinet, IEEE Control Systems 40, 2020, symmetric disk).

For all channels at once S = (I + L)^-1 and T = I - S. Their peaks are of the largest singular value, and the disk
margin allows a different factor in each channel. Singular values compare newtons with newton metres, so they depend on
the units if the filter couples the axes (a V with correlations does). They are therefore taken of R^1/2 L R^-1/2, R the
servo's own weight of the controls. In this scaling the return difference of a full-state LQ loop has no singular value
below 1 (B. D. O. Anderson, J. B. Moore, Optimal Control: Linear Quadratic Methods, 1990; in continuous time).

A loop is (A, B, C): z s = A s + B a, v = C s, closed by a = -v. Frequencies omega are in rad a tick, 0 < omega <= pi.
python-control's stability_margins (0.10.2) is not used. Its polynomials of order 27 have roots crowded about 1: half of
the margins of nominal_imu_uwb_yolo's 26 single-channel loops come out wrong by more than 1e-6, some by a factor of 10.
On frequency data it leaves out omega = pi, where loops with true velocities have their gain margin.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

LOWEST = 1e-4  # rad a tick; below it |L| only rises, by the double integrators and the integral action


class OpenLoop(NamedTuple):
    """An open loop s_{k+1} = A s_k + B a_k, v_k = C s_k, which is closed by a = -v."""

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
    """Return A - B diag(factor) C, the closed loop with each channel's gain multiplied by its factor."""
    return loop.A - loop.B @ (np.broadcast_to(factor, loop.B.shape[1])[:, None] * loop.C)


def spectral_radius(A: np.ndarray) -> float:
    """Return the largest modulus of an eigenvalue of A."""
    return float(abs(np.linalg.eigvals(A)).max())


def frequency_grid() -> np.ndarray:
    """Return frequencies from LOWEST to pi, evenly spaced in their logarithm."""
    return np.geomspace(LOWEST, math.pi, 1500)


def crossings(loop: OpenLoop, omega: np.ndarray, values: np.ndarray, kind: str) -> list[float]:
    """Return the frequencies at which a loop of one channel has |L| = 1 ('gain') or Im L = 0 ('phase'), ascending.

    The values are L at the frequencies omega, ascending; two crossings between neighbours are missed.
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
        bracket = omega[k], omega[k + 1]
        found.append(brentq(lambda w: float(measure(response(loop, w)[0, 0, 0])), *bracket, xtol=1e-14, rtol=1e-13))
    return found


def peak(function: Callable[[float], float], omega: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Return the largest value of a function of frequency, refined about its best grid point, and its frequency."""
    k = int(values.argmax())
    low, high = omega[max(k - 1, 0)], omega[min(k + 1, len(omega) - 1)]
    best = minimize_scalar(lambda w: -function(w), bounds=(low, high), method="bounded", options={"xatol": 1e-10})
    if -best.fun > values[k]:
        return float(-best.fun), float(best.x)
    return float(values[k]), float(omega[k])


SILENT = 1e-12  # |L| below this at every frequency: nothing is fed back


@dataclass(frozen=True)
class DiskMargin:
    """Disk margin alpha, with the gain factors and phase [rad] that it allows separately; inf: a gain without limit."""

    alpha: float
    gain_low: float
    gain_high: float
    phase: float


@dataclass(frozen=True)
class ChannelMargins:
    """Margins of a stable loop of one channel; None for a margin without limit."""

    gain_up: float | None
    """least factor above 1."""
    gain_up_at: float | None
    """its frequency [rad/s]."""
    gain_down: float | None
    """greatest factor below 1."""
    gain_down_at: float | None
    """its frequency [rad/s]."""
    phase: float | None
    """[rad]."""
    phase_at: float | None
    """its frequency [rad/s]."""
    delay: float | None
    """[s]."""
    delay_ticks: float | None
    """the same in ticks."""
    delay_at: float | None
    """its frequency [rad/s]."""
    crossovers: list[float]
    """where |L| = 1 [rad/s]."""
    sensitivity: float
    """peak of |S|."""
    complementary: float
    """peak of |T|."""
    disk: DiskMargin
    """disk margin."""


@dataclass(frozen=True)
class JointMargins:
    """Peaks of the largest singular values of S and T, their frequencies [rad/s], and the disk margin."""

    sensitivity: float
    sensitivity_at: float
    complementary: float
    complementary_at: float
    disk: DiskMargin


def disk_margin(difference: float) -> DiskMargin:
    """Return the disk margin from max |S - T|."""
    alpha = 2.0 / difference
    return DiskMargin(
        alpha=alpha,
        gain_low=(2.0 - alpha) / (2.0 + alpha) if alpha < 2.0 else 0.0,
        gain_high=(2.0 + alpha) / (2.0 - alpha) if alpha < 2.0 else math.inf,
        phase=2.0 * math.atan(alpha / 2.0),
    )


def gain_crossings(loop: OpenLoop, omega: np.ndarray, L: np.ndarray) -> list[tuple[float, float]]:
    """Return (factor k, frequency) with 1 + k L = 0 for every crossing of the negative real axis, ends included."""
    frequencies = [*crossings(loop, omega, L, "phase"), math.pi]
    if np.linalg.cond(np.eye(len(loop.A)) - loop.A) < 1e10:
        frequencies.append(0.0)
    values = response(loop, np.array(frequencies))[:, 0, 0].real
    return [(-1.0 / value, w) for value, w in zip(values, frequencies, strict=True) if value < -SILENT]


def channel_margins(loop: OpenLoop, h: float) -> ChannelMargins:
    """Return the margins of a stable loop of one channel with ticks of h [s]."""
    omega = frequency_grid()
    L = response(loop, omega)[:, 0, 0]
    at_real_axis = gain_crossings(loop, omega, L)
    up = min((c for c in at_real_axis if c[0] > 1.0), default=None)
    down = max((c for c in at_real_axis if c[0] < 1.0), default=None)
    crossovers = np.array(crossings(loop, omega, L, "gain"))
    angles = np.angle(-response(loop, crossovers)[:, 0, 0]) if len(crossovers) else np.zeros(0)
    phase = min(zip(abs(angles), crossovers, strict=True), default=None)
    late = min(zip(np.mod(angles, 2.0 * math.pi) / crossovers, crossovers, strict=True), default=None)

    def at(margin: tuple[float, float] | None) -> tuple[float | None, float | None]:
        """Return a margin and its frequency [rad/s]."""
        return (None, None) if margin is None else (float(margin[0]), float(margin[1] / h))

    ticks, late_at = at(late)
    S, T, difference = peaks(loop, omega)
    return ChannelMargins(
        *at(up),
        *at(down),
        *at(phase),
        delay=None if ticks is None else ticks * h,
        delay_ticks=ticks,
        delay_at=late_at,
        crossovers=[float(w / h) for w in crossovers],
        sensitivity=S[0],
        complementary=T[0],
        disk=disk_margin(difference[0]),
    )


def peaks(loop: OpenLoop, omega: np.ndarray) -> list[tuple[float, float]]:
    """Return the peaks of the largest singular values of S, T and S - T over a grid, and their frequencies."""
    eye = np.eye(loop.B.shape[1])

    def of(weight_S: float, weight_I: float) -> tuple[float, float]:
        def values(w: np.ndarray) -> np.ndarray:
            S = np.linalg.inv(eye + response(loop, w))
            return np.linalg.norm(weight_S * S + weight_I * eye, 2, axis=(1, 2))

        return peak(lambda w: float(values(np.array([w]))[0]), omega, values(omega))

    return [of(1.0, 0.0), of(-1.0, 1.0), of(2.0, -1.0)]


def joint_margins(loop: OpenLoop, h: float, R: np.ndarray) -> JointMargins:
    """Return the margins for all controls at once; h is the tick [s], R (m) the diagonal of the control weights."""
    loop = loop._replace(B=loop.B / np.sqrt(R), C=np.sqrt(R)[:, np.newaxis] * loop.C)
    S, T, difference = peaks(loop, frequency_grid())
    return JointMargins(
        sensitivity=S[0],
        sensitivity_at=S[1] / h,
        complementary=T[0],
        complementary_at=T[1] / h,
        disk=disk_margin(difference[0]),
    )
