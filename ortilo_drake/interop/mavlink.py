"""The onboard estimate as MAVLink 2 messages, so that a PX4 could fly with it.

MAVLink's frames are N (north, east, down) for the earth and F (forward, right, down) for the body. Our frames are W
(east, north, up) and B (forward, left, up):

    p_N = T p_W,  R_NF = T R_WB F,  T = [0 1 0; 1 0 0; 0 0 -1],  F = diag(1, -1, -1),
    roll, pitch, yaw of R_NF = phi, -theta, pi/2 - psi.

ODOMETRY (#331) carries the pose in MAV_FRAME_LOCAL_NED and the twist in MAV_FRAME_BODY_FRD. PX4 (mavlink_receiver.cpp,
VehicleOdometry.msg) treats the message as external vision if the estimator's type is VISION or VIO. PX4 uses the
variances, not the correlations; it takes the variances of the orientation for those of a rotation vector in the body.
VISION_POSITION_ESTIMATE (#102) carries the pose with Euler angles and their covariance. Covariances are propagated to
first order. SET_ATTITUDE_TARGET (#82) demands an attitude of F in N and a thrust, 0 to 1 of the largest. PX4 follows
the demand in its offboard mode; when the messages stop, it does what its parameter COM_OBL_RC_ACT says.

The functions return the fields of messages by their MAVLink names and need no package.
"""

import math
import socket
import threading
from importlib import import_module
from typing import Any

import numpy as np

from ortilo_drake.model.equations import body_rates, euler_rate_matrix, rotation_matrix
from ortilo_drake.model.inputs.numbers import is_port
from ortilo_drake.model.optional import check_installed
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.tight.inertial import quaternion_of

DEFAULT_URL = "udpout:127.0.0.1:14580"  # the port on which a simulated PX4 listens for a companion computer
MAV_FRAME_LOCAL_NED = 1
MAV_FRAME_BODY_FRD = 12
MAV_ESTIMATOR_TYPE_VIO = 3
ATTITUDE_ALONE = 7  # type_mask: PX4 must ignore the body rates
MOST_THRUST = 0.9  # upper limit of the thrust demanded, as a share of the largest thrust
COMPONENT = 197  # MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY
TEXT = 50  # length of a STATUSTEXT [bytes]
CRITICAL, WARNING, NOTICE = 2, 4, 5  # values of MAV_SEVERITY
WAIT = 0.2  # longest wait for a packet [s]

T = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
F = np.diag([1.0, -1.0, -1.0])
_UPPER = np.triu_indices(6)


def euler_ned(rpy: np.ndarray) -> np.ndarray:
    """Return roll, pitch, yaw of F in N (3) [rad], yaw in (-pi, pi], from roll, pitch, yaw of B in W (3) [rad]."""
    yaw = math.pi / 2.0 - rpy[2]
    return np.array([rpy[0], -rpy[1], math.pi - (math.pi - yaw) % (2.0 * math.pi)])


def quaternion_ned(rpy: np.ndarray) -> np.ndarray:
    """Return q_NF = (w, x, y, z), w >= 0, from roll, pitch, yaw of F in N (3) [rad]."""
    q = quaternion_of(rpy)
    return q if q[0] >= 0.0 else -q


def odometry_jacobian(x: np.ndarray) -> np.ndarray:
    """Return d[p_N, r, v_F, w_F] / dx (12 x 12) at x (12); r is the rotation vector in F of a small turn of the body.

    With v_B = R_WB^T v_W and r_B = E drpy:  dv_B = R_WB^T dv_W + [v_B]x r_B,  dw_B = E drpy_dot + dE rpy_dot.
    """
    rpy, rpy_dot = x[3:6], x[9:12]
    R_WB, E = rotation_matrix(rpy), euler_rate_matrix(rpy)
    v_B, w_B = R_WB.T @ x[6:9], E @ rpy_dot
    s_phi, c_phi, s_theta, c_theta = np.sin(rpy[0]), np.cos(rpy[0]), np.sin(rpy[1]), np.cos(rpy[1])
    dw_dphi = np.array([0.0, w_B[2], -w_B[1]])
    dw_dtheta = -rpy_dot[2] * np.array([c_theta, s_phi * s_theta, c_phi * s_theta])
    J = np.zeros((12, N_X))
    J[0:3, 0:3] = T
    J[3:6, 3:6] = F @ E
    J[6:9, 3:6] = F @ np.cross(v_B, E.T).T
    J[6:9, 6:9] = F @ R_WB.T
    J[9:12, 3:6] = F @ np.column_stack([dw_dphi, dw_dtheta, np.zeros(3)])
    J[9:12, 9:12] = F @ E
    return J


