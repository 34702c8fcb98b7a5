"""The true wrench of the rotors: their lift and the centre of gravity differ from the mixing's."""

import numpy as np

from ortilo_drake.loop.element import Box, Element, Values
from ortilo_drake.model.signals import N_U
from ortilo_drake.world.vehicle.rotors import put_times


def wrench_matrix(thrust_factor: float, center_of_gravity: np.ndarray) -> np.ndarray:
    """Return T (4 x 4), u = T u_c of a commanded u_c = [f_T, tau_x, tau_y, tau_z].

    Lift that is s times the believed, the thrust factor, makes thrust and the torques of roll and pitch s times as
    large; yaw comes from drag. A centre of gravity at r (r_x, r_y in B [m]; along z it changes nothing) from where it
    is believed to be feels the thrust f e_z turn it by -r x f e_z.
    """
    r_x, r_y = center_of_gravity
    T = np.diag([thrust_factor, thrust_factor, thrust_factor, 1.0])
    T[1, 0], T[2, 0] = -thrust_factor * r_y, thrust_factor * r_x
    return T


def wrench_out(control: np.ndarray, wrench: np.ndarray, out: np.ndarray) -> None:
    """Output u = T u_c (4)."""
    put_times(out, wrench, control)


WRENCH = Element("wrench_error", out=wrench_out)


def wrench_error_box() -> Box:
    """Return the box of the true wrench of rotors without dynamics; T is the identity unless it is drawn."""
    return Box("wrench_error", WRENCH, N_U, Values(tables={"wrench": np.eye(N_U)}))
