"""Names and layouts of the signals that systems exchange.

Frames: W is the paper's earth frame E (east, north, up), B the body (forward, left, up), C the camera
(right, down, forward). Units are SI, angles in radians.

The world sends the onboard half *messages*. A message is a vector

    [arrived, stamp, payload ...]

with ``arrived`` 1 in the tick in which the message arrives and 0 otherwise, and ``stamp`` the time [s] at which its
content was true. The payloads:

    imu         roll, pitch, yaw [rad]; w_WB_B [rad/s]; specific force f_B [m/s^2]          (9)
    uwb         one range per anchor [m]; then one flag per anchor, 1 if its range is there     (2 n);
                with uwb.kind differences rows of model/range_pairs.py: two anchors, difference [m], flag, age [s]
    shutter     nothing; the picture itself has its own port                                    (0)
    detections  MAX_DETECTIONS rows of (label, score, u_min, v_min, u_max, v_max), label -1 = unused
    fix         p_WB [m] (3), its covariance row by row [m^2] (9)
    <own>       payload of a registered sensor, see model/parts.py
    acted       ACTS rows of (since, stamp, u): the newest commands that acted, newest first: time from which the
                command acts [s], time of the tick that sent it [s], u [N, N m]; stamp is -1 if the failsafe acted
                instead of a command, since is -1 in an unused row; only if a scenario asks for it
    velocity    v_WB [m/s], Euler-angle rates [rad/s]; only if a scenario gives the servo the truth     (6)

A sensor faster than the tick sends n samples in one message per tick. Its payload is n rows [arrived, stamp, payload of
one sample], oldest first, taken at t_k - h + h / n, ..., t_k. The head [arrived, stamp] is the one of the newest sample
that is there.
"""

from typing import Final

import numpy as np

STATE_NAMES: Final = (
    "x", "y", "z", "phi", "theta", "psi",
    "x_dot", "y_dot", "z_dot", "phi_dot", "theta_dot", "psi_dot",
)  # fmt: skip
INTEGRAL_NAMES: Final = ("i_x", "i_y", "i_z")
XBAR_NAMES: Final = (*STATE_NAMES, *INTEGRAL_NAMES)
CONTROL_NAMES: Final = ("f_T", "tau_x", "tau_y", "tau_z")
SENSORS: Final = ("uwb", "camera", "imu")

N_X: Final = 12  # the paper's n
N_U: Final = 4  # the paper's m
N_Y: Final = 9  # the paper's p
N_I: Final = 3  # integral states
N_XBAR: Final = N_X + N_I

ARRIVED: Final = 0
STAMP: Final = 1
PAYLOAD: Final = 2  # index at which a message's payload starts

SHUTTER_SIZE: Final = PAYLOAD
IMU_SIZE: Final = PAYLOAD + 9
FIX_SIZE: Final = PAYLOAD + 12
VELOCITY_SIZE: Final = PAYLOAD + 6
ACTS: Final = 8
ACT_SIZE: Final = 2 + N_U
ACTED_SIZE: Final = PAYLOAD + ACTS * ACT_SIZE
MAX_DETECTIONS: Final = 32
DETECTION_SIZE: Final = 6
DETECTIONS_SIZE: Final = PAYLOAD + MAX_DETECTIONS * DETECTION_SIZE

# The reference: r, its velocity and its acceleration in W.
REFERENCE_SIZE: Final = 9


def uwb_size(anchors: int) -> int:
    """Return the size of a uwb message of ranges to this number of anchors."""
    return PAYLOAD + 2 * anchors


def samples_in(message: np.ndarray, n: int) -> np.ndarray:
    """Return the n samples in a message of a sensor faster than the tick: rows [arrived, stamp, payload] (n, 2 + p)."""
    return message[PAYLOAD:].reshape(n, -1)


def size_of_samples(size: int, n: int) -> int:
    """Return the size of a message with n samples, each of `size` numbers including its own arrived and stamp.

    The result is also the index at which sample n of a longer message begins.
    """
    return PAYLOAD + n * size
