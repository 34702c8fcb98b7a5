"""From one stamp to the next: how the filter's error state goes on; equations: single_ranges.py."""

import numpy as np
from numba.extending import register_jitable

from ortilo_drake.studies.recorded.filter_types import FIXED, Noise


@register_jitable
def skew(a: np.ndarray) -> np.ndarray:
    """Return the matrix of a cross product, [a]x b = a x b."""
    return np.array([[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]])


@register_jitable
def turn(a: np.ndarray) -> np.ndarray:
    """Return the rotation matrix of a rotation vector (Rodrigues)."""
    angle = np.sqrt(np.sum(a * a))
    K = skew(a)
    if angle < 1e-9:
        return np.eye(3) + K
    return np.eye(3) + np.sin(angle) / angle * K + (1.0 - np.cos(angle)) / angle**2 * (K @ K)


@register_jitable
def transition(h: float, R: np.ndarray, a: np.ndarray, noise: Noise, anchors: int) -> np.ndarray:
    """Return the error's transition over h, with a = R (f - b_a) before gravity."""
    N = FIXED + 2 * anchors
    Phi = np.eye(N)
    A = skew(a)
    for i in range(3):
        Phi[i, 3 + i] = h
    Phi[0:3, 6:9] = -A * (h * h / 2.0)
    Phi[0:3, 12:15] = -R * (h * h / 2.0)
    Phi[3:6, 6:9] = -A * h
    Phi[3:6, 12:15] = -R * h
    Phi[6:9, 9:12] = -R * h
    for i in range(FIXED + anchors, N):
        Phi[i, i] = np.exp(-h / noise.correlation_time)
    return Phi


@register_jitable
def predicted(P: np.ndarray, Phi: np.ndarray, h: float, noise: Noise, anchors: int) -> np.ndarray:
    """Return Phi P Phi' + Q h; Phi is the identity outside its first 15 rows but for the last diagonal."""
    N = len(P)
    left = P.copy()
    left[:FIXED] = np.ascontiguousarray(Phi[:FIXED, :FIXED]) @ np.ascontiguousarray(P[:FIXED])
    for i in range(FIXED + anchors, N):
        left[i] = Phi[i, i] * P[i]
    out = left.copy()
    out[:, :FIXED] = np.ascontiguousarray(left[:, :FIXED]) @ np.ascontiguousarray(Phi[:FIXED, :FIXED].T)
    for i in range(FIXED + anchors, N):
        out[:, i] = Phi[i, i] * left[:, i]
    q = noise.acceleration**2
    for i in range(3):
        out[i, i] += q * h**3 / 3.0
        out[i, 3 + i] += q * h * h / 2.0
        out[3 + i, i] += q * h * h / 2.0
        out[3 + i, 3 + i] += q * h
        out[6 + i, 6 + i] += noise.rotation**2 * h
        out[9 + i, 9 + i] += noise.rotation_bias**2 * h
        out[12 + i, 12 + i] += noise.acceleration_bias**2 * h
    for i in range(anchors):
        out[FIXED + i, FIXED + i] += noise.bias_walk**2 * h
        j = FIXED + anchors + i
        out[j, j] += noise.range_correlated**2 * (1.0 - Phi[j, j] ** 2)
    return out
