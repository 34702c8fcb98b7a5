"""The quadrotor's equations of motion, once, for simulation, linearisation and symbols.

numba compiles every function here for floats. The ``.py_func`` of a compiled function is the same source in plain
Python and runs on arrays of Drake's AutoDiffXd and Expression. So the functions use ``np.`` functions only, build
arrays from tuples, ``np.array((...))``, and have no branches on values. numba takes nine times as long to compile an
array of nested lists.

State x = [p_WB, rpy, v_WB, rpy rates] (12), control u = [f_T, tau_x, tau_y, tau_z] with f_T absolute, and the
disturbance d = [force in W [N], torque in B [N m]] (6). Angles are roll phi, pitch theta, yaw psi with
R_WB = R_z(psi) R_y(theta) R_x(phi).
"""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.elementary import sin_cos
from ortilo_drake.model.triples import Six, Triple, Twelve
from ortilo_drake.model.vehicle import GRAVITY


@register_jitable
def thrust_direction(phi: float, theta: float, psi: float) -> Triple:
    """Return the body's z axis in W (3), the third column of R_WB (paper, equations of motion)."""
    (s_phi, c_phi), (s_theta, c_theta), (s_psi, c_psi) = sin_cos(phi), sin_cos(theta), sin_cos(psi)
    return (
        c_phi * s_theta * c_psi + s_phi * s_psi,
        c_phi * s_theta * s_psi - s_phi * c_psi,
        c_phi * c_theta,
    )


@register_jitable
def rotation_rows(rpy: np.ndarray) -> tuple[Triple, Triple, Triple]:
    """Return the rows of R_WB = R_z(psi) R_y(theta) R_x(phi), given roll, pitch, yaw (3) [rad]."""
    (s_phi, c_phi), (s_theta, c_theta), (s_psi, c_psi) = sin_cos(rpy[0]), sin_cos(rpy[1]), sin_cos(rpy[2])
    return (
        (c_theta * c_psi, s_phi * s_theta * c_psi - c_phi * s_psi, c_phi * s_theta * c_psi + s_phi * s_psi),
        (c_theta * s_psi, s_phi * s_theta * s_psi + c_phi * c_psi, c_phi * s_theta * s_psi - s_phi * c_psi),
        (-s_theta, s_phi * c_theta, c_phi * c_theta),
    )


@register_jitable
def rotation(rpy: np.ndarray) -> np.ndarray:
    """Return R_WB (3, 3), see rotation_rows."""
    return np.array(rotation_rows(rpy))


rotation_matrix = cached_njit(rotation)


@register_jitable(error_model="numpy")
def translational_acceleration(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float) -> Triple:
    """Return the paper's x_ddot, y_ddot, z_ddot [m/s^2]: (f_T / m) z_B - g e_z, plus the disturbance force over m."""
    z_B = thrust_direction(x[3], x[4], x[5])
    return (
        u[0] / mass * z_B[0] + d[0] / mass,
        u[0] / mass * z_B[1] + d[1] / mass,
        u[0] / mass * z_B[2] - GRAVITY + d[2] / mass,
    )


@register_jitable(error_model="numpy")
def linear_translational_acceleration(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float) -> Triple:
    """Return x_ddot, y_ddot, z_ddot [m/s^2] of translational_acceleration, linearised at hover."""
    return GRAVITY * x[4] + d[0] / mass, -GRAVITY * x[3] + d[1] / mass, u[0] / mass - GRAVITY + d[2] / mass


@register_jitable
def velocity_rate(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, kinematics: int) -> Triple:
    """Return v_dot of the dynamics with the index `kinematics` in KINEMATICS."""
    if kinematics == 0:
        return linear_translational_acceleration(x, u, d, mass)
    return translational_acceleration(x, u, d, mass)


@register_jitable(error_model="numpy")
def angular_acceleration(w: np.ndarray, u: np.ndarray, d: np.ndarray, inertia: np.ndarray) -> Triple:
    """Return w_dot [rad/s^2] by Euler's equations about the principal axes, the paper's rotational equations."""
    I_x, I_y, I_z = inertia[0], inertia[1], inertia[2]
    return (
        (I_y - I_z) / I_x * w[1] * w[2] + (u[1] + d[3]) / I_x,
        (I_z - I_x) / I_y * w[0] * w[2] + (u[2] + d[4]) / I_y,
        (I_x - I_y) / I_z * w[0] * w[1] + (u[3] + d[5]) / I_z,
    )