def upper_triangle(C: np.ndarray) -> list[float]:
    """Return a symmetric C (6 x 6) in MAVLink's form: the 21 entries of the upper right triangle, row by row."""
    return [float(value) for value in C[_UPPER]]


def odometry_fields(
    t: float, estimate: np.ndarray, covariance: np.ndarray, reset_counter: int = 0, quality: int = 0
) -> dict[str, Any]:
    """Return the fields of ODOMETRY.

    Args:
        t: time of the estimate [s].
        estimate: xhat (15); its integrals are not sent.
        covariance: P (15 x 15, or flat, 225).
        reset_counter: how often the estimate was restarted; sent modulo 256.
        quality: quality of the estimate [%]; 0 if not known, -1 if the estimate failed.
    """
    x, P = estimate[:N_X], covariance.reshape(N_XBAR, N_XBAR)[:N_X, :N_X]
    p_N, q = T @ x[0:3], quaternion_ned(euler_ned(x[3:6]))
    v_F = F @ rotation_matrix(x[3:6]).T @ x[6:9]
    w_F = F @ body_rates(x[3:6], x[9:12])
    J = odometry_jacobian(x)
    C = J @ P @ J.T
    fields = {"x": p_N[0], "y": p_N[1], "z": p_N[2], "vx": v_F[0], "vy": v_F[1], "vz": v_F[2]}
    fields |= {"rollspeed": w_F[0], "pitchspeed": w_F[1], "yawspeed": w_F[2]}
    return {name: float(value) for name, value in fields.items()} | {
        "time_usec": round(t * 1e6),
        "frame_id": MAV_FRAME_LOCAL_NED,
        "child_frame_id": MAV_FRAME_BODY_FRD,
        "q": [float(value) for value in q],
        "pose_covariance": upper_triangle(C[0:6, 0:6]),
        "velocity_covariance": upper_triangle(C[6:12, 6:12]),
        "reset_counter": reset_counter % 256,
        "estimator_type": MAV_ESTIMATOR_TYPE_VIO,
        "quality": quality,
    }


def vision_fields(t: float, estimate: np.ndarray, covariance: np.ndarray, reset_counter: int = 0) -> dict[str, Any]:
    """Return the fields of VISION_POSITION_ESTIMATE. Arguments as in odometry_fields."""
    P = covariance.reshape(N_XBAR, N_XBAR)[0:6, 0:6]
    J = np.zeros((6, 6))
    J[0:3, 0:3], J[3:6, 3:6] = T, F
    J[5, 5] = -1.0
    p_N, rpy = T @ estimate[0:3], euler_ned(estimate[3:6])
    fields = dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), [*p_N, *rpy], strict=True))
    return {name: float(value) for name, value in fields.items()} | {
        "usec": round(t * 1e6),
        "covariance": upper_triangle(J @ P @ J.T),
        "reset_counter": reset_counter % 256,
    }


def attitude_target_fields(t: float, rpy: np.ndarray, thrust: float, target: int = 1) -> dict[str, Any]:
    """Return the fields of SET_ATTITUDE_TARGET.

    Args:
        t: time since the start [s].
        rpy: demanded roll, pitch, yaw of B in W (3) [rad].
        thrust: demanded share of the largest thrust; sent limited to 0 ... MOST_THRUST.
        target: the autopilot's system id.
    """
    return {
        "time_boot_ms": round(t * 1e3) % 2**32,
        "target_system": target,
        "target_component": 1,
        "type_mask": ATTITUDE_ALONE,
        "q": [float(value) for value in quaternion_ned(euler_ned(rpy))],
        "body_roll_rate": 0.0,
        "body_pitch_rate": 0.0,
        "body_yaw_rate": 0.0,
        "thrust": float(min(max(thrust, 0.0), MOST_THRUST)),
    }


