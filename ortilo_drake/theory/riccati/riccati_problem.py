"""Conditions under which a discrete-time algebraic Riccati equation has a stabilising solution, and their errors.

    A^T X A - X - (A^T X B + N) (R + B^T X B)^-1 (B^T X A + N^T) + Q = 0                                   (DARE)

has a unique stabilising solution X >= 0, the limit of the recursion from X = 0, if [[Q, N], [N^T, R]] >= 0, (A, B) is
stabilisable and (A_1, Q_1) is detectable (Lancaster and Rodman, Algebraic Riccati Equations, 1995, chapters 12 to 16),
where A_1 = A - B R^-1 N^T and Q_1 = Q - N R^-1 N^T. Undetectable modes on the unit circle are eigenvalues of the
symplectic pencil there, so no stabilising solution exists. With undetectable modes outside the circle there is one, but
it is not the least cost and the recursion does not reach it. SciPy's solver finds it if asked to.

All of this is decided numerically, in balanced units, and the same for every solver: a value that is 0, or on the
circle, up to rounding counts as such. With x = T x', u = S u', T and S diagonal, the DARE of A, B, Q, R, N and X
becomes that of T^-1 A T, T^-1 B S, T Q T, S R S, T N S and X' = T X T. T and S are powers of two, so neither the
scaling nor its inverse rounds anything. Thresholds of ranks and eigenvalues then mean the same whatever the units of
the given problem.

A singular R >= 0 is made regular by a shift: for every symmetric X_0, Y = X - X_0 solves the DARE of
R + B^T X_0 B, N + A^T X_0 B and Q + A^T X_0 A - X_0. A few steps of the recursion from 0 give an X_0 for which the
first is positive definite and the last still positive semidefinite, as the recursion only grows.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import eigvals

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.modes.modes import Mode, listed, unreached_modes, unseen_modes

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
    """Return D M D with a diagonal D > 0, so that its diagonal is 1, -1 or 0; M's definiteness does not change."""
    d = np.sqrt(abs(M.diagonal()))
    d = np.where(d > 0.0, d, 1.0)
    return M / d / d[:, None]


def balancing_units(A: np.ndarray, G: np.ndarray, Q: np.ndarray) -> np.ndarray:
    """Return T (n), which balances each state's couplings: those that grow with its unit and those that shrink.

    For state j, column j of A without its diagonal and row j of Q grow; row j of A and of G shrink. If one kind is
    missing, the other becomes 1. SciPy's matrix_balance, otherwise the same, would leave such a state unscaled; a bias
    that nothing drives is one.
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


EPS = float(np.finfo(float).eps)
NEARLY_SINGULAR = 1e-8  # R's least eigenvalue over the largest below which R is made regular first
SINGULAR = 1e-10  # relative eigenvalue of R + B^T X B that counts as 0 in its pseudoinverse
ROUNDING = 2e-14  # relative size that counts as 0 in a weight
ON_THE_CIRCLE = 1e-8  # distance from the circle at which an eigenvalue counts as on it: the root of the rounding error


class RegularProblem(NamedTuple):
    """The DARE of Y = X - X_0 without cross term: A^T Y A - Y - A^T Y B (R + B^T Y B)^-1 B^T Y A + Q = 0, R > 0."""

    A: np.ndarray
    B: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    X_0: np.ndarray


def real_matrices(**matrices: Any) -> list[np.ndarray]:
    """Return the matrices as floats; InputError naming a matrix that is complex or holds no numbers.

    A complex matrix is refused even if its imaginary part is 0: the equations here are those of real matrices.
    """
    found = []
    for name, M in matrices.items():
        M = np.asarray(M)
        if M.dtype.kind not in "biuf":
            what = "is complex" if M.dtype.kind == "c" else f"holds {M.dtype}"
            raise InputError(f"{name}: {what}: must be a matrix of real numbers")
        found.append(M.astype(float))
    return found


def symmetrise(X: np.ndarray) -> np.ndarray:
    """Return (X + X^T) / 2."""
    return (X + X.T) / 2.0


def is_positive_definite(R: np.ndarray) -> bool:
    """Return whether R, scaled to a unit diagonal, is > 0 beyond rounding."""
    return bool(np.linalg.eigvalsh(unit_diagonal(R))[0] > len(R) * EPS)


def riccati_step(
    A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, N: np.ndarray, X: np.ndarray
) -> np.ndarray:
    """Return Q + A^T X A - (A^T X B + N) (R + B^T X B)^+ (B^T X A + N^T), one step of the paper's recursion."""
    XA, M = X @ A, R + B.T @ X @ B
    F = B.T @ XA + N.T
    try:
        L = np.linalg.solve(M, F)
    except np.linalg.LinAlgError:
        L = np.linalg.pinv(M, rcond=SINGULAR, hermitian=True) @ F
    return symmetrise(Q + A.T @ XA - F.T @ L)


