"""Landmarks as OpenCV projects them, to try the methods of the landmark fix with."""

from itertools import product

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ortilo_drake.model.equations import rotation_matrix
from ortilo_drake.model.pinhole import R_BC, box_center
from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import ARRIVED, DETECTION_SIZE, DETECTIONS_SIZE, PAYLOAD, STAMP
from ortilo_drake.onboard.landmarks.landmark_fix import METHODS

# Each compiled for itself alone.
COSINES, PNP = ALONE = [pytest.param(method, marks=pytest.mark.long) for method in ("cosine_law", "pnp")]
EACH = [*ALONE, *(method for method in METHODS if method not in ("cosine_law", "pnp"))]
ROOM = load_room()
CAMERA = ROOM.camera.scaled_to(320).constants
P_BC, F, C, *_ = CAMERA
# Spread over the image and in depth, as seen from (0, 0, 1.5), and of the sizes that the room has.
POINTS = np.array(
    [
        [4.5, 0.4, 0.2],
        [5.5, 3.7, 0.3],
        [5.5, 1.0, 0.6],
        [3.4, -0.9, 1.1],
        [6.7, -0.1, 1.0],
        [4.0, 1.5, 2.6],
        [3.6, -2.2, 2.4],
    ]
)
SIZES = np.array(
    [
        [0.3, 0.3, 0.6],
        [0.5, 0.5, 0.5],
        [0.7, 0.5, 0.6],
        [0.5, 0.5, 0.5],
        [0.5, 0.5, 1.9],
        [0.1, 0.4, 0.4],
        [0.3, 0.3, 0.4],
    ]
)
OUTLINES = 0.5 * SIZES[:, None] * list(product((-1.0, 1.0), repeat=3))
ATTITUDE_SD = 0.004
EXACT = (0.0, 0.0, 1.5, 0.013, -0.021, 0.034)
SHOWN = np.array([0, 2, 4, 6, 8, 9])  # of the room: in the image, whole, from EXACT


def state(pose=EXACT) -> np.ndarray:
    return np.concatenate([pose, np.zeros(9)])


def covariance(position_sd: float = 0.1, angle_sd: float = ATTITUDE_SD) -> np.ndarray:
    return np.diag([position_sd**2] * 3 + [angle_sd**2] * 3 + [1.0] * 9).ravel()


def boxes(pose, points=POINTS, outlines=OUTLINES) -> np.ndarray:
    """(u_min, v_min, u_max, v_max) of the outlines, by OpenCV."""
    R_WB = Rotation.from_euler("ZYX", [pose[5], pose[4], pose[3]]).as_matrix()
    R_CW = (R_WB @ R_BC).T
    K = np.array([[F, 0.0, C[0]], [0.0, F, C[1]], [0.0, 0.0, 1.0]])
    seen = (points[:, None] + outlines).reshape(-1, 3)
    t = -R_CW @ (np.asarray(pose[:3]) + R_WB @ P_BC)
    uv = cv2.projectPoints(seen, cv2.Rodrigues(R_CW)[0], t, K, None)[0].reshape(len(points), -1, 2)
    return np.concatenate([uv.min(axis=1), uv.max(axis=1)], axis=1)


def centers(pose, points=POINTS, outlines=OUTLINES) -> np.ndarray:
    box = boxes(pose, points, outlines)
    return 0.5 * (box[:, :2] + box[:, 2:])


def shown_centers(moved=0.0) -> tuple[np.ndarray, np.ndarray]:
    """Centres (6, 2) of the boxes of SHOWN, moved by (6, 3) [m], from EXACT, and their Jacobian by it (6, 2, 6)."""
    centers, J, x = np.zeros((len(SHOWN), 2)), np.zeros((len(SHOWN), 2, 6)), np.array(EXACT)
    places, outlines = ROOM.landmark_positions[SHOWN] + moved, ROOM.landmark_outlines[SHOWN]
    for i in range(len(SHOWN)):
        assert box_center(places[i], outlines[i], x[:3], x[3:], rotation_matrix(x[3:]), CAMERA, centers[i], J[i])
    return centers, J


def shown_message(pose, moved=0.0, errors=((0.0, 0.0),), stamp: float = 0.0) -> np.ndarray:
    """The detections message of SHOWN, moved by (6, 3) [m], with errors of the boxes (6, 2) [px]."""
    said = np.zeros(DETECTIONS_SIZE)
    said[ARRIVED], said[STAMP] = 1.0, stamp
    said[PAYLOAD::DETECTION_SIZE] = -1.0
    rows = said[PAYLOAD:].reshape(-1, DETECTION_SIZE)[: len(SHOWN)]
    rows[:, 0], rows[:, 1] = ROOM.landmark_labels[SHOWN], 0.9
    rows[:, 2:] = boxes(pose, ROOM.landmark_positions[SHOWN] + moved, ROOM.landmark_outlines[SHOWN])
    rows[:, 2:] += np.tile(errors, 2)
    return said


def jacobian(pose, n: int = len(POINTS), step: float = 1e-6) -> np.ndarray:
    """d centres / d [p_WB, rpy] (2 n, 6) by central differences of OpenCV's projection."""
    columns = [
        (centers(pose + d, POINTS[:n], OUTLINES[:n]) - centers(pose - d, POINTS[:n], OUTLINES[:n])).ravel() / (2 * step)
        for d in step * np.eye(6)
    ]
    return np.array(columns).T


def solve(method: str, z, xhat, n=slice(None), P=None, sd: float = 1.0, max_residual: float = 4.0):
    P = covariance() if P is None else P
    sds = np.full(np.shape(z), sd)
    found, value, cov = METHODS[method](z, POINTS[n], OUTLINES[n], xhat, P, CAMERA, sds, max_residual)
    return found, value, cov
