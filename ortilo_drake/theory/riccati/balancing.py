"""Units of states and inputs in which a Riccati equation's matrices are balanced.

With x = T x', u = S u', T and S diagonal, the DARE of A, B, Q, R, N and X becomes that of T^-1 A T, T^-1 B S, T Q T,
S R S, T N S and X' = T X T. T and S are powers of two, so neither this nor the way back rounds anything. Thresholds
of ranks and of eigenvalues then mean the same whatever units the problem was posed in.
"""

from typing import NamedTuple

import numpy as np

SWEEPS = 10


class Balanced(NamedTuple):
    """A DARE in balanced units, and the units T of its states (n)."""

    A: np.ndarray
    B: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    N: np.ndarray
    T: np.ndarray

    def in_given_units(self, X: np.ndarray) -> np.ndarray:
        """Return T^-1 X T^-1."""
        return X / self.T / self.T[:, None]


def powers_of_two(x: np.ndarray) -> np.ndarray:
    """Return the nearest powers of two to positive numbers."""
    return np.exp2(np.round(np.log2(x)))


def unit_diagonal(M: np.ndarray) -> np.ndarray:
    """Return D M D, D diagonal, whose diagonal is 1, -1 or 0; M's definiteness does not change."""
    d = np.sqrt(abs(M.diagonal()))
    d = np.where(d > 0.0, d, 1.0)
    return M / d / d[:, None]


def balancing_units(A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return T that balances each state's couplings: those that grow with its unit and those that shrink.

    Of state j, column j of A without its diagonal and row j of Q grow; row j of A and of G shrink. Where one kind is
    missing the other becomes 1: SciPy's matrix_balance, otherwise the same, would leave such a state as it was given,
    and a bias that nothing drives is one.
    """
    A, G, Q = abs(A), abs(G), abs(Q)
    np.fill_diagonal(A, 0.0)
    T = np.ones(len(A))
    for _ in range(SWEEPS):
        before = T.copy()
        for j in range(len(T)):
            grows = T[j] * np.linalg.norm(np.append(A[:, j] / T, Q[j] * T))
            shrinks = np.linalg.norm(np.append(A[j] * T, G[j] / T)) / T[j]
            if grows > 0.0 and shrinks > 0.0:
                T[j] *= powers_of_two(np.sqrt(shrinks / grows))
            elif shrinks > 0.0 or grows > 0.0:
                T[j] *= powers_of_two(shrinks or 1.0 / grows)
        if (before == T).all():
            break
    return T


def balance(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, N: np.ndarray) -> Balanced:
    """Return the DARE in balanced units.

    An input's unit makes its diagonal entry of R + B^T Q B 1. The states' units balance [[A, B B^T], [Q, A^T]], which
    diag(T^-1, T) scales from the left and its inverse from the right (P. Benner, Linear Algebra Appl. 350, 2002, of
    Hamiltonian matrices).
    """
    weight = np.sqrt(abs((R + B.T @ Q @ B).diagonal()))
    length = np.linalg.norm(B, axis=0)
    S = 1.0 / powers_of_two(np.where(weight > 0.0, weight, np.where(length > 0.0, length, 1.0)))
    T = balancing_units(A, abs(B * S) @ abs(B * S).T, Q)
    t = T[:, None]
    return Balanced(A * T / t, B * S / t, Q * T * t, R * S * S[:, None], N * S * t, T)