def regularise(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, N: np.ndarray) -> RegularProblem:
    """Return the equivalent problem with N = 0 and R > 0, far from singular if possible; X_0 = 0 where R already is.

    InputError if R + B^T X B is still singular after n + 1 steps of the recursion: a control has no cost and no effect.
    """
    X_0 = np.zeros_like(Q)
    for _ in range(len(A) + 2):
        R_1 = symmetrise(R + B.T @ X_0 @ B)
        eigenvalues = np.linalg.eigvalsh(R_1)
        if eigenvalues[0] > NEARLY_SINGULAR * eigenvalues[-1]:
            break
        F = B.T @ X_0 @ A + N.T
        X_0 = symmetrise(Q + A.T @ X_0 @ A - F.T @ np.linalg.pinv(R_1, rcond=SINGULAR, hermitian=True) @ F)
    else:
        X_0, R_1 = np.zeros_like(Q), R
        if not is_positive_definite(R):
            raise InputError("R: R + B^T X B stays singular: some control has no weight and moves nothing that has one")
    N_1 = N + A.T @ X_0 @ B
    L = np.linalg.solve(R_1, N_1.T)
    return RegularProblem(A - B @ L, B, symmetrise(Q + A.T @ X_0 @ A - X_0 - N_1 @ L), R_1, X_0)


def output_of(regular: RegularProblem, Q: np.ndarray) -> np.ndarray:
    """Return C, eigenvectors of the regular problem's Q: it has the kernel of Q, and as many rows as the rank of Q.

    Where X_0 is not 0, this Q is a difference of matrices of the size of X_0 and of the given Q.
    """
    size = np.linalg.norm(Q, 2) + np.linalg.norm(regular.X_0, 2) * (1.0 + np.linalg.norm(regular.A, 2) ** 2)
    values, vectors = np.linalg.eigh(regular.Q)
    return np.asarray(vectors[:, values > ROUNDING * size].T)


def distance_to_circle(problem: Balanced) -> float:
    """Return the least ||z| - 1| of the eigenvalues z of the problem's extended symplectic pencil.

    The pencil is [[A, 0, B], [-Q, I, -N], [N^T, 0, R]] - z [[I, 0, 0], [0, A^T, 0], [0, -B^T, 0]]. Its eigenvalues are
    those of the closed loop, their inverses, and infinity.
    """
    A, B, Q, R, N, _ = problem
    n, m = B.shape
    eye, zero = np.eye(n), np.zeros
    left = np.block([[A, zero((n, n)), B], [-Q, eye, -N], [N.T, zero((m, n)), R]])
    right = np.block([[eye, zero((n, n + m))], [zero((n, n)), A.T, zero((n, m))], [zero((m, n)), -B.T, zero((m, m))]])
    with np.errstate(all="ignore"):
        z = eigvals(left, right)
    return float(abs(abs(z[np.isfinite(z)]) - 1.0).min())


def _require_shapes(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray, N: np.ndarray) -> None:
    if A.ndim != 2 or A.shape[0] == 0 or A.shape[0] != A.shape[1]:
        raise InputError(f"A: shape {A.shape}: must be square")
    n = len(A)
    if B.ndim != 2 or B.shape[0] != n or B.shape[1] == 0:
        raise InputError(f"B: shape {B.shape}: must have the {n} rows of A and at least one column")
    m = B.shape[1]
    for name, M, shape in (("Q", Q, (n, n)), ("R", R, (m, m)), ("N", N, (n, m))):
        if M.shape != shape:
            raise InputError(f"{name}: shape {M.shape}: must be {shape}")
    for name, M in (("A", A), ("B", B), ("Q", Q), ("R", R), ("N", N)):
        if not np.isfinite(M).all():
            raise InputError(f"{name}: holds NaN or infinity: must be finite")


