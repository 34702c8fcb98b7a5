"""The critical arrival probability: the lowest at which the expected error covariance stays bounded.

x_{k+1} = A x_k + w_k, and all of y_k = C x_k + v_k arrives with probability l, independently in each tick. There is a
critical l_c: above it E[P_k] is bounded from every start; below it E[P_k] grows without bound from some start (B.
Sinopoli et al., "Kalman filtering with intermittent observations", IEEE TAC 49(9), 2004, theorem 2), and

    1 - 1 / max|s|^2  <=  l_c  <=  l_mare  <=  1 - 1 / prod |s_u|^2,

where s are the eigenvalues of A, and s_u those outside the unit circle (L. Schenato, B. Sinopoli, M. Franceschetti, K.
Poolla, S. S. Sastry, "Foundations of control and estimation over lossy networks", Proc. IEEE 95(1), 2007, lemma 5.4).
l_mare is where g's fixed point begins to exist, the matrix inequality of Sinopoli et al., theorem 5. The lower end is
l_c itself where C has full column rank on the unstable subspace (K. Plarre, F. Bullo, "On Kalman filtering for
detectable systems with intermittent observations", IEEE TAC 54(2), 2009) and for every system that is not degenerate
(Y. Mo, B. Sinopoli, "Kalman filtering with intermittent observations: tail distribution and critical value", IEEE TAC
57(3), 2012). With two unstable modes l_c is known for degenerate systems as well.

Let |s_1| = |s_2| = |s| and let C see one combination of the two at a time. Ticks a multiple of d apart show the same
combination, where d is the least whole number with (s_1 / s_2)^d = 1. The rest of the error grows as long as all
arrivals lie in one of the d classes of ticks: by |s|^(2 d) every d ticks, for which d - 1 packets must be lost. So

    l_c = 1 - |s|^(-2 d / (d - 1)),

which is 1 - |s|^-4 for s_2 = -s_1. It falls to 1 - |s|^-2 as d grows. It equals this limit where no power of s_1 / s_2
is 1, and for a Jordan block: there no two arrivals show the same combination. In a channel with memory the same holds
with the chance of d - 1 losses of each d ticks, which growth_in_bursts gives (Y. Mo, B. Sinopoli, "Towards finding the
critical value for Kalman filtering with intermittent observations", 2010; K. You, M. Fu, L. Xie, "Mean square stability
for Kalman filtering with Markovian packet losses", Automatica 47(12), 2011).
"""

from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from scipy.linalg import schur

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.modes.modes import unseen_modes
from ortilo_drake.theory.riccati.riccati_problem import real_matrices

ON_THE_CIRCLE = 1e-6  # |s| up to 1 + this counts as on the unit circle
_WIDTH = 1e-6  # width of the last bracket of l_mare
_POWER_STEPS = 400  # if the power method has not decided by then, l counts as too low, so l_mare errs upwards


@dataclass(frozen=True)
class CriticalRate:
    """The critical rate l_c of a pair (A, C), or None where only its bounds are known; the sentence says so in words.

    The lower bound is 1 - 1 / max|s|^2, or 0 if no |s| exceeds 1. The upper bound is l_mare. `hypotheses` says for each
    hypothesis of the theorems whether it holds.
    """

    rate: float | None
    lower: float
    upper: float
    hypotheses: dict[str, bool]
    sentence: str


