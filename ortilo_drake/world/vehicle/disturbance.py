"""The disturbance: a random force and torque, drawn anew every tick, and the rotors' linear drag."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.equations import rotation_rows
from ortilo_drake.model.placing import put
from ortilo_drake.scenario import Disturbance
from ortilo_drake.world.noise import SlowNoise, put_normals, slow_step, stream_id


def disturbance_out(n: Any, k: int, seed: int, out: np.ndarray) -> None:
    """Output d = [force in W [N], torque in B [N m]] (6), Gaussian with these sds per axis, of one tick."""
    put_normals(out, seed, n.stream, k)
    for i in range(3):
        out[i] *= n.force_sd
        out[3 + i] *= n.torque_sd


def disturbance_box(settings: Disturbance, h: float) -> Box:
    """Return the source of white disturbance, force in W [N] and torque in B [N m] (6)."""
    force_sd, torque_sd = settings.sds(h)
    numbers = {"force_sd": force_sd, "torque_sd": torque_sd, "stream": stream_id("disturbance")}
    return Box("disturbance", Element("disturbance", out=disturbance_out), 6, Values(numbers))


def lasting_out(disturbance: np.ndarray, bias: np.ndarray, x: np.ndarray, out: np.ndarray) -> None:
    """Output the disturbance with its slow part (6), see world/noise.py."""
    for i in range(out.size):
        out[i] = disturbance[i] + (bias[i] + x[i])


LASTING = Element("lasting_force", out=lasting_out, step=slow_step, allocates=True)


def lasting_force_box(noise: SlowNoise, h: float) -> Box:
    """Return the box that adds a lasting force to the disturbance; it is zero unless drawn."""
    numbers, nothing = {"stream": stream_id("slow error/lasting_force"), "h": h}, np.zeros(len(noise.a))
    tables = {"bias": nothing, "a": noise.a, "q": noise.q}
    return Box("lasting_force", LASTING, len(nothing), Values(numbers, start={"x": nothing}, tables=tables))


def drag_out(n: Any, disturbance: np.ndarray, state: np.ndarray, out: np.ndarray) -> None:
    """Output the disturbance (6) with the drag at the true state (12).

    The rotors' discs hold the vehicle back in proportion to its velocity through still air: f_W = -R_WB D R_WB^T v_WB
    with D = diag(c) in B (M. Faessler, A. Franchi and D. Scaramuzza, "Differential flatness of quadrotor dynamics
    subject to rotor drag", IEEE Robotics and Automation Letters 3(2), 2018), taken at the beginning of a tick and held
    over it.
    """
    put(disturbance, out)
    R_WB, v = rotation_rows(state[3:6]), state[6:9]
    for j in range(3):
        along = R_WB[0][j] * v[0] + R_WB[1][j] * v[1] + R_WB[2][j] * v[2]
        for i in range(3):
            out[i] -= R_WB[i][j] * n.drag[j] * along


def drag_box(drag: tuple[float, float, float]) -> Box:
    """Return the box that adds the drag to the disturbance; it reads `disturbance` (6) and the true state (12)."""
    return Box("drag", Element("drag", out=drag_out), 6, Values({"drag": np.array(drag)}))
