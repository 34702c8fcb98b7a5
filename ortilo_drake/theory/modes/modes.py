"""Modes of a matrix: all, those that no control reaches, and those that no output sees, with their states.

The vehicle at hover is four chains of integrators (x and y of four, z and yaw of two), so every eigenvalue of Phi is
1 and defective. A general eigenvalue solver finds such an eigenvalue only to eps^(1/4), and rank tests with it or with
powers of Phi fail. So the hidden subspace is found first, then the eigenvalues of Phi on it. Eigenvalues
that rounding has split are merged; their mean is accurate again.

Theorem (Popov, Belevitch, Hautus). (Phi, C) is observable at z iff [Phi - z I; C] has full column rank n; detectable
iff that holds at every eigenvalue on or outside the unit circle. (Phi, Gamma) is controllable or stabilisable iff
(Phi^T, Gamma^T) is observable or detectable. M. L. J. Hautus, 1969.

Staircase. The unobservable subspace is the largest Phi-invariant subspace in the kernel of C (R. E. Kalman, 1963). It
is found by N_0 = ker C, N_{k+1} = {v in N_k: Phi v in N_k}, one orthogonal step after another (P. Van Dooren, IEEE TAC
26, 1981). In the units of tick_scaling the vehicle's Phi - I has the entries 1, 1/2, 1/6, 1/24 for every h.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space, schur, svdvals

from ortilo_drake.model.signals import INTEGRAL_NAMES, N_X, N_XBAR, STATE_NAMES, XBAR_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import GRAVITY

CLUSTERS = (2e-3, 1e-6, 0.0)  # distances within which rounding may have split one eigenvalue; the first that fits
STATE_SHARE = 1e-6  # a unit vector's component above this counts
ON_THE_CIRCLE = 1e-6  # |z| >= 1 - this counts as not decaying
DIGITS = 10  # decimals of an eigenvalue, the rest being rounding


@dataclass(frozen=True)
class Mode:
    """An eigenvalue of a matrix, or of its part that is unobservable or uncontrollable.

    The multiplicity is the dimension of the part's generalised eigenspace; `states` have a component in this space. The
    deficiency is the rank that [A - z I; C] lacks: the number of eigenvectors in the kernel of C, one per Jordan block.
    `blocks` holds the sizes of the Jordan blocks, the largest first.
    """

    eigenvalue: complex
    multiplicity: int
    deficiency: int
    states: tuple[str, ...]
    blocks: tuple[int, ...]

    def __str__(self) -> str:
        """Return 'eigenvalue 1 (2 times) in psi, psi_dot'."""
        z = self.eigenvalue
        shown = f"{z.real:.6g}{z.imag:+.6g}i" if z.imag else f"{z.real:.6g}"
        times = f" ({self.multiplicity} times)" if self.multiplicity > 1 else ""
        return f"eigenvalue {shown}{times} in {', '.join(self.states)}"


def names_of(n: int) -> tuple[str, ...]:
    """Return the names of n states: the vehicle's (12, 15 with the integral), the loop's (27), else numbers from 1."""
    believed = tuple(f"{name}_hat" for name in STATE_NAMES)
    named = (STATE_NAMES, XBAR_NAMES, (*STATE_NAMES, *believed, *INTEGRAL_NAMES))
    numbers = tuple(f"state {k + 1}" for k in range(n))
    return dict(zip((N_X, N_XBAR, N_X + N_XBAR), named, strict=True)).get(n, numbers)


def jordan_blocks(N: np.ndarray) -> tuple[int, ...]:
    """Return the sizes of the Jordan blocks of N at eigenvalue 0; rank N^(k-1) - rank N^k have size k or more."""
    ranks = [rank(np.linalg.matrix_power(N, k)) for k in range(len(N) + 1)]
    at_least = -np.diff(ranks)
    return tuple(int(np.sum(at_least > j)) for j in range(at_least[0]))


def unseen_modes(
    A: np.ndarray,
    C: np.ndarray,
    names: tuple[str, ...] | None = None,
    radius: float = 1.0 - ON_THE_CIRCLE,
    scale: np.ndarray | None = None,
) -> list[Mode]:
    """Return the modes of A (n x n), C (p x n) with |z| >= radius that no output sees, the largest |z| first.

    An empty list means that (A, C) is detectable, and with a radius of 0 that it is observable. p may be 0. `names` are
    the states' names, names_of(n) by default; `scale` (n) holds their units, such as tick_scaling(h).
    """
    A, C = rescale(A, C, scale)
    names = names or names_of(len(A))
    N = unobservable_subspace(A, C)
    hidden = N.T @ A @ N
    left = list(schur(hidden, output="complex")[0].diagonal()) if N.size else []
    found = []
    while left:
        farthest = max(left, key=lambda z: (round(abs(z), 6), z.imag))
        for width in CLUSTERS:

            def belongs(z: complex, center: complex = farthest, width: float = width) -> bool:
                return abs(z - center) <= width

            T, Z, k = schur(hidden, output="complex", sort=belongs)
            z = complex(np.mean(T.diagonal()[:k]))  # far more accurate than the members of a split cluster
            blocks = jordan_blocks(T[:k, :k] - z * np.eye(k))
            if sum(blocks) == k:  # otherwise they are several eigenvalues, not one
                break
        left = [w for w in left if not belongs(w)]
        share = np.linalg.norm(N @ Z[:, :k], axis=1)
        states = tuple(name for name, part in zip(names, share, strict=True) if part > STATE_SHARE)
        z = complex(np.round(z, DIGITS) + 0.0)  # + 0 makes -0 a 0
        found.append(Mode(z, sum(blocks), len(blocks), states, blocks))
    return [mode for mode in found if abs(mode.eigenvalue) >= radius]


def modes(A: np.ndarray, scale: np.ndarray | None = None) -> list[Mode]:
    """Return all modes of A, as unseen_modes does without any output."""
    return unseen_modes(A, np.zeros((0, len(A))), radius=0.0, scale=scale)


def unreached_modes(
    A: np.ndarray,
    B: np.ndarray,
    names: tuple[str, ...] | None = None,
    radius: float = 1.0 - ON_THE_CIRCLE,
    scale: np.ndarray | None = None,
) -> list[Mode]:
    """Return the modes of (A, B) with |z| >= radius that no control reaches: those of (A^T, B^T) that no output sees.

    An empty list means that (A, B) is stabilisable, and with a radius of 0 that it is controllable. A mode's states are
    those in the combination of states that the controls do not change. Arguments as unseen_modes.
    """
    return unseen_modes(A.T, B.T, names, radius, None if scale is None else 1.0 / scale)


def check_detectable(Phi: np.ndarray, C: np.ndarray, what: str, scale: np.ndarray | None = None) -> None:
    """Raise InputError naming the modes that do not decay and that no output sees, if (Phi, C) has any."""
    if hidden := unseen_modes(Phi, C, scale=scale):
        raise InputError(f"{what}: (Phi, C) is not detectable, no measurement sees {listed(hidden)}")


def listed(modes: list[Mode]) -> str:
    """Return modes as an error names them."""
    return "; ".join(map(str, modes))


RANK = 1e-10  # singular values below this, of matrices of norm about 1, count as 0
NOTHING = 1e-12  # rows of C shorter than this, relative to the longest, count as 0: rounding, not a sensor


def tick_scaling(h: float) -> np.ndarray:
    """Return the units (12) of the states in which Phi contains neither h nor g.

    1 m for a position, 1 / h for a velocity, 1 / (g h^2) for an angle, 1 / (g h^3) for an Euler rate. Such a tilt or
    rate moves the vehicle by about a metre within a tick.
    """
    return np.repeat([1.0, 1.0 / (GRAVITY * h**2), 1.0 / h, 1.0 / (GRAVITY * h**3)], 3)


def rescale(A: np.ndarray, C: np.ndarray, scale: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return T^-1 A T and the rows of C T at unit length, T = diag(scale)."""
    T = np.ones(len(A)) if scale is None else scale
    rows = C * T
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    is_row = length > NOTHING * np.max(length, initial=0.0)
    return A * T / T[:, None], np.divide(rows, length, out=np.zeros_like(rows), where=is_row)


def rank(M: np.ndarray) -> int:
    """Return the number of singular values above RANK times the largest, or times 1 if that is less."""
    s = svdvals(M) if M.size else np.zeros(0)
    return int(np.sum(s > RANK * max(1.0, s[0] if len(s) else 0.0)))


def unobservable_subspace(A: np.ndarray, C: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis N (n x k) of the largest A-invariant subspace in the kernel of C."""
    N = null_space(C, rcond=RANK) if rank(C) else np.eye(len(A))
    size = max(1.0, float(np.linalg.norm(A, 2)))
    while N.shape[1]:
        image = A @ N
        _, s, right = np.linalg.svd(image - N @ (N.T @ image))
        leaving = int(np.sum(s > RANK * size))
        if leaving == 0:
            break
        N = N @ right[leaving:].T
    return N
