"""The LQ servo (paper, section IV-A)."""

import numpy as np
from numba import njit
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, PAYLOAD, REFERENCE_SIZE, VELOCITY_SIZE
from ortilo_drake.model.vehicle import GRAVITY, Vehicle
from ortilo_drake.onboard.lq_gain import servo_gain
from ortilo_drake.scenario import LqServo as ServoSettings


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
    x_ref = np.zeros(12)
    u = np.zeros(4)
    u[0] = mass * GRAVITY
    if error_form:
        a_x, a_y, a_z = reference[6], reference[7], reference[8]
        x_ref[0:3] = reference[0:3]
        x_ref[3] = (a_x * np.sin(yaw) - a_y * np.cos(yaw)) / GRAVITY
        x_ref[4] = (a_x * np.cos(yaw) + a_y * np.sin(yaw)) / GRAVITY
        x_ref[5] = yaw
        x_ref[6:9] = reference[3:6]
        u[0] += mass * a_z
    for row in range(4):
        for j in range(12):
            u[row] -= L[row, j] * (xbar[j] - x_ref[j])
        for j in range(3):
            u[row] -= L[row, 12 + j] * xbar[12 + j]
    return u


def resting_integral(L: np.ndarray, r: np.ndarray, form: str) -> np.ndarray:
    """Return the i (3) with which the servo holds still at r: 0, in the paper form the one that balances L r."""
    if form == "error":
        return np.zeros(N_I)
    return np.linalg.lstsq(L[:, N_X:], -L[:, :N_I] @ r, rcond=None)[0]


class LqServo(LeafSystem):
    """u_k from the estimate and the reference.

    Ports:
        estimate (15): xhat_{k|k-1} and, in its last three entries, the integral of the position error.
        reference (9): r, r_dot, r_ddot.
        velocity (8): velocity message; only where the scenario lends the servo the truth.
        control (4, output): u_k = [f_T, tau_x, tau_y, tau_z], f_T absolute.

    Memoryless.

    Args:
        settings: form, yaw and weights.
        vehicle: mass and inertia of the model.
        h: tick [s].
    """

    def __init__(self, settings: ServoSettings, vehicle: Vehicle, h: float):
        super().__init__()
        self.set_name("lq_servo")
        self._L = servo_gain(vehicle, settings.weights, h)
        self._mass, self._yaw, self._error_form = vehicle.mass, settings.yaw, settings.form == "error"
        self._borrows_truth = settings.velocities == "truth"
        self._estimate = self.DeclareVectorInputPort("estimate", N_XBAR)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        needs = {self._estimate.ticket(), self._reference.ticket()}
        if self._borrows_truth:
            self._velocity = self.DeclareVectorInputPort("velocity", VELOCITY_SIZE)
            needs.add(self._velocity.ticket())
        self.DeclareVectorOutputPort("control", N_U, self._calc_control, prerequisites_of_calc=needs)

    def _calc_control(self, context: Context, output: BasicVector) -> None:
        xbar = self._estimate.Eval(context)
        if self._borrows_truth:
            xbar = np.concatenate((xbar[:6], self._velocity.Eval(context)[PAYLOAD:], xbar[N_X:]))
        reference = self._reference.Eval(context)
        output.SetFromVector(servo_control(xbar, reference, self._L, self._mass, self._yaw, self._error_form))
