"""Linear rotor drag: the rotors' discs hold the vehicle back in proportion to its velocity through still air.

f_W = -R_WB D R_WB^T v_WB with D = diag(c) in B (M. Faessler, A. Franchi and D. Scaramuzza, "Differential flatness of
quadrotor dynamics subject to rotor drag", IEEE Robotics and Automation Letters 3(2), 2018). It is taken at the
beginning of a tick and held over it, as every force that is no control is.
"""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, Element, Number, Values
from ortilo_drake.model.equations import rotation_rows
from ortilo_drake.model.placing import put


def drag_out(n: Any, disturbance: np.ndarray, state: np.ndarray, out: np.ndarray) -> None:
    """Output the disturbance (6) with the drag at the true state (12)."""
    put(disturbance, out)
    R_WB, v = rotation_rows(state[3:6]), state[6:9]
    for j in range(3):
        along = R_WB[0][j] * v[0] + R_WB[1][j] * v[1] + R_WB[2][j] * v[2]
        for i in range(3):
            out[i] -= R_WB[i][j] * n.drag[j] * along


DRAG = Element("drag", out=drag_out, numbers=(Number("drag", (3,)),))


def drag_box(drag: tuple[float, float, float]) -> Box:
    """Return the box that adds the drag to the disturbance; it reads `disturbance` (6) and the true state (12)."""
    return Box("drag", DRAG, 6, Values({"drag": np.array(drag)}))
