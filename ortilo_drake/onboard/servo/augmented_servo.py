"""The LQ servo of a plant whose commands act late."""

from typing import Any

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.loop.element import Array, Box, Element, Number, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U, N_XBAR
from ortilo_drake.model.triples import Four, Triple
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.servo.augmented_gain import delayed_gain
from ortilo_drake.onboard.servo.lq_servo import command
from ortilo_drake.scenario import LqServo


@register_jitable
def augmented_command(
    xbar: np.ndarray,
    reference: np.ndarray,
    before: np.ndarray,
    L_x: np.ndarray,
    L_u: np.ndarray,
    mass: float,
    yaw: float,
    error_form: bool,
    force: np.ndarray | Triple | None,
) -> Four:
    """Return u_k of the estimate, the reference and the commands on the way, see augmented_gain.py.

        u_k = command(xhat, r; L_x) - sum_j L_j (u_{k-j} - u_r),   u_r what holds the reference

    before is [u_{k-1}; ...; u_{k-d}] (4 d), all else as command's.
    """
    at_rest, not_at_all = np.zeros(N_XBAR), np.zeros((N_U, N_XBAR))
    u_r = command(at_rest, reference, not_at_all, mass, yaw, error_form, force)
    u = command(xbar, reference, L_x, mass, yaw, error_form, force)
    feedback = np.zeros(N_U)
    for i in range(N_U):
        for j in range(before.size):
            feedback[i] += L_u[i, j] * (before[j] - u_r[j % N_U])
    return u[0] - feedback[0], u[1] - feedback[1], u[2] - feedback[2], u[3] - feedback[3]


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
    """Output u_k of augmented_command (4)."""
    d = (force[0], force[1], force[2])
    put(augmented_command(belief, reference, before, L_x, L_u, n.mass, n.yaw, n.error_form != 0, d), out)


def augmented_step(control: np.ndarray, before: np.ndarray) -> None:
    """Keep u_k, the oldest goes."""
    for i in range(before.size - 1, N_U - 1, -1):
        before[i] = before[i - N_U]
    put(control[: min(N_U, before.size)], before)


AUGMENTED = Element(
    "augmented_servo",
    out=augmented_out,
    step=augmented_step,
    numbers=(Number("mass"), Number("yaw"), Number("error_form", kind="i8")),
    tables=(Array("L_x", 2), Array("L_u", 2)),
    state=(Array("before"),),
    allocates=True,
)


def augmented_servo_box(settings: LqServo, vehicle: Vehicle, h: float, delay: float) -> Box:
    """Return the servo, `servo`: it reads what servo_box reads; its commands act `delay` [s] after their tick."""
    L = delayed_gain(vehicle, settings.weights, h, delay, settings.yaw)
    numbers = {"mass": vehicle.mass, "yaw": settings.yaw, "error_form": settings.form == "error"}
    hover = np.tile([vehicle.hover_thrust, 0.0, 0.0, 0.0], (L.shape[1] - N_XBAR) // N_U)
    given = Values(numbers, start={"before": hover}, tables={"L_x": L[:, :N_XBAR], "L_u": L[:, N_XBAR:]})
    return Box("servo", AUGMENTED, N_U, given, reads={"control": "servo"})
