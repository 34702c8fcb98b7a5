"""The LQ servo (paper, section IV-A)."""

import sys
from typing import Any

import numpy as np
from numba import njit
from numba.extending import register_jitable
from pydrake.systems.framework import LeafSystem, LeafSystem_
from pydrake.systems.scalar_conversion import TemplateSystem

from ortilo_drake.loop.element import Array, Box, Element, Given, Number
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_I, N_U, N_X, N_XBAR, PAYLOAD, REFERENCE_SIZE, VELOCITY_SIZE
from ortilo_drake.model.triples import Four, Triple, triple
from ortilo_drake.model.vehicle import GRAVITY, Vehicle
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import LqServo as ServoSettings

Reference = tuple[float, float, float, float, float, float, float, float, float]  # x_ref but for its rates, which are 0


@register_jitable
def less_product(u_0: float, row: np.ndarray, xbar: np.ndarray, x_ref: Reference) -> float:
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
    """Return u = [m g, 0, 0, 0] + u_ff - L [xhat - x_ref; i].

    Paper form: x_ref = 0 and u_ff = 0, u = -L [xhat; i]. Error form: x_ref = [r, phi_r, theta_r, psi_r, r_dot, 0]
    with the roll and pitch that make the planned acceleration at hover, and u_ff = [m z_ddot_r, 0, 0, 0]. In either
    form a disturbance force d that is known is countered: phi_r, theta_r and u_ff make the acceleration less d / m.

    Args:
        xbar: estimate of [x; i], i the integral of the position error (15).
        reference: r, r_dot, r_ddot (9).
        L: servo gain (4, 15).
        mass: m [kg].
        yaw: psi_r [rad].
        error_form: whether to fly the error form.
        force: d in W [N] (3); None for none.
    """
    a_x = a_y = a_z = psi_r = 0.0
    p_r = v_r = (0.0, 0.0, 0.0)
    if error_form:
        p_r, v_r = triple(reference), triple(reference[3:])
        a_x, a_y, a_z, psi_r = reference[6], reference[7], reference[8], yaw
    if force is not None:
        a_x, a_y, a_z = a_x - force[0] / mass, a_y - force[1] / mass, a_z - force[2] / mass
    phi_r = (a_x * np.sin(yaw) - a_y * np.cos(yaw)) / GRAVITY
    theta_r = (a_x * np.cos(yaw) + a_y * np.sin(yaw)) / GRAVITY
    x_ref = (*p_r, phi_r, theta_r, psi_r, *v_r)
    u_0 = mass * GRAVITY + mass * a_z
    return (
        less_product(u_0, L[0], xbar, x_ref),
        less_product(0.0, L[1], xbar, x_ref),
        less_product(0.0, L[2], xbar, x_ref),
        less_product(0.0, L[3], xbar, x_ref),
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
    """Say u_k of command (4)."""
    put(command(belief, reference, L, n.mass, n.yaw, n.error_form != 0, (force[0], force[1], force[2])), out)


def lent_out(belief: np.ndarray, velocity: np.ndarray, out: np.ndarray) -> None:
    """Say the estimate (15) with the true velocities of a message in it."""
    put(belief[:N_XBAR], out)
    put(velocity[PAYLOAD:], out, 6)


SERVO = Element(
    "servo",
    out=servo_out,
    numbers=(Number("mass"), Number("yaw"), Number("error_form", kind="i8")),
    tables=(Array("L", 2),),
)
LENT = Element("lent_velocities", out=lent_out)


def servo_box(L: np.ndarray, mass: float, settings: ServoSettings) -> Box:
    """Return the servo: it reads the belief (15 or more), the force that is believed to act (3) and the reference."""
    numbers = {"mass": mass, "yaw": settings.yaw, "error_form": settings.form == "error"}
    return Box("servo", SERVO, N_U, Given(numbers, tables={"L": L}))


# Without a scope Drake reads the sources of all frames to find it.
@TemplateSystem.define("LqServo_", scope=sys.modules[__name__])
def LqServo_(T: type) -> type:
    """Return the servo for a scalar type: float, AutoDiffXd or Expression."""

    class Impl(LeafSystem_[T]):
        """u_k from the estimate and the reference.

        Ports:
            estimate (15): xhat_{k|k-1} and, in its last three entries, the integral of the position error.
            reference (9): r, r_dot, r_ddot.
            force (3): the disturbance force in W that the estimator found [N]; only where it finds one.
            velocity (8): velocity message; only where the scenario lends the servo the truth.
            control (4, output): u_k = [f_T, tau_x, tau_y, tau_z], f_T absolute.

        Memoryless. The equations are those of servo_control: floats run through numba, other scalars through the same
        source in Python.

        Args:
            settings: form, yaw and whether velocities are lent.
            mass: m [kg] of the model.
            L: servo gain (4, 15), see lq_gain.
            takes_force: whether it is told the force.
        """

        def _construct(
            self,
            settings: ServoSettings,
            mass: float,
            L: np.ndarray,
            takes_force: bool = False,
            converter: Any = None,
        ) -> None:
            LeafSystem_[T].__init__(self, converter=converter)
            self.set_name("lq_servo")
            self._settings, self._mass, self._L = settings, mass, L
            self._servo_control = servo_control if T is float else servo_control.py_func
            self._yaw, self._error_form = settings.yaw, settings.form == "error"
            self._borrows_truth = settings.velocities == "truth"
            self._estimate = self.DeclareVectorInputPort("estimate", N_XBAR)
            self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
            needs = {self._estimate.ticket(), self._reference.ticket()}
            self._takes_force = takes_force
            if takes_force:
                self._force = self.DeclareVectorInputPort("force", 3)
                needs.add(self._force.ticket())
            if self._borrows_truth:
                self._velocity = self.DeclareVectorInputPort("velocity", VELOCITY_SIZE)
                needs.add(self._velocity.ticket())
            self.DeclareVectorOutputPort("control", N_U, self._calc_control, prerequisites_of_calc=needs)

        def _construct_copy(self, other: Any, converter: Any = None) -> None:
            Impl._construct(self, other._settings, other._mass, other._L, other._takes_force, converter)

        def _calc_control(self, context: Any, output: Any) -> None:
            xbar = self._estimate.Eval(context)
            if self._borrows_truth:
                xbar = np.concatenate((xbar[:6], self._velocity.Eval(context)[PAYLOAD:], xbar[N_X:]))
            reference = self._reference.Eval(context)
            known = (self._force.Eval(context),) if self._takes_force else ()
            arguments = xbar, reference, self._L, self._mass, self._yaw, self._error_form, *known
            output.set_value(self._servo_control(*arguments))

    return Impl


def make_lq_servo(settings: ServoSettings, vehicle: Vehicle, h: float, takes_force: bool = False) -> LeafSystem:
    """Return the servo of a scenario; InputError if there is no gain.

    Args:
        settings: form, yaw and weights.
        vehicle: mass and inertia of the model.
        h: tick [s].
        takes_force: whether it is told the disturbance force.
    """
    L = servo_gain(vehicle, settings.weights, h, settings.yaw)
    return LqServo_[float](settings, vehicle.mass, L, takes_force)
