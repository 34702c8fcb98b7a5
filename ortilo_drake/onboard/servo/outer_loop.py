"""The servo's outer loop alone: the wanted attitude and thrust, for an autopilot that controls the attitude itself.

The servo's law is u = [m g, 0, 0, 0] - L [x - x_ref; i] (lq_servo.py). At the wanted roll and pitch, phi_r and theta_r,
the servo commands no torque. With rates of 0, and L's rows of tau_x and tau_y written [L_p  L_a  L_v  L_w  L_i],

    L_a [phi_r; theta_r] = -(L_p (p - r) + L_v v + L_i i),      a_z = -(L_f [x - x_ref; i]) / m,

and the horizontal acceleration is the one of this roll and pitch at hover with the heading psi_0:

    a_x = g (theta_r cos psi_0 + phi_r sin psi_0),  a_y = g (theta_r sin psi_0 - phi_r cos psi_0).

The specific force a + g e_z then gives thrust and attitude without a small-angle approximation, at any heading.
"""

import numpy as np

from ortilo_drake.model.vehicle import GRAVITY

_LEAST = 0.2  # smallest vertical specific force, as a share of g, so that the attitude is defined


def wanted_force(L: np.ndarray, mass: float, yaw: float, e: np.ndarray, v: np.ndarray, i: np.ndarray) -> np.ndarray:
    """Return the specific force in W (3) [m/s²] that the servo wants.

    L is the servo's gain about hover (4, 15) at the heading psi_0, `yaw` [rad], e the position error p - r [m], v the
    velocity [m/s] and i the integral (3 each).
    """
    asked = L[:, 0:3] @ e + L[:, 6:9] @ v + L[:, 12:15] @ i
    phi, theta = np.linalg.solve(L[1:3, 3:5], -asked[1:3])
    s, c = np.sin(yaw), np.cos(yaw)
    a = np.array([GRAVITY * (theta * c + phi * s), GRAVITY * (theta * s - phi * c), -asked[0] / mass])
    return np.array([a[0], a[1], max(a[2] + GRAVITY, _LEAST * GRAVITY)])


def attitude_along(f_W: np.ndarray, yaw: float, max_tilt: float) -> tuple[np.ndarray, float]:
    """Return roll, pitch, yaw (3) [rad] that point the thrust along f_W, and the thrust over the mass [m/s²].

    f_W is a specific force in W (3) [m/s²]. If its tilt exceeds max_tilt [rad], its horizontal part is reduced and its
    vertical part is kept.
    """
    across = float(np.hypot(f_W[0], f_W[1]))
    shrink = min(1.0, np.tan(max_tilt) * f_W[2] / across) if across > 0.0 else 1.0
    f = np.array([shrink * f_W[0], shrink * f_W[1], f_W[2]])
    size = float(np.linalg.norm(f))
    x, y, z = f / size
    s, c = np.sin(yaw), np.cos(yaw)
    return np.array([np.arcsin(x * s - y * c), np.arctan2(x * c + y * s, z), yaw]), size
