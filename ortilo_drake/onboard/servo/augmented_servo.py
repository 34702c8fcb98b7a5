"""The LQ servo of a plant whose commands act late."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.placing import put
from ortilo_drake.model.signals import N_U, N_XBAR
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.servo.augmented_gain import delayed_gain
from ortilo_drake.onboard.servo.lq_servo import command
from ortilo_drake.scenario import LqServo


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
    """Output u_k (4) of the estimate, the reference and the commands on the way, see augmented_gain.py.

        u_k = command(xhat, r; L_x) - sum_j L_j (u_{k-j} - u_r),   u_r what holds the reference

    before is [u_{k-1}; ...; u_{k-d}] (4 d).
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
    """Keep u_k, the oldest goes."""
    for i in range(before.size - 1, N_U - 1, -1):
        before[i] = before[i - N_U]
    put(control[: min(N_U, before.size)], before)


AUGMENTED = Element("augmented_servo", out=augmented_out, step=augmented_step, allocates=True)


def augmented_servo_box(settings: LqServo, vehicle: Vehicle, h: float, delay: float) -> Box:
    """Return the servo, `servo`: it reads what servo_box reads; its commands act `delay` [s] after their tick."""
    L = delayed_gain(vehicle, settings.weights, h, delay, settings.yaw)
    numbers = {"mass": vehicle.mass, "yaw": settings.yaw, "error_form": settings.form == "error"}
    hover = np.tile([vehicle.hover_thrust, 0.0, 0.0, 0.0], (L.shape[1] - N_XBAR) // N_U)
    given = Values(numbers, start={"before": hover}, tables={"L_x": L[:, :N_XBAR], "L_u": L[:, N_XBAR:]})
    return Box("servo", AUGMENTED, N_U, given, reads={"control": "servo"})
