"""Second moments of a jump-linear system, whose matrix is drawn at random in every tick.

    z_{k+1} = A_k(p_k) z_k + n_k,   Pr(p_k = p | mode i) = chance[i, p],   Pr(mode j next | mode i) = transition[i, j]

where n is white with covariance N_k, and A_k and N_k have period T in k. S_i = E[z z^T 1{mode = i}] obeys, tick by
tick,

    S_j' = sum_i transition[i, j] (sum_p chance[i, p] A(p) S_i A(p)^T + pi_i N),   pi' = pi transition      (*)

The system is mean-square stable if and only if the linear part of (*) over one period has spectral radius < 1:
O. L. V. Costa, M. D. Fragoso and R. P. Marques, "Discrete-Time Markov Jump Linear Systems" (Springer, 2005), theorems
3.9 and 3.33. With one mode its matrix is sum_p Pr(p) A(p) kron A(p). That matrix is never made for large systems.
"""

import contextlib
from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import ArpackError, LinearOperator, eigs

from ortilo_drake.compiled.cached import cached_njit
from ortilo_drake.model.typed_yaml import InputError

DENSE = 100  # up to this many unknowns the operator's matrix is made and all its eigenvalues found
NEAR = 4  # eigenvalues asked of ARPACK: slow modes of several axes lie close together
POWER = 8  # periods in one step of ARPACK
NCV = 40  # Arnoldi vectors that ARPACK keeps
MARGIN = 1e-7  # a radius closer to 1 than this counts as not stable; clustered eigenvalues are found to about 1e-8
ACCURACY = 1e-9  # relative accuracy of a second moment


class JumpLinear(NamedTuple):
    """A jump-linear system of period T with P patterns and M modes.

    It has the matrices A (T, P, n, n), the covariance N of the noise that enters in each tick (T, n, n), the chance of
    each pattern in each mode (M, P), and the transition of the modes from one tick to the next (M, M).
    """

    A: np.ndarray
    N: np.ndarray
    chance: np.ndarray
    transition: np.ndarray


def stationary(transition: np.ndarray) -> np.ndarray:
    """Return pi (M) with pi = pi transition, sum 1, for a chain with one recurrent class."""
    M = len(transition)
    equations = np.vstack([transition.T - np.eye(M), np.ones(M)])
    return np.linalg.lstsq(equations, np.append(np.zeros(M), 1.0), rcond=None)[0]


@cached_njit
def over_a_tick(A: np.ndarray, chance: np.ndarray, transition: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Apply the linear part of (*) for one tick, with that tick's A (P, n, n), to S (M, n, n)."""
    after = np.zeros(S.shape)
    for i in range(S.shape[0]):
        within = np.zeros(S.shape[1:])
        for p in range(A.shape[0]):
            if chance[i, p] != 0.0:
                within += chance[i, p] * (A[p] @ S[i] @ A[p].T)
        for j in range(S.shape[0]):
            after[j] += transition[i, j] * within
    return after


@cached_njit
def over_periods(periods: int, A: np.ndarray, chance: np.ndarray, transition: np.ndarray, S: np.ndarray) -> np.ndarray:
    """Apply the linear part of (*) for a number of periods, with A (T, P, n, n), to S (M, n, n)."""
    for k in range(periods * A.shape[0]):
        S = over_a_tick(A[k % A.shape[0]], chance, transition, S)
    return S


def mean_square_radius(system: JumpLinear, largest_dense: int = DENSE) -> float:
    """Return the spectral radius of the second moment's operator, as growth per tick (the T-th root).

    By Perron and Frobenius on the cone of positive semidefinite matrices the radius is itself an eigenvalue, with a
    symmetric eigenvector, so the operator is restricted to symmetric S. ARPACK (Arnoldi iteration) finds the
    eigenvalues of a power of the operator, which lie farther apart. If ARPACK fails, or there are at most largest_dense
    unknowns, the eigenvalues come from the operator's matrix.
    """
    M, n, T = len(system.transition), system.A.shape[-1], len(system.A)
    upper = np.triu_indices(n)
    size = M * len(upper[0])
    parts = np.ascontiguousarray(system.A), system.chance, system.transition

    def apply(s: np.ndarray, periods: int = 1) -> np.ndarray:
        S = np.zeros((M, n, n))
        S[:, upper[0], upper[1]] = S[:, upper[1], upper[0]] = s.reshape(M, -1)
        return over_periods(periods, *parts, S)[:, upper[0], upper[1]].ravel()

    if size > largest_dense:
        start = np.tile(np.eye(n)[upper], M)
        operator = LinearOperator((size, size), matvec=lambda s: apply(s, POWER), dtype=float)
        with contextlib.suppress(ArpackError):
            found = eigs(operator, k=NEAR, ncv=NCV, v0=start, maxiter=20, tol=1e-9, return_eigenvectors=False)
            return float(np.max(np.abs(found))) ** (1.0 / (POWER * T))
    values = np.linalg.eigvals(np.column_stack([apply(e) for e in np.eye(size)]))
    return float(np.max(np.abs(values))) ** (1.0 / T)


def steady_second_moment(system: JumpLinear) -> np.ndarray:
    """Return E[z z^T] in the steady state at each tick of the period (T, n, n).

    It is the fixed point of (*), iterated until the change still to come, estimated from the spectral radius, is below
    ACCURACY relative to the diagonal. InputError if the system is not mean-square stable.
    """
    radius = mean_square_radius(system)
    if not radius < 1.0 - MARGIN:
        raise InputError(f"second moment: grows by {radius:.6f} a tick, so there is no steady one")
    noise = np.einsum("ij,i,kab->kjab", system.transition, stationary(system.transition), system.N)
    to_come = radius ** len(system.A) / (1.0 - radius ** len(system.A))
    A = np.ascontiguousarray(system.A)
    return _settle(A, system.chance, system.transition, noise, ACCURACY / max(to_come, 1.0))


@cached_njit
def _settle(
    A: np.ndarray, chance: np.ndarray, transition: np.ndarray, noise: np.ndarray, accuracy: float
) -> np.ndarray:
    """Return S, summed over the modes, at each tick of a period (T, n, n), once S repeats from period to period.

    A (T, P, n, n), chance (M, P) and transition (M, M) are the system's; noise (T, M, n, n) enters the modes in each
    tick. The accuracy is the largest change of a diagonal entry over a period, relative to the entry.
    """
    S, phases = np.zeros_like(noise[0]), np.zeros_like(noise[:, 0])
    while True:
        before = S
        for k in range(len(A)):
            phases[k] = S.sum(axis=0)
            S = over_a_tick(A[k], chance, transition, S) + noise[k]
        change, size = np.zeros(S.shape[1]), np.zeros(S.shape[1])
        for i in range(len(S)):
            change += np.abs(np.diag(S[i] - before[i]))
            size += np.diag(S[i])
        if np.all(change <= accuracy * size):
            return phases
