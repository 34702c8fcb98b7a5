"""Units, axes and attitudes of recorded numbers, as a map names them."""

import numpy as np
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.sources import Matrix, Quaternion
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY

RATE_UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180.0, "mrad/s": 0.001, "mdeg/s": np.pi / 180_000.0}
FORCE_UNITS = {"m/s2": 1.0, "g": GRAVITY, "mg": GRAVITY / 1000.0, "ft/s2": 0.3048}
TOLERANCE = 0.05  # largest deviation of a quaternion's norm and of R R' from 1, for rounding in a file
LARGEST = 1e6  # components are clipped to this; a valid attitude's are at most 1


def size_of(unit: str | float, units: dict[str, float]) -> float:
    """Return the size of a map's unit in our unit; the unit is given by name, or as that size."""
    return units[unit] if isinstance(unit, str) else unit


def axes_matrix(axes: str | tuple[str, ...], what: str, mirrors: bool = False) -> np.ndarray:
    """Return the matrix from the unit's axes to ours; InputError if the matrix mirrors space without `mirrors`.

    Entry k of a list names the unit's axis along our axis k (x forward, y left, z up).
    """
    if isinstance(axes, str):
        return np.diag([1.0, 1.0, 1.0] if axes == "flu" else [1.0, -1.0, -1.0])
    M = np.zeros((3, 3))
    for k, axis in enumerate(axes):
        M[k, "xyz".index(axis[-1])] = -1.0 if axis[0] == "-" else 1.0
    if np.linalg.det(M) < 0 and not mirrors:
        raise InputError(f"{what}: {list(axes)}: mirrors space; change one sign")
    return M


def in_axes(R: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Return attitudes (n, 3, 3) in the world axes M; where M mirrors space, the body axes are mirrored as well."""
    return np.asarray(M @ R if np.linalg.det(M) > 0.0 else M @ R @ M.T)


def axes_names(M: np.ndarray) -> str:
    """Return the axes of a matrix in the form of a map's list."""
    rows = [("-" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in M]
    return f"[{', '.join(rows)}]"


def are_attitudes(values: np.ndarray, source: Matrix | Quaternion) -> np.ndarray:
    """Return a mask (n) of valid attitudes: quaternions (n, 4) of norm 1, or rotation matrices (n, 9)."""
    values = np.clip(values, -LARGEST, LARGEST)  # the square of a damaged number would overflow
    if isinstance(source, Quaternion):
        return np.asarray(np.abs(np.linalg.norm(values, axis=1) - 1.0) <= TOLERANCE)
    R = values.reshape(-1, 3, 3)
    off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    return np.asarray((off <= TOLERANCE) & (np.linalg.det(R) > 0.0))


def rotations(values: np.ndarray, source: Matrix | Quaternion, what: str) -> np.ndarray:
    """Return rotation matrices from body to world (n, 3, 3), given quaternions (n, 4) or matrices (n, 9).

    InputError if a row is no valid attitude.
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
