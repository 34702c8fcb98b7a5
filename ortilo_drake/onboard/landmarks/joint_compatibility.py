"""The test whether all boxes together agree with the estimate by which they were associated.

Each pairing within its gate may be wrong though all of them pass, for the errors of the estimate are common to all
boxes. With e the stacked differences from the predicted centres and J their Jacobian by the pose, of covariance P,

    d^2 = e^T (J P J^T + R)^-1 e,   R = diag(sd^2),

is chi-square with 2 n degrees of freedom of n right pairings (J. Neira and J. D. Tardos, "Data association in
stochastic mapping using the joint compatibility test", IEEE Trans. Robotics and Automation 17, 2001). While it is too
large, the box goes whose absence makes it smallest.
"""

import numpy as np
from numba import njit

from ortilo_drake.model.cholesky import squared_norm_in_place
from ortilo_drake.onboard.gate import squared_gate


def joint_limits(probability: float, most: int) -> np.ndarray:
    """Return the largest d^2 of 0 to `most` boxes with which right pairings are compatible with a probability."""
    return np.array([0.0, *(squared_gate(probability, 2 * n) for n in range(1, most + 1))])


@njit(cache=True)
def joint_distance(e: np.ndarray, J: np.ndarray, P: np.ndarray, sd: np.ndarray) -> float:
    """Return d^2 of the differences e (2 n), of Jacobian J (2 n, 6), P (6 x 6) and the boxes' errors sd (2 n).

    NaN where P is no covariance.
    """
    n, J_P, S = e.size, np.empty(6), np.empty((e.size, e.size))
    for i in range(n):  # J P J^T + R, summed in order: BLAS takes another order on another processor
        for a in range(6):
            J_P[a] = 0.0
            for b in range(6):
                J_P[a] += J[i, b] * P[b, a]
        for j in range(i + 1):  # the lower half is what is used
            S[i, j] = 0.0
            for a in range(6):
                S[i, j] += J_P[a] * J[j, a]
        S[i, i] += sd[i] ** 2
    return squared_norm_in_place(S, e.copy())


@njit(cache=True)
def jointly_compatible(e: np.ndarray, J: np.ndarray, P: np.ndarray, sd: np.ndarray, limits: np.ndarray) -> np.ndarray:
    """Return the boxes that are compatible, as indices in rising order.

    Their centres differ by e (n, 2) [px] from the predicted ones, of Jacobians J by position and attitude (n, 2, 6),
    whose covariance is P (6 x 6); sd is the error of each centre (n, 2) [px]. The limits are joint_limits of n boxes or
    more.
    """
    kept = np.arange(len(e))
    distance = distance_of(kept, e, J, P, sd)
    while kept.size > 0 and not distance <= limits[kept.size]:  # nor where it is NaN
        best, distance = kept[:0], np.inf
        for a in range(kept.size):
            rest = np.concatenate((kept[:a], kept[a + 1 :]))
            its = distance_of(rest, e, J, P, sd)
            if a == 0 or its < distance:
                best, distance = rest, its
        kept = best
    return kept


@njit(cache=True)
def distance_of(kept: np.ndarray, e: np.ndarray, J: np.ndarray, P: np.ndarray, sd: np.ndarray) -> float:
    """Return joint_distance of the boxes kept alone, of e (n, 2), J (n, 2, 6) and sd (n, 2) of all."""
    if kept.size == 0:
        return 0.0
    return joint_distance(e[kept].ravel(), J[kept].reshape((2 * kept.size, 6)), P, sd[kept].ravel())
