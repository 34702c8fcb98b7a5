"""The LQ servo (paper, section IV-A), and its gain for commands that act with a delay tau.

The commands on the way are then states. With tau = (d - theta) h, integer d and 0 <= theta < 1, and Gamma(s) = int_0^s
e^(A r) dr B,

    x_{k+1} = Phi x_k + (Gamma(h) - Gamma(theta h)) u_{k-d} + Gamma(theta h) u_{k-d+1}

(K. J. Åström and B. Wittenmark, "Computer-Controlled Systems", on systems with time delay). The state
[x; i; u_{k-1}; ...; u_{k-d}] has no delay. With Q on [x; i] and R on u_k, and for an integer number of ticks, the LQ
gain is L [Phibar^d, Gammabar, Phibar Gammabar, ...]: the gain without delay times the state predicted to the time at
which the command acts.
"""

import math
from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.elementary import sin_cos
from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, PAYLOAD
from ortilo_drake.model.triples import Four, Triple, triple
from ortilo_drake.model.vehicle import GRAVITY, Vehicle
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, lq_gain, weight_matrices
from ortilo_drake.scenario import LqServo, ServoWeights

Reference = tuple[float, float, float, float, float, float, float, float, float]  # x_ref without its rates, which are 0


@register_jitable
def minus_product(u_0: float, row: np.ndarray, xbar: np.ndarray, x_ref: Reference) -> float:
    """Return u_0 - row [x - x_ref; i], given a row (15) of the gain and xbar (15), for any scalar type."""
    u = u_0
    for j in range(9):
        u = u - row[j] * (xbar[j] - x_ref[j])
    for j in range(9, 15):
        u = u - row[j] * xbar[j]
    return u


@register_jitable
def command(
    xbar: np.ndarray,
    reference: np.ndarray,
    L: np.ndarray,
    mass: float,
    yaw: float,
    error_form: bool,
    force: np.ndarray | Triple | None,
) -> Four:
    """Return u = [m g, 0, 0, 0] + u_ff - L [xhat - x_ref; i], with an estimate of [x; i] (15) and a gain L (4, 15).

    Paper form: x_ref = 0 and u_ff = 0, u = -L [xhat; i]. Error form: x_ref = [r, phi_r, theta_r, psi_r, r_dot, 0], with
    the roll and pitch that give the planned acceleration at hover, and u_ff = [m z_ddot_r, 0, 0, 0]. Both forms
    compensate a known disturbance force d, `force`, in W [N]: d / m is subtracted from the planned acceleration.

    The reference is r, r_dot, r_ddot (9), the mass m [kg], the yaw psi_r [rad].
    """
    a_x = a_y = a_z = psi_r = 0.0
    p_r = v_r = (0.0, 0.0, 0.0)
    if error_form:
        p_r, v_r = triple(reference), triple(reference[3:])
        a_x, a_y, a_z, psi_r = reference[6], reference[7], reference[8], yaw
    if force is not None:
        a_x, a_y, a_z = a_x - force[0] / mass, a_y - force[1] / mass, a_z - force[2] / mass
    s_psi, c_psi = sin_cos(yaw)
    phi_r = (a_x * s_psi - a_y * c_psi) / GRAVITY
    theta_r = (a_x * c_psi + a_y * s_psi) / GRAVITY
    x_ref = (*p_r, phi_r, theta_r, psi_r, *v_r)
    u_0 = mass * GRAVITY + mass * a_z
    return (
        minus_product(u_0, L[0], xbar, x_ref),
        minus_product(0.0, L[1], xbar, x_ref),
        minus_product(0.0, L[2], xbar, x_ref),
        minus_product(0.0, L[3], xbar, x_ref),
    )


@cached_njit
def servo_control(
    xbar: np.ndarray,
    reference: np.ndarray,
    L: np.ndarray,
    mass: float,
    yaw: float,
    error_form: bool,
    force: np.ndarray | None = None,  # a default array would be a new type for numba's cache in every process
) -> np.ndarray:
    """Return the control u (4) of `command` as an array; arguments as in `command`."""
    return np.array(command(xbar, reference, L, mass, yaw, error_form, force))


def resting_integral(L: np.ndarray, r: np.ndarray, form: str) -> np.ndarray:
    """Return the integral i (3) with which the servo rests at r: 0, or in the paper form the one that balances L r."""
    if form == "error":
        return np.zeros(N_I)
    return np.linalg.lstsq(L[:, N_X:], -L[:, :N_I] @ r, rcond=None)[0]


def servo_out(
    n: Any, belief: np.ndarray, force: np.ndarray, reference: np.ndarray, L: np.ndarray, out: np.ndarray
) -> None:
    """Output the control u_k (4) of `command`."""
    put(command(belief, reference, L, n.mass, n.yaw, n.error_form, (force[0], force[1], force[2])), out)


