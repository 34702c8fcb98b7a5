"""The LQ servo (paper, section IV-A)."""

from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.elementary import sin_cos
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, PAYLOAD
from ortilo_drake.model.triples import Four, Triple, triple
from ortilo_drake.model.vehicle import GRAVITY
from ortilo_drake.scenario import LqServo as ServoSettings

Reference = tuple[float, float, float, float, float, float, float, float, float]  # x_ref but for its rates, which are 0


@register_jitable
def minus_product(u_0: float, row: np.ndarray, xbar: np.ndarray, x_ref: Reference) -> float:
    """Return u_0 - row [x - x_ref; i] (15), term by term; of any scalar."""
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

    Paper form: x_ref = 0 and u_ff = 0, u = -L [xhat; i]. Error form: x_ref = [r, phi_r, theta_r, psi_r, r_dot, 0] with
    the roll and pitch that make the planned acceleration at hover, and u_ff = [m z_ddot_r, 0, 0, 0]. In either form a
    disturbance force d in W [N] that is known is countered: phi_r, theta_r and u_ff make the acceleration less d / m.
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


@njit(cache=True)
def servo_control(
    xbar: np.ndarray,
    reference: np.ndarray,
    L: np.ndarray,
    mass: float,
    yaw: float,
    error_form: bool,
    force: np.ndarray | None = None,  # an array by default is a new type to numba's cache in every process
) -> np.ndarray:
    """Return u of command (4); arguments as there."""
    return np.array(command(xbar, reference, L, mass, yaw, error_form, force))


def resting_integral(L: np.ndarray, r: np.ndarray, form: str) -> np.ndarray:
    """Return the i (3) with which the servo holds still at r: 0, in the paper form the one that balances L r."""
    if form == "error":
        return np.zeros(N_I)
    return np.linalg.lstsq(L[:, N_X:], -L[:, :N_I] @ r, rcond=None)[0]


def servo_out(
    n: Any, belief: np.ndarray, force: np.ndarray, reference: np.ndarray, L: np.ndarray, out: np.ndarray
) -> None:
    """Output u_k of command (4)."""
    put(command(belief, reference, L, n.mass, n.yaw, n.error_form, (force[0], force[1], force[2])), out)


def true_velocity_out(belief: np.ndarray, velocity: np.ndarray, out: np.ndarray) -> None:
    """Output the estimate (15) with the true velocities of a message in it."""
    put(belief[:N_XBAR], out)
    put(velocity[PAYLOAD:], out, 6)


SERVO = Element("servo", out=servo_out)
TRUE_VELOCITY = Element("with_true_velocity", out=true_velocity_out)


def servo_box(L: np.ndarray, mass: float, settings: ServoSettings) -> Box:
    """Return the servo: it reads the belief (15 or more), the force that is believed to act (3) and the reference."""
    numbers = {"mass": mass, "yaw": settings.yaw, "error_form": settings.form == "error"}
    return Box("servo", SERVO, N_U, Values(numbers, tables={"L": L}))
