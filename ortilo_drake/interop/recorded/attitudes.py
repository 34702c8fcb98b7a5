"""Recorded attitudes as rotation matrices; single rows may be invalid, a whole stream may not."""

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.sources import Matrix, Quaternion
from ortilo_drake.model.typed_yaml import InputError

TOLERANCE = 0.05  # of a quaternion's norm, and of R R' from 1: what rounding in a file may leave
LARGEST = 1e6  # of a component; one of an attitude is at most 1


def are_attitudes(values: np.ndarray, source: Matrix | Quaternion) -> np.ndarray:
    """Return a mask (n) of valid attitudes: quaternions (n, 4) of norm 1, or rotation matrices (n, 9)."""
    values = np.clip(values, -LARGEST, LARGEST)  # squares of a spoilt number would overflow
    if isinstance(source, Quaternion):
        return np.asarray(np.abs(np.linalg.norm(values, axis=1) - 1.0) <= TOLERANCE)
    R = values.reshape(-1, 3, 3)
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    return np.asarray((off <= TOLERANCE) & (np.linalg.det(R) > 0.0))


def rotations(values: np.ndarray, source: Matrix | Quaternion, what: str) -> np.ndarray:
    """Return rotation matrices body to world (n, 3, 3) of quaternions (n, 4) or matrices (n, 9).

    Raises:
        InputError: if a row is none.
    """
    good, values = are_attitudes(values, source).all(), np.clip(values, -LARGEST, LARGEST)
    if isinstance(source, Matrix):
        R = values.reshape(-1, 3, 3)
        if not good:
            off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max()
            raise InputError(f"{what}: no rotation matrices: R R' differs from 1 by {off:.2g}")
    else:
        if not good:
            norms = np.linalg.norm(values, axis=1)
            hint = "" if norms.max() > TOLERANCE else "; leave it out of the map if none was computed"
            raise InputError(f"{what}: no unit quaternions: norms {norms.min():.3g} to {norms.max():.3g}{hint}")
        R = Rotation.from_quat(values if source.order == "xyzw" else values[:, [1, 2, 3, 0]]).as_matrix()
    return R if source.of == "body" else np.ascontiguousarray(R.transpose(0, 2, 1))
