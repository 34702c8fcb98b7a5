"""Units and axes of recorded numbers, as a map names them."""

import numpy as np

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY

RATE_UNITS = {"rad/s": 1.0, "deg/s": np.pi / 180.0, "mrad/s": 0.001, "mdeg/s": np.pi / 180_000.0}
FORCE_UNITS = {"m/s2": 1.0, "g": GRAVITY, "mg": GRAVITY / 1000.0, "ft/s2": 0.3048}


def size_of(unit: str | float, units: dict[str, float]) -> float:
    """Return how much one of a map's units is in ours: it is named, or is that number."""
    return units[unit] if isinstance(unit, str) else unit


def axes_matrix(axes: str | tuple[str, ...], what: str, mirrors: bool = False) -> np.ndarray:
    """Return the matrix from the unit's axes to ours; InputError if it mirrors and may not.

    Entry k of a list says which of the unit's axes ours (x forward, y left, z up) is.
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
    """Return attitudes (n, 3, 3) in other axes of the world; where M mirrors, the body's are mirrored alike."""
    return np.asarray(M @ R if np.linalg.det(M) > 0.0 else M @ R @ M.T)


def axes_names(M: np.ndarray) -> str:
    """Return the axes of a matrix as a map lists them."""
    rows = [("-" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in M]
    return f"[{', '.join(rows)}]"