def _require_weights(Q: np.ndarray, R: np.ndarray, N: np.ndarray) -> None:
    for name, M in (("Q", Q), ("R", R)):
        if abs(unit_diagonal(M) - unit_diagonal(M).T).max() > 1e-10:
            raise InputError(f"{name}: differs from its transpose by {abs(M - M.T).max():.3g}: must be symmetric")
        if not _is_semidefinite(M):
            least = np.linalg.eigvalsh(symmetrise(M))[0]
            raise InputError(f"{name}: eigenvalue {least:.6g}: must be positive semidefinite")
    if N.any() and not _is_semidefinite(both := np.block([[Q, N], [N.T, R]])):
        least = np.linalg.eigvalsh(symmetrise(both))[0]
        raise InputError(f"N: [[Q, N], [N^T, R]] is indefinite (eigenvalue {least:.6g}): must be at least 0")


def _is_semidefinite(M: np.ndarray) -> bool:
    return bool(np.linalg.eigvalsh(symmetrise(unit_diagonal(M)))[0] >= -1e-12)


def _lasting(modes: list[Mode]) -> list[Mode]:
    """Return all modes if one is numerically on or outside the unit circle; rounding may have split one into all."""
    return modes if any(abs(mode.eigenvalue) >= 1.0 - ON_THE_CIRCLE for mode in modes) else []


def require_well_posed(
    A: np.ndarray,
    B: np.ndarray,
    Q: np.ndarray,
    R: np.ndarray,
    N: np.ndarray | None = None,
    names: tuple[str, ...] | None = None,
    dual: bool = False,
    least_cost: bool = True,
) -> Balanced:
    """Return a DARE in balanced units, once checked to have a stabilising solution X >= 0; see the module.

    With least_cost, X must also be the least cost, the recursion's limit.

    Matrices and the states' names are as for riccati.solve. For a filter's equation (dual: A = Phi^T, B = C^T, Q = W, R
    = V) errors speak of Phi, C, W and V. InputError naming the matrix, or the modes that are not reached or not seen.
    """
    N = np.zeros(np.shape(B)) if N is None else N
    A, B, Q, R, N = real_matrices(A=A, B=B, Q=Q, R=R, N=N)
    _require_shapes(A, B, Q, R, N)
    _require_weights(Q, R, N)
    problem = balance(A, B, symmetrise(Q), symmetrise(R), N)
    if modes := _lasting(unreached_modes(problem.A, problem.B, names)):
        what = "(Phi, C) is not detectable: no sensor sees" if dual else "(A, B) is not stabilisable: no control moves"
        raise InputError(f"Riccati equation: {what} {listed(modes)}: no stabilising solution exists")
    regular = regularise(*problem[:5])
    if modes := _lasting(unseen_modes(regular.A, output_of(regular, problem.Q), names)):
        what = "(Phi, W) is not stabilisable: no noise drives" if dual else "(A, Q) is not detectable: no weight sees"
        if regular.X_0.any():
            what = f"with the controls that {'V' if dual else 'R'} makes free, {what}"
        if any(abs(abs(mode.eigenvalue) - 1.0) < ON_THE_CIRCLE for mode in modes):
            why = (
                "numerically on the unit circle, an eigenvalue of the symplectic pencil: no stabilising solution exists"
            )
            raise InputError(f"Riccati equation: {what} {listed(modes)}, {why}")
        if least_cost:
            why = "outside the unit circle, so the recursion's limit, the least cost, does not stabilise"
            instead = "od.solve_dare's solver 'scipy' gives the solution that does"
            raise InputError(f"Riccati equation: {what} {listed(modes)}, {why}: {instead}")
    if (distance := distance_to_circle(problem)) < ON_THE_CIRCLE:
        raise InputError(
            f"Riccati equation: an eigenvalue of the symplectic pencil is {distance:.1g} from the unit circle, "
            "numerically on it: no stabilising solution exists"
        )
    return problem
