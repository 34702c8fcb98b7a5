"""States from named entries, and their attitude and body rates by SciPy."""

import numpy as np
from scipy.spatial.transform import Rotation

NAMES = ["x", "y", "z", "phi", "theta", "psi", "vx", "vy", "vz", "phi_dot", "theta_dot", "psi_dot"]


def state(**entries: float) -> np.ndarray:
    x = np.zeros(12)
    x[[NAMES.index(name) for name in entries]] = list(entries.values())
    return x


def attitude(rpy: np.ndarray) -> Rotation:
    return Rotation.from_euler("ZYX", rpy[..., ::-1])  # intrinsic yaw, pitch, roll


def body_rates(rpy: np.ndarray, rpy_dot: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Return w_WB_B [rad/s] by a central difference."""
    before, after = attitude(rpy - step * rpy_dot), attitude(rpy + step * rpy_dot)
    return (before.inv() * after).as_rotvec() / (2 * step)