def true_velocity_out(belief: np.ndarray, velocity: np.ndarray, out: np.ndarray) -> None:
    """Output the estimate (15) with its velocities replaced by the true velocities in a message."""
    put(belief[:N_XBAR], out)
    put(velocity[PAYLOAD:], out, 6)


SERVO = Element("servo", out=servo_out)
TRUE_VELOCITY = Element("with_true_velocity", out=true_velocity_out)


def servo_box(L: np.ndarray, mass: float, settings: LqServo) -> Box:
    """Return the servo's box; it reads the belief (15 or more), the estimated disturbance force (3), the reference."""
    numbers = {"mass": mass, "yaw": settings.yaw, "error_form": settings.form == "error"}
    return Box("servo", SERVO, N_U, Values(numbers, tables={"L": L}))


def split_delay(delay: float, h: float) -> tuple[int, float]:
    """Return d and theta of a delay [s] in ticks of h [s]; a delay within rounding of a whole tick counts as whole."""
    d = math.ceil(delay / h - 1e-9)
    return d, max(0.0, d - delay / h)


def delayed_pair(vehicle: Vehicle, h: float, delay: float, yaw: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return Phi (n, n) and Gamma (n, 4) of [x; i; u_{k-1}; ...; u_{k-d}], n = 15 + 4 d; delay [s], held yaw [rad]."""
    Phibar, Gammabar = augmented_pair(vehicle, h, yaw)
    d, theta = split_delay(delay, h)
    n = N_XBAR + N_U * d
    Phi, Gamma = np.zeros((n, n)), np.zeros((n, N_U))
    Phi[:N_XBAR, :N_XBAR] = Phibar
    if d == 0:
        return Phibar, Gammabar
    late = np.zeros_like(Gammabar)
    late[:N_X] = discretize(hover_A(yaw), hover_B(vehicle), theta * h)[1]
    Phi[:N_XBAR, n - N_U :] = Gammabar - late
    if d == 1:
        Gamma[:N_XBAR] = late
    else:
        Phi[:N_XBAR, n - 2 * N_U : n - N_U] = late
    Gamma[N_XBAR : N_XBAR + N_U] = np.eye(N_U)
    Phi[N_XBAR + N_U :, N_XBAR : n - N_U] = np.eye(n - N_XBAR - N_U)
    return Phi, Gamma


def delayed_gain(vehicle: Vehicle, weights: ServoWeights, h: float, delay: float, yaw: float = 0.0) -> np.ndarray:
    """Return the gain L (4 x (15 + 4 d)) of delayed_pair; raises as lq_gain."""
    Phi, Gamma = delayed_pair(vehicle, h, delay, yaw)
    Q, R = weight_matrices(weights)
    wide = np.zeros_like(Phi)
    wide[:N_XBAR, :N_XBAR] = Q
    return lq_gain(Phi, Gamma, wide, R)[0]


def augmented_out(
    n: Any,
    belief: np.ndarray,
    force: np.ndarray,
    reference: np.ndarray,
    before: np.ndarray,
    L_x: np.ndarray,
    L_u: np.ndarray,
    out: np.ndarray,
) -> None:
    """Output u_k (4), given the estimate, the reference and the commands on the way.

        u_k = command(xhat, r; L_x) - sum_j L_j (u_{k-j} - u_r),   u_r the feedforward control at the reference

    `before` is [u_{k-1}; ...; u_{k-d}] (4 d).
    """
    known = n.mass, n.yaw, n.error_form, (force[0], force[1], force[2])
    u_r = command(np.zeros(N_XBAR), reference, np.zeros((N_U, N_XBAR)), *known)
    put(command(belief, reference, L_x, *known), out)
    for i in range(N_U):
        feedback = 0.0
        for j in range(before.size):
            feedback += L_u[i, j] * (before[j] - u_r[j % N_U])
        out[i] -= feedback


def augmented_step(control: np.ndarray, before: np.ndarray) -> None:
    """Store u_k in `before` and drop the oldest control."""
    for i in range(before.size - 1, N_U - 1, -1):
        before[i] = before[i - N_U]
    put(control[: min(N_U, before.size)], before)


AUGMENTED = Element("augmented_servo", out=augmented_out, step=augmented_step, allocates=True)


def augmented_servo_box(settings: LqServo, vehicle: Vehicle, h: float, delay: float) -> Box:
    """Return the box `servo` for commands that act `delay` [s] after their tick; inputs as in servo_box."""
    L = delayed_gain(vehicle, settings.weights, h, delay, settings.yaw)
    numbers = {"mass": vehicle.mass, "yaw": settings.yaw, "error_form": settings.form == "error"}
    hover = np.tile([vehicle.hover_thrust, 0.0, 0.0, 0.0], (L.shape[1] - N_XBAR) // N_U)
    given = Values(numbers, start={"before": hover}, tables={"L_x": L[:, :N_XBAR], "L_u": L[:, N_XBAR:]})
    return Box("servo", AUGMENTED, N_U, given, reads={"control": "servo"})