@register_jitable
def small_angle_accelerations(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray) -> Six:
    """Return v_dot and rpy_ddot of the paper's nonlinear equations, which use the Euler rates as body rates.

    x is the state (12), u the control (4), d the disturbance (6), mass is m [kg], inertia is I_x, I_y, I_z [kg m^2].
    """
    return translational_acceleration(x, u, d, mass) + angular_acceleration(x[9:12], u, d, inertia)


@register_jitable
def rates_about_axes(rpy: np.ndarray, rpy_dot: np.ndarray) -> Triple:
    """Return the body rates w_WB_B = E(rpy) rpy_dot [rad/s], given the Euler-angle rates."""
    (s_phi, c_phi), (s_theta, c_theta) = sin_cos(rpy[0]), sin_cos(rpy[1])
    return (
        rpy_dot[0] - s_theta * rpy_dot[2],
        c_phi * rpy_dot[1] + s_phi * c_theta * rpy_dot[2],
        -s_phi * rpy_dot[1] + c_phi * c_theta * rpy_dot[2],
    )


@register_jitable
def body_rates(rpy: np.ndarray, rpy_dot: np.ndarray) -> np.ndarray:
    """Return the body rates of rates_about_axes as an array (3)."""
    return np.array(rates_about_axes(rpy, rpy_dot))


@register_jitable
def euler_rates(rpy: np.ndarray, w: np.ndarray) -> Triple:
    """Return the Euler-angle rates rpy_dot = E(rpy)^-1 w [rad/s], given body rates; singular at theta = +-pi/2."""
    (s_phi, c_phi), (s_theta, c_theta) = sin_cos(rpy[0]), sin_cos(rpy[1])
    psi_dot = (s_phi * w[1] + c_phi * w[2]) / c_theta
    return w[0] + s_theta * psi_dot, c_phi * w[1] - s_phi * w[2], psi_dot


@register_jitable
def euler_rate_matrix(rpy: np.ndarray) -> np.ndarray:
    """Return the matrix E(rpy) (3, 3) of body_rates."""
    E = np.zeros((3, 3))
    for i in range(3):
        E[:, i] = body_rates(rpy, np.eye(3)[i])
    return E


@register_jitable(error_model="numpy")
def rigid_body_accelerations(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray) -> Six:
    """Return v_dot and rpy_ddot of the rigid body with exact Euler-rate kinematics; singular at theta = +-pi/2.

    w = E(rpy) rpy_dot, so rpy_ddot = E^-1 (w_dot - E_dot rpy_dot), with w_dot from Euler's equations.
    Arguments as in small_angle_accelerations.
    """
    phi_dot, theta_dot, psi_dot = x[9], x[10], x[11]
    (s_phi, c_phi), (s_theta, c_theta) = sin_cos(x[3]), sin_cos(x[4])
    a = translational_acceleration(x, u, d, mass)
    w_dot = angular_acceleration(rates_about_axes(x[3:6], x[9:12]), u, d, inertia)
    # b = w_dot - E_dot rpy_dot
    b_x = w_dot[0] + c_theta * theta_dot * psi_dot
    b_y = w_dot[1] + s_phi * phi_dot * theta_dot - (c_phi * c_theta * phi_dot - s_phi * s_theta * theta_dot) * psi_dot
    b_z = w_dot[2] + c_phi * phi_dot * theta_dot + (s_phi * c_theta * phi_dot + c_phi * s_theta * theta_dot) * psi_dot
    # E^-1 b
    psi_ddot = (s_phi * b_y + c_phi * b_z) / c_theta
    theta_ddot = c_phi * b_y - s_phi * b_z
    phi_ddot = b_x + s_theta * psi_ddot
    return (*a, phi_ddot, theta_ddot, psi_ddot)


@register_jitable(error_model="numpy")
def linear_accelerations(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray) -> Six:
    """Return v_dot and rpy_ddot of the paper's equations linearised at hover; see small_angle_accelerations."""
    turning = ((u[1] + d[3]) / inertia[0], (u[2] + d[4]) / inertia[1], (u[3] + d[5]) / inertia[2])
    return linear_translational_acceleration(x, u, d, mass) + turning


@register_jitable
def rates_of(x: np.ndarray, a: Six) -> np.ndarray:
    """Return x_dot (12), given a state and its accelerations v_dot, rpy_ddot."""
    return np.array((x[6], x[7], x[8], x[9], x[10], x[11], a[0], a[1], a[2], a[3], a[4], a[5]))