def udp_address(url: str) -> tuple[str, int]:
    """Return the IPv4 address and port of 'udpout:HOST:PORT'; InputError if the url has another form or no host."""
    kind, _, rest = url.partition(":")
    host, _, port = rest.rpartition(":")
    if kind != "udpout" or not host or not is_port(port):
        serial = "; a serial port needs a router between (docs/how_to/real_sensors.md)" if "/dev/" in url else ""
        raise InputError(f"mavlink url: {url!r}: must read udpout:HOST:PORT with a port of 1 to 65535{serial}")
    try:
        return str(socket.gethostbyname(host)), int(port)
    except (OSError, UnicodeError):
        raise InputError(f"mavlink url: {url!r}: no such host: {host!r}") from None


class MavlinkBridge:
    """A sender of estimates to a flight controller over UDP.

    InputError if the url is wrong or pymavlink is not installed.

    Args:
        url: the destination, 'udpout:HOST:PORT'; this machine by default.
        system: the vehicle's MAVLink system id, MAV_SYS_ID of a PX4: both of the sender and of setpoints' target.
        component: the sender's MAVLink component id.
    """

    def __init__(self, url: str = DEFAULT_URL, system: int = 1, component: int = COMPONENT):
        self._address, self._system = udp_address(url), system
        check_installed("pymavlink", "mavlink")
        common = import_module("pymavlink.dialects.v20.common")
        self._mavlink = common.MAVLink(None, srcSystem=system, srcComponent=component)
        self._heartbeat = self._mavlink.heartbeat_encode(
            common.MAV_TYPE_ONBOARD_CONTROLLER, common.MAV_AUTOPILOT_INVALID, 0, 0, common.MAV_STATE_ACTIVE
        )
        self._socket, self._sending = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), threading.Lock()
        self._socket.settimeout(WAIT)
        self._texts = 0  # id of the last text sent in several parts

    def send(self, t: float, estimate: np.ndarray, covariance: np.ndarray, reset_counter: int = 0) -> None:
        """Send ODOMETRY. Arguments as in odometry_fields."""
        self._send(self._mavlink.odometry_encode(**odometry_fields(t, estimate, covariance, reset_counter)))

    def send_vision(self, t: float, estimate: np.ndarray, covariance: np.ndarray, reset_counter: int = 0) -> None:
        """Send VISION_POSITION_ESTIMATE, for a controller that reads no ODOMETRY. Arguments as in odometry_fields."""
        fields = vision_fields(t, estimate, covariance, reset_counter)
        self._send(self._mavlink.vision_position_estimate_encode(**fields))

    def send_attitude(self, t: float, rpy: np.ndarray, thrust: float) -> None:
        """Send SET_ATTITUDE_TARGET. Arguments as in attitude_target_fields."""
        self._send(self._mavlink.set_attitude_target_encode(**attitude_target_fields(t, rpy, thrust, self._system)))

    def send_heartbeat(self) -> None:
        """Send one HEARTBEAT; every MAVLink component sends one each second."""
        self._send(self._heartbeat)

    def send_text(self, line: str, severity: int = WARNING) -> None:
        """Send a line as STATUSTEXT, which ground stations show, with a severity, in parts of 50 bytes."""
        text = (
            line.replace("°", " deg").replace("²", "2").encode("ascii", "replace")
        )  # ASCII: a part may end within a character of several bytes
        parts = [text[i : i + TEXT] for i in range(0, len(text) + (len(text) > TEXT), TEXT)]  # a part below 50 is last
        self._texts = self._texts % 65535 + 1 if len(parts) > 1 else self._texts
        for i, part in enumerate(parts):
            self._send(self._mavlink.statustext_encode(severity, part, self._texts if len(parts) > 1 else 0, i))

    def send_timesync(self, now: int, asked: int) -> None:
        """Send the answer to a TIMESYNC: `now` of the own clock [ns], and `asked`, the unchanged ts1 of the request."""
        self._send(self._mavlink.timesync_encode(now, asked))

    def receive(self) -> bytes | None:
        """Return a packet from the address that this sends to; None if none comes within WAIT."""
        try:
            packet, sender = self._socket.recvfrom(2048)
        except OSError:  # no packet came, or nobody listens at the address
            return None
        return packet if sender == self._address else None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, message: Any) -> None:
        with self._sending:  # another thread answers TIMESYNC
            packet = message.pack(self._mavlink)
            self._mavlink.seq = (self._mavlink.seq + 1) % 256
            self._socket.sendto(packet, self._address)