def unstable_part(A: np.ndarray, C: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return A_u (k, k) and C_u (m, k): A and C on the invariant subspace of eigenvalues outside the unit circle."""
    T, Z, k = schur(np.asarray(A, dtype=complex), output="complex", sort=lambda s: abs(s) > 1.0 + ON_THE_CIRCLE)
    return T[:k, :k], C @ Z[:, :k]


def is_nondegenerate(A_u: np.ndarray, C_u: np.ndarray) -> bool:
    """Return whether A_u is diagonalisable and C sees each group of equal |s| in one step (Mo and Sinopoli, 2012)."""
    s, S = np.linalg.eig(A_u)
    if np.linalg.cond(S) > 1e8:
        return False
    for modulus in np.unique(np.round(np.abs(s), 8)):
        group = C_u @ S[:, np.abs(np.abs(s) - modulus) < 1e-7]
        if np.linalg.matrix_rank(group, tol=1e-9 * float(np.linalg.norm(C_u))) < group.shape[1]:
            return False
    return True


def mare_growth(A: np.ndarray, C: np.ndarray, rate: float) -> tuple[float, float]:
    """Return a lower and an upper bound on r, the growth rate of h(X) = A X A* - l A X C* (C X C*)^-1 C X A*.

    For large X, g becomes h. h is monotone and homogeneous, so g has a fixed point where r < 1 and none where r > 1.
    For any X > 0, the least and largest eigenvalue of X^-1 h(X) enclose r (Collatz and Wielandt); X comes from the
    power method. That X > h(X) for some X is the matrix inequality of Sinopoli et al., theorem 5. A (n, n) is
    invertible, C is (m, n), and the rate l lies in [0, 1).
    """
    U, s, _ = np.linalg.svd(C, full_matrices=False)
    C = (U.conj().T @ C)[s > 1e-12 * s[0]]  # linearly dependent rows are left out
    X = np.eye(len(A), dtype=complex)
    low, high = 0.0, np.inf
    for _ in range(_POWER_STEPS):
        CX = C @ X
        hX = A @ (X - rate * CX.conj().T @ np.linalg.solve(CX @ C.conj().T, CX)) @ A.conj().T
        hX = (hX + hX.conj().T) / 2.0
        R = np.linalg.inv(np.linalg.cholesky(X))
        spread = np.linalg.eigvalsh(R @ hX @ R.conj().T)
        low, high = max(low, float(spread[0])), min(high, float(spread[-1]))
        if low > 1.0 or high < 1.0 or high - low < 1e-9:
            break
        X = hX / np.trace(hX).real + X / np.trace(X).real  # the shift keeps X from becoming singular and from turning
    return low, high


def mare_critical_rate(A: np.ndarray, C: np.ndarray) -> float:
    """Return l_mare, at most 1e-6 too high: the least l at which g has a fixed point; no eigenvalue of A is stable."""
    moduli = np.abs(np.linalg.eigvals(A))
    below, above = (float(1.0 - 1.0 / size**2) for size in (np.max(moduli), np.prod(moduli)))
    while above - below > _WIDTH:
        middle = (below + above) / 2.0
        if mare_growth(A, C, middle)[1] < 1.0:
            above = middle
        else:
            below = middle
    return above


def critical_rate(A: np.ndarray, C: np.ndarray) -> CriticalRate:
    """Return the critical arrival probability of A (n, n) and C (m, n), its bounds, and the hypotheses checked.

    InputError if (A, C) is not detectable; it names the eigenvalues and states concerned.
    """
    A, C = (np.atleast_2d(M) for M in real_matrices(A=A, C=C))
    unseen = unseen_modes(A, C)
    if unseen:
        raise InputError(f"critical rate: (A, C) is not detectable: C never sees {'; '.join(map(str, unseen))}")
    A_u, C_u = unstable_part(A, C)
    k = len(A_u)
    largest = float(np.max(np.abs(np.linalg.eigvals(A)))) if k else 1.0
    lower = 1.0 - 1.0 / largest**2
    hypotheses = {
        "(A, C) detectable": True,
        "A has eigenvalues outside the unit circle": k > 0,
        "C has full column rank on the unstable subspace": k > 0 and int(np.linalg.matrix_rank(C_u)) == k,
        "A is diagonalisable there and C sees each group of equal modulus in one step": k > 0
        and is_nondegenerate(A_u, C_u),
    }
    if k == 0:
        sentence = (
            "No eigenvalue of A lies outside the unit circle, so the product over the unstable ones is empty and both "
            "bounds are 0: the covariance stays bounded at every arrival probability above 0. The classical critical "
            "probability is 0 and says nothing of how large the error becomes."
        )
        return CriticalRate(0.0, 0.0, 0.0, hypotheses, sentence)
    full_rank, nondegenerate = list(hypotheses.values())[2:]
    upper = lower if full_rank else mare_critical_rate(A_u, C_u)
    if full_rank or nondegenerate:
        why = "C has full column rank on the unstable subspace" if full_rank else "the pair is not degenerate"
        sentence = f"The critical arrival probability is 1 - 1/{largest:.6g}^2 = {lower:.6g}, since {why}."
        return CriticalRate(lower, lower, upper, hypotheses, sentence)
    if k == 2:
        d = ticks_to_repeat(*A_u.diagonal())
        rate = second_order_rate(largest, d)
        power = "2" if d is None else f"{2.0 * d / (d - 1.0):.4g}"
        again = "never twice" if d is None else f"again every {d} ticks"
        sentence = (
            f"The critical arrival probability is 1 - 1/{largest:.6g}^{power} = {rate:.6g}: C shows the same "
            f"combination of the two unstable modes {again}."
        )
        return CriticalRate(rate, lower, upper, hypotheses, sentence)
    sentence = f"The critical arrival probability lies between {lower:.6g} and {upper:.6g}; no theorem here says where."
    return CriticalRate(None, lower, upper, hypotheses, sentence)


def critical_recovery(A: np.ndarray) -> float:
    """Return q_c = 1 - 1/max|s|^2 of A (n, n): bursts that end with probability q per tick need q > q_c.

    For a Gilbert-Elliott channel that loses everything while bad and nothing while good, max|s|^2 (1 - q) < 1 is
    necessary, and for scalar or fully observed unstable systems sufficient, for a bounded E[P] (M. Huang, S. Dey,
    Automatica 43(4), 2007).
    """
    return max(0.0, 1.0 - 1.0 / float(np.max(np.abs(np.linalg.eigvals(np.atleast_2d(A))))) ** 2)


LONGEST = 1000  # largest d considered [ticks]; beyond, l_c is less than 0.002 ln|s| above its limit
SAME = 1e-6  # relative distance below which two eigenvalues count as equal
SAME_ANGLE = 1e-9  # tolerance of an angle, as a fraction of a turn


def ticks_to_repeat(s_1: complex, s_2: complex) -> int | None:
    """Return the least d with (s_1 / s_2)^d = 1; None if no d up to LONGEST fits, or if s_1 = s_2 (a Jordan block)."""
    if abs(s_1 - s_2) <= SAME * abs(s_1):
        return None
    turns = float(np.angle(s_1 / s_2)) / (2.0 * np.pi)
    nearest = Fraction(turns).limit_denominator(LONGEST)
    return nearest.denominator if abs(turns - float(nearest)) <= SAME_ANGLE else None


def second_order_rate(modulus: float, d: int | None) -> float:
    """Return l_c of two modes with |s| = modulus that look alike to C every d ticks; d = None means never."""
    return 1.0 - modulus ** (-2.0 if d is None else -2.0 * d / (d - 1.0))


def growth_in_bursts(modulus: float, d: int | None, failure: float, recovery: float) -> float:
    """Return the growth factor of E[P_k] per tick through a Gilbert-Elliott channel; below 1, E[P_k] is bounded.

    Packets of good ticks arrive, packets of bad ticks are lost. A good tick is followed by a bad one with probability p
    (failure), a bad tick by a good one with q (recovery). Of d ticks (see ticks_to_repeat) the first may be either and
    the other d - 1 are bad: the probability of this, from one first tick to the next, is the spectral radius of a
    matrix of rank 1, p q (1 - q)^(d-2) + (1 - q)^d (You, Fu and Xie, 2011). With p = 1 - l and q = l the losses are
    independent. Both modes have the given modulus, above 1. InputError if p or q lies outside [0, 1].
    """
    for name, chance in (("failure", failure), ("recovery", recovery)):
        if not 0.0 <= chance <= 1.0:
            raise InputError(f"{name}: {chance}: must lie in [0, 1]")
    stays = 1.0 - recovery
    if d is None:
        return modulus**2 * stays
    return modulus**2 * (failure * recovery * stays ** (d - 2) + stays**d) ** (1.0 / d)