def linear_dynamics(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray) -> np.ndarray:
    """Return x_dot (12) with the accelerations of linear_accelerations."""
    return rates_of(x, linear_accelerations(x, u, d, mass, inertia))


def small_angle_dynamics(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray) -> np.ndarray:
    """Return x_dot (12) with the accelerations of small_angle_accelerations."""
    return rates_of(x, small_angle_accelerations(x, u, d, mass, inertia))


def rigid_body_dynamics(x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray) -> np.ndarray:
    """Return x_dot (12) with the accelerations of rigid_body_accelerations."""
    return rates_of(x, rigid_body_accelerations(x, u, d, mass, inertia))


KINEMATICS = ("linear", "small_angle", "rigid_body")

# The three dynamics, compiled; the py_func of each is the plain Python form.
DYNAMICS = {
    "linear": cached_njit(linear_dynamics),
    "small_angle": cached_njit(small_angle_dynamics),
    "rigid_body": cached_njit(rigid_body_dynamics),
}


@register_jitable
def accelerations(
    x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray, kinematics: int
) -> Six:
    """Return v_dot and rpy_ddot of the dynamics with the index `kinematics` in KINEMATICS."""
    if kinematics == 0:
        return linear_accelerations(x, u, d, mass, inertia)
    if kinematics == 1:
        return small_angle_accelerations(x, u, d, mass, inertia)
    return rigid_body_accelerations(x, u, d, mass, inertia)


@register_jitable
def advanced(x: Twelve, t: float, v: Six, a: Six) -> Twelve:
    """Return x + t x_dot, x_dot = [v, a]."""
    return (
        x[0] + t * v[0],
        x[1] + t * v[1],
        x[2] + t * v[2],
        x[3] + t * v[3],
        x[4] + t * v[4],
        x[5] + t * v[5],
        x[6] + t * a[0],
        x[7] + t * a[1],
        x[8] + t * a[2],
        x[9] + t * a[3],
        x[10] + t * a[4],
        x[11] + t * a[5],
    )


@register_jitable
def runge_kutta_sum(k_1: Six, k_2: Six, k_3: Six, k_4: Six) -> Six:
    """Return k_1 + 2 k_2 + 2 k_3 + k_4."""
    return (
        k_1[0] + 2.0 * k_2[0] + 2.0 * k_3[0] + k_4[0],
        k_1[1] + 2.0 * k_2[1] + 2.0 * k_3[1] + k_4[1],
        k_1[2] + 2.0 * k_2[2] + 2.0 * k_3[2] + k_4[2],
        k_1[3] + 2.0 * k_2[3] + 2.0 * k_3[3] + k_4[3],
        k_1[4] + 2.0 * k_2[4] + 2.0 * k_3[4] + k_4[4],
        k_1[5] + 2.0 * k_2[5] + 2.0 * k_3[5] + k_4[5],
    )


@register_jitable
def stepped(
    x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray, kinematics: int, h: float
) -> Twelve:
    """Return x after h [s] with constant u and d, as a tuple (12); see step."""
    x_1 = (x[0], x[1], x[2], x[3], x[4], x[5], x[6], x[7], x[8], x[9], x[10], x[11])
    a_1 = accelerations(x_1, u, d, mass, inertia, kinematics)
    x_2 = advanced(x_1, h / 2.0, x_1[6:], a_1)
    a_2 = accelerations(x_2, u, d, mass, inertia, kinematics)
    x_3 = advanced(x_1, h / 2.0, x_2[6:], a_2)
    a_3 = accelerations(x_3, u, d, mass, inertia, kinematics)
    x_4 = advanced(x_1, h, x_3[6:], a_3)
    a_4 = accelerations(x_4, u, d, mass, inertia, kinematics)
    return advanced(
        x_1, h / 6.0, runge_kutta_sum(x_1[6:], x_2[6:], x_3[6:], x_4[6:]), runge_kutta_sum(a_1, a_2, a_3, a_4)
    )


@cached_njit
def step(
    x: np.ndarray, u: np.ndarray, d: np.ndarray, mass: float, inertia: np.ndarray, kinematics: int, h: float
) -> np.ndarray:
    """Return x after h [s] with constant u and d: one step of the classical fourth-order Runge-Kutta method.

    x (12) is the state, u (4) the control, d (6) the disturbance, mass m [kg], inertia I_x, I_y, I_z [kg m^2];
    `kinematics` is an index in KINEMATICS.
    """
    return np.array(stepped(x, u, d, mass, inertia, kinematics, h))
