"""The state at the time at which a command will act, from the state of its tick and the commands on the way.

For a constant delay tau that is the predictor of Z. Artstein, "Linear systems with delayed controls: a reduction", IEEE
Trans. Automatic Control 27 (1982): with z_k = x(t_k + tau), z_{k+1} = Phi z_k + Gamma u_k has no delay, so the servo
that stabilises the plant without one stabilises z, with the same eigenvalues.
"""

from typing import Any

import numpy as np
from numba import njit

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.hover import hover_A, hover_B, hover_B_d
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_XBAR, REFERENCE_SIZE
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.commands.timeline import unpacked


@njit(cache=True)
def predicted_state(x: np.ndarray, b: np.ndarray, A: np.ndarray, s: float) -> np.ndarray:
    """Return x after s [s] of x_dot = A x + b; exact for A^4 = 0.

    x(s) = x + sum_k A^(k-1) (A x + b) s^k / k!, k = 1..4.
    """
    after, term = x.copy(), A @ x + b
    for k in range(1, 5):
        term = term * (s / k)
        after += term
        term = A @ term
    return after


@njit(cache=True)
def reference_after(reference: np.ndarray, s: float) -> np.ndarray:
    """Return r, r_dot, r_ddot (9) after s [s] of the present acceleration."""
    later = reference.copy()
    later[:3] += s * reference[3:6] + 0.5 * s * s * reference[6:9]
    later[3:6] += s * reference[6:9]
    return later


@njit(cache=True)
def state_ahead(
    xbar: np.ndarray,
    reference: np.ndarray,
    rows: np.ndarray,
    t: float,
    tau: float,
    h: float,
    A: np.ndarray,
    B: np.ndarray,
    b: np.ndarray,
) -> np.ndarray:
    """Return [x; i] (15) at time t + tau [s], of that at the tick t and the timeline's rows (n, 5), see timeline.py.

    The integral goes on as in the servo's model, i_{k+1} = i_k + r_k - p_k; of a tick that tau ends within, by the
    share of it. The reference is r, r_dot, r_ddot at t (9). x_dot = A x + B u + b of the hover model, b -B times the
    control at hover, and known disturbances (12).
    """
    x, i = xbar[:12].copy(), xbar[12:].copy()
    done = 0.0
    while done < tau:
        step = min(h, tau - done)
        i += step / h * (reference_after(reference, done)[:3] - x[:3])
        for j in range(len(rows)):
            start = max(rows[j, 0], t + done)
            stop = t + done + step if j + 1 == len(rows) else min(rows[j + 1, 0], t + done + step)
            if stop > start:
                x = predicted_state(x, B @ rows[j, 1:] + b, A, stop - start)
        done += h
    return np.concatenate((x, i))


def ahead_out(
    n: Any,
    k: int,
    belief: np.ndarray,
    reference: np.ndarray,
    timeline: np.ndarray,
    force: np.ndarray,
    A: np.ndarray,
    B: np.ndarray,
    lift: np.ndarray,
    by_force: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output [x; i] (15) and the reference (9) at t_k + tau."""
    tau, b = timeline[0], lift + by_force @ force
    put(state_ahead(belief[:N_XBAR], reference, unpacked(timeline), k * n.h, tau, n.h, A, B, b), out)
    put(reference_after(reference, tau), out, N_XBAR)


AHEAD = Element("state_ahead", out=ahead_out, allocates=True)


def state_ahead_box(vehicle: Vehicle, h: float, yaw: float) -> Box:
    """Return the box of the state that the servo acts on; it reads belief (15 or more), reference, timeline, force (3).

    It says `belief` (15) and `reference` (9), both at the time at which the servo's command will act.
    """
    B = hover_B(vehicle)
    tables = {"A": hover_A(yaw), "B": B, "lift": -B[:, 0] * vehicle.hover_thrust, "by_force": hover_B_d(vehicle)[:, :3]}
    parts = {"belief": (0, N_XBAR), "reference": (N_XBAR, REFERENCE_SIZE)}
    return Box("state_ahead", AHEAD, N_XBAR + REFERENCE_SIZE, Values({"h": h}, tables=tables), parts=parts)
