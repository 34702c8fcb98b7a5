"""The LQ servo (paper, section IV-A): its law, and the system that flies it.

The law is affine in estimate and reference, u = u_0 + D [xhat; i; r; r_dot; r_ddot], so the system is made of Drake's
own blocks: they cost a twentieth of a call into Python, and Drake differentiates them.
"""

import numpy as np
from numba import njit
from numba.extending import register_jitable
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import AffineSystem, Multiplexer

from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, PAYLOAD, REFERENCE_SIZE, VELOCITY_SIZE
from ortilo_drake.model.vehicle import GRAVITY, Vehicle
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import LqServo as ServoSettings


@register_jitable
def less_product(u_0: float, row: np.ndarray, x_error: np.ndarray, xbar: np.ndarray) -> float:
    """Return u_0 - row [x_error; i], i the last three of xbar, term by term; of any scalar."""
    u = u_0
    for j in range(12):
        u = u - row[j] * x_error[j]
    for j in range(12, 15):
        u = u - row[j] * xbar[j]
    return u


@njit(cache=True)
def servo_control(
    xbar: np.ndarray,
    reference: np.ndarray,
    L: np.ndarray,
    mass: float,
    yaw: float,
    error_form: bool,
) -> np.ndarray:
    """Return u = [m g, 0, 0, 0] + u_ff - L [xhat - x_ref; i] (4).

    Paper form: x_ref = 0 and u_ff = 0, u = -L [xhat; i]. Error form: x_ref = [r, phi_r, theta_r, psi_r, r_dot, 0]
    with the roll and pitch that make the planned acceleration at hover, and u_ff = [m z_ddot_r, 0, 0, 0].

    Args:
        xbar: estimate of [x; i], i the integral of the position error (15).
        reference: r, r_dot, r_ddot (9).
        L: servo gain (4, 15).
        mass: m [kg].
        yaw: psi_r [rad].
        error_form: whether to fly the error form.
    """
    u_0 = mass * GRAVITY
    x_ref = np.zeros(12)
    if error_form:
        r, r_dot, a = reference[0:3], reference[3:6], reference[6:9]
        phi_r = (a[0] * np.sin(yaw) - a[1] * np.cos(yaw)) / GRAVITY
        theta_r = (a[0] * np.cos(yaw) + a[1] * np.sin(yaw)) / GRAVITY
        x_ref = np.array([r[0], r[1], r[2], phi_r, theta_r, yaw, r_dot[0], r_dot[1], r_dot[2], 0.0, 0.0, 0.0])
        u_0 += mass * a[2]
    x_error = xbar[:12] - x_ref
    return np.array(
        [
            less_product(u_0, L[0], x_error, xbar),
            less_product(0.0, L[1], x_error, xbar),
            less_product(0.0, L[2], x_error, xbar),
            less_product(0.0, L[3], x_error, xbar),
        ]
    )


def resting_integral(L: np.ndarray, r: np.ndarray, form: str) -> np.ndarray:
    """Return the i (3) with which the servo holds still at r: 0, in the paper form the one that balances L r."""
    if form == "error":
        return np.zeros(N_I)
    return np.linalg.lstsq(L[:, N_X:], -L[:, :N_I] @ r, rcond=None)[0]


def servo_matrices(L: np.ndarray, mass: float, yaw: float, error_form: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return u_0 (4) and D (4 x 24) of servo_control: u = u_0 + D [xbar; reference]."""
    x_ref = np.zeros((N_X, REFERENCE_SIZE))  # x_ref = x_ref [r; r_dot; r_ddot] + psi_r e_6
    u_ff = np.zeros((N_U, REFERENCE_SIZE))
    u_0 = np.array([mass * GRAVITY, 0.0, 0.0, 0.0])
    if error_form:
        x_ref[0:3, 0:3] = x_ref[6:9, 3:6] = np.eye(3)
        x_ref[3, 6:8] = np.sin(yaw) / GRAVITY, -np.cos(yaw) / GRAVITY
        x_ref[4, 6:8] = np.cos(yaw) / GRAVITY, np.sin(yaw) / GRAVITY
        u_ff[0, 8] = mass
        u_0 = u_0 + L[:, 5] * yaw
    return u_0, np.hstack([-L, u_ff + L[:, :N_X] @ x_ref])


def make_lq_servo(settings: ServoSettings, vehicle: Vehicle, h: float) -> Diagram:
    """Return u_k from the estimate and the reference; memoryless.

    Ports:
        estimate (15): xhat_{k|k-1} and, in its last three entries, the integral of the position error.
        reference (9): r, r_dot, r_ddot.
        velocity (8): velocity message; only where the scenario lends the servo the truth.
        control (4, output): u_k = [f_T, tau_x, tau_y, tau_z], f_T absolute.

    Args:
        settings: form, yaw and weights.
        vehicle: mass and inertia of the model.
        h: tick [s].

    Raises:
        InputError: if there is no gain, see lq_gain.
    """
    L = servo_gain(vehicle, settings.weights, h)
    u_0, D = servo_matrices(L, vehicle.mass, settings.yaw, settings.form == "error")
    sizes = {"estimate": N_XBAR, "reference": REFERENCE_SIZE}
    if settings.velocities == "truth":
        sizes["velocity"] = VELOCITY_SIZE
        D = np.hstack([D, np.zeros((N_U, VELOCITY_SIZE))])
        lent, believed = slice(-VELOCITY_SIZE + PAYLOAD, None), slice(N_X // 2, N_X)
        D[:, lent], D[:, believed] = D[:, believed].copy(), 0.0
    builder = DiagramBuilder()
    inputs = builder.AddSystem(Multiplexer(list(sizes.values())))
    n, none = D.shape[1], np.zeros((0, 0))
    law = builder.AddNamedSystem("law", AffineSystem(none, np.zeros((0, n)), np.zeros(0), np.zeros((N_U, 0)), D, u_0))
    builder.Connect(inputs.get_output_port(), law.get_input_port())
    for i, name in enumerate(sizes):
        builder.ExportInput(inputs.get_input_port(i), name)
    builder.ExportOutput(law.get_output_port(), "control")
    servo = builder.Build()
    servo.set_name("lq_servo")
    return servo
