"""ROS 2 messages of the true state, estimate, reference, path, goal and setpoint.

Frames follow REP 103 and 105: map is W (east, north, up), base_link is B (forward, left, up). Orientations are
quaternions, velocities are in the axes of the body.
"""

import numpy as np
from pydrake.trajectories import Trajectory

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.interop.ros.ros_types import (
    Fields,
    RosMessage,
    header_fields,
    pose_fields,
    quaternion_fields,
    transform_fields,
    twist_fields,
    vector_fields,
)
from ortilo_drake.model.equations import body_rates, euler_rate_matrix, rotation_matrix
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.estimator.tight.inertial import quaternion_of

GOAL_TYPE = "geometry_msgs/msg/PoseStamped"
GOAL_TOPIC = "/goal_pose"  # the topic of the 2D goal tools of RViz and Foxglove
PATH_STEP = 0.1  # time between two poses of the planned path [s]


@cached_njit
def quaternion(rpy: np.ndarray) -> np.ndarray:
    """Return q_WB = q_z(psi) q_y(theta) q_x(phi) as (x, y, z, w)."""
    return np.roll(quaternion_of(rpy), -1)


@cached_njit
def pose_and_twist(x: np.ndarray) -> np.ndarray:
    """Return p_WB (3), q_WB as (x, y, z, w) (4), v_WB in B (3) and w_WB_B (3) of a state x (12 or more)."""
    v_B = rotation_matrix(x[3:6]).T @ np.ascontiguousarray(x[6:9])
    return np.concatenate((x[0:3], quaternion(x[3:6]), v_B, body_rates(x[3:6], x[9:12])))


@cached_njit
def twist_covariance(x: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Return the covariance of (v_WB in B, w_WB_B) as T P_v T' with T = diag(R_BW, E(rpy)) (6, 6).

    P_v is the block of velocity and Euler rates in P. The part due to the error of the attitude, which turns the axes,
    is left out: it is the product of an angle's error and a speed. x has 12 entries or more, P as many rows.
    """
    T = np.zeros((6, 6))
    T[0:3, 0:3] = rotation_matrix(x[3:6]).T
    T[3:6, 3:6] = euler_rate_matrix(x[3:6])
    return T @ np.ascontiguousarray(P[6:12, 6:12]) @ T.T


def _motion(x: np.ndarray) -> list[float]:
    # A copy: for a read-only array numba would compile the function again, in flight.
    return pose_and_twist(np.array(x[0:12])).tolist()


def _odometry(of: str, t: float, pose: Fields, twist: Fields) -> RosMessage:
    header = header_fields(t, "map")
    fields = {"header": header, "child_frame_id": "base_link", "pose": pose, "twist": twist}
    return f"/{of}/odometry", "nav_msgs/msg/Odometry", fields


def truth_messages(t: float, state: np.ndarray) -> list[RosMessage]:
    """Return the messages of the true state x (12)."""
    motion = _motion(state)
    pose = pose_fields(motion)
    return [
        ("/truth/pose", "geometry_msgs/msg/PoseStamped", {"header": header_fields(t, "map"), "pose": pose}),
        _odometry("truth", t, {"pose": pose}, {"twist": twist_fields(motion)}),
    ]


def estimate_messages(t: float, estimate: np.ndarray, covariance: np.ndarray) -> list[RosMessage]:
    """Return the messages of the estimate xhat (15) and its covariance P (225).

    The covariance of a pose in ROS is that of roll, pitch and yaw about fixed axes, which is a block of P.
    """
    motion, P = _motion(estimate), np.array(covariance.reshape(N_XBAR, N_XBAR))
    header, pose = header_fields(t, "map"), {"pose": pose_fields(motion), "covariance": P[0:6, 0:6].ravel()}
    twist = {"twist": twist_fields(motion), "covariance": twist_covariance(np.array(estimate), P).ravel()}
    kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
    return [("/estimate/pose", kind, {"header": header, "pose": pose}), _odometry("estimate", t, pose, twist)]


def tf_message(t: float, x: np.ndarray) -> RosMessage:
    """Return the transform map -> base_link of a true or estimated state x (12 or more)."""
    return ("/tf", "tf2_msgs/msg/TFMessage", {"transforms": [transform_fields(t, "base_link", _motion(x))]})


def reference_message(t: float, reference: np.ndarray, yaw: float) -> RosMessage:
    """Return the pose of a reference (9): its position, with the yaw that the servo holds [rad]."""
    motion = [*reference[0:3].tolist(), *quaternion(np.array([0.0, 0.0, yaw])).tolist()]
    return (
        "/reference/pose",
        "geometry_msgs/msg/PoseStamped",
        {"header": header_fields(t, "map"), "pose": pose_fields(motion)},
    )


def path_message(trajectory: Trajectory, yaw: float) -> RosMessage:
    """Return the planned path p_WB(t) (3 rows) [m] as poses every PATH_STEP, with the yaw that the servo holds."""
    start, end = trajectory.start_time(), trajectory.end_time()
    times = np.linspace(start, end, max(2, 1 + round((end - start) / PATH_STEP))).tolist()
    poses = [reference_message(t, trajectory.value(t)[:, 0], yaw)[2] for t in times]
    return "/reference/path", "nav_msgs/msg/Path", {"header": header_fields(0.0, "map"), "poses": poses}


def setpoint_messages(t: float, rpy: np.ndarray, thrust: float) -> list[RosMessage]:
    """Return the demanded roll, pitch, yaw of B in W (3) [rad], and thrust over mass along the body's z [m/s²]."""
    attitude = {"header": header_fields(t, "map"), "quaternion": quaternion_fields(quaternion(rpy).tolist())}
    force = {"header": header_fields(t, "base_link"), "vector": vector_fields([0.0, 0.0, thrust])}
    return [
        ("/control/attitude", "geometry_msgs/msg/QuaternionStamped", attitude),
        ("/control/thrust", "geometry_msgs/msg/Vector3Stamped", force),
    ]


def goal_message(t: float, goal: np.ndarray) -> RosMessage:
    """Return a goal p_W (2) [m] taken at t [s], with no heading and z = 0, as tools for 2D goals send it."""
    motion = [*goal.tolist(), 0.0, 0.0, 0.0, 0.0, 1.0]
    return GOAL_TOPIC, GOAL_TYPE, {"header": header_fields(t, "map"), "pose": pose_fields(motion)}
