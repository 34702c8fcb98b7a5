"""The DAREX collection: Benner, Laub, Mehrmann, SPC 95_23 (1995), and Abels, Benner, SLICOT Working Note 1999-16.

Numbered as in the second. The figures are those of the collection's own programs; where the first has a closed-form
solution or prints condition numbers, they are the reference. Its 1.13 (26 states, a data file) is left out.
"""

from contextlib import suppress
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.riccati.riccati import RAW, SOLVERS
from ortilo_drake.theory.riccati.riccati_check import assess, condition, residual

SQRT5 = np.sqrt(5.0)


class Case(NamedTuple):
    A: np.ndarray
    B: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    N: np.ndarray | None = None
    X: np.ndarray | None = None


def matrix(rows: str) -> np.ndarray:
    return np.array([[float(entry) for entry in row.split()] for row in rows.split(";")])


def laub_1(r: float) -> Case:  # 2.1: uncontrollable, unobservable data
    Q = matrix("9 6; 6 4")
    return Case(matrix("4 3; -4.5 -3.5"), matrix("1; -1"), Q, np.array([[r]]), X=(1 + np.sqrt(1 + 4 * r)) / 2 * Q)


def laub_2(eps: float) -> Case:  # 2.2: increasingly ill-conditioned R
    R = np.diag([1 / (3 * eps), 3 * eps])
    return Case(np.diag([0.9512, 0.9048]), matrix("4.877 4.877; -1.1895 3.569"), np.diag([0.005, 0.02]), R)


def bad_scaling(eps: float) -> Case:  # 2.3
    return Case(np.array([[0, eps], [0, 0]]), matrix("0; 1"), np.eye(2), np.eye(1), X=np.diag([1, 1 + eps**2]))


def petkov(eps: float) -> Case:  # 2.4
    U = np.eye(3) - 2 / 3
    X = eps * U @ np.diag([1, (1 + SQRT5) / 2, (9 + np.sqrt(85)) / 2]) @ U
    return Case(U @ np.diag([0.0, 1, 3]) @ U, np.eye(3), eps * np.eye(3), eps * np.eye(3), X=X)


def paper_process(tau: float, D: float = 1.0, K: float = 1.0, r: float = 0.25) -> Case:  # 2.5
    alpha, beta = 1 - D / tau, K * D / tau
    A = np.eye(4, k=-1)
    A[0, 0] = alpha
    t = r * (alpha + 1) * (alpha - 1) + beta**2
    X = np.diag([(t + np.sqrt(t**2 + 4 * beta**2 * r)) / (2 * beta**2), 1, 1, 1])
    return Case(A, beta * np.eye(4)[:, :1], np.diag([0.0, 0, 0, 1]), np.array([[r]]), X=X)


def shift(n: int, r: float = 1.0) -> Case:  # 4.1
    return Case(np.eye(n, k=1), np.eye(n)[:, -1:], np.eye(n), np.array([[r]]), X=np.diag(np.arange(1.0, n + 1)))


def gajic_shen() -> Case:  # 1.8: chemical plant
    A = matrix(
        "95.407 1.9643 0.3597 0.0673 0.019; 40.849 41.317 16.084 4.4679 1.1971; 12.217 26.326 36.149 15.93 12.383;"
        "4.1118 12.858 27.209 21.442 40.976; 0.1305 0.5808 1.875 3.6162 94.28"
    )
    B = matrix("0.0434 -0.0122; 2.6606 -1.0453; 3.753 -5.51; 3.6076 -6.6; 0.4617 -0.9148")
    return Case(A / 100, B / 100, np.eye(5), np.eye(2))


def lu_lin() -> Case:  # 1.7
    B = 2 * np.eye(4) - np.triu(np.ones((4, 4)))
    C = matrix("1 1 2 4; 0 1 1 2; 0 0 1 1; 0 0 0 1")
    Q_0 = matrix("2 -1 0 0; -1 2 -1 0; 0 -1 2 0; 0 0 0 0")
    return Case(B @ matrix("0.4 0 0 0; 1 0.6 0 0; 0 1 0.8 0; 0 0 0 -0.999982") @ C, B, C.T @ Q_0 @ C, np.eye(4))


def davison_wang() -> Case:  # 1.9: nonzero N
    C, D = matrix("1 1 0 0 0 0; 0 0 0 1 -1 0"), matrix("1 0; 1 0")
    A = np.kron(np.eye(2), np.eye(3, k=1))
    return Case(A, np.eye(6)[:, [2, 5]], C.T @ C, np.eye(2) + D.T @ D, N=C.T @ D)


def patnaik() -> Case:  # 1.10: tubular ammonia reactor; B is a tenth of the one in SciPy's tests
    A = matrix(
        "870.1 135.0 11.59 0.5014 -37.22 0.3484 0 4.242 7.249; 76.55 897.4 12.72 0.5504 -40.16 0.3743 0 4.53 7.499;"
        "-127.2 357.5 817.0 1.455 -102.8 0.987 0 11.85 18.72; -363.5 633.9 74.91 796.6 -273.5 2.653 0 31.72 48.82;"
        "-960.0 1645.9 -128.9 -5.597 71.42 7.108 0 84.52 125.9; -664.4 112.96 -88.89 -3.854 84.47 13.6 0 144.3 101.6;"
        "-410.2 693.0 -54.71 -2.371 66.49 12.49 0.1063 99.97 69.67;"
        "-179.9 301.7 -23.93 -1.035 60.59 22.16 0 213.9 35.54;"
        "-345.1 580.4 -45.96 -1.989 105.6 19.86 0 219.1 215.2"
    )
    B = matrix(
        "4.76 -0.5701 -83.68; 0.879 -4.773 -2.73; 1.482 -13.12 8.876; 3.892 -35.13 24.8; 10.34 -92.75 66.8;"
        "7.203 -61.59 38.34; 4.454 -36.83 20.29; 1.971 -15.54 6.937; 3.773 -30.28 14.69"
    )
    return Case(A / 1e3, B / 1e4, np.diag([50.0, 0, 0, 0, 50, 0, 0, 0, 0]), np.eye(3))


def sima_integrators() -> Case:  # 1.11: paper machine
    A = np.diag([1.0] * 4 + [0.0] * 6, k=-1)
    A[5, 4:6], A[6, [4, 6]] = [0.222, 0.778], [0.4, 0.6]
    A[7, 7:9], A[8, 7] = [1.372, -0.47], 1
    A[9, [5, 9]], A[10, [6, 7, 8, 10]] = [-15, 1], [-7, 5.357, 3.943, 1]
    B, C = np.zeros((11, 2)), np.zeros((4, 11))
    B[0, 0], B[7, 1] = 1, 0.098
    C[0, 5], C[1, 6:9], C[2, 9], C[3, 10] = 15, [7, -5.357, -3.943], 1, 1
    return Case(A, B, C.T @ np.diag([0.5, 5, 0.5, 5]) @ C, np.diag([400.0, 700]))


def sima_disturbances() -> Case:  # 1.12: paper machine
    A = np.zeros((13, 13))
    A[:10, 1:11] = np.eye(10)
    A[5, 6], A[7, 8] = 0, 0
    A[11, 11], A[12, 12], A[11, 0], A[12, 0] = 1, 1, -3.318, -1.5484
    A[5, 5], A[7, 6], A[12, 6], A[7, 7], A[12, 7], A[12, 8] = 0.7788, -0.4724, 0.3981, 1.3746, 0.5113, 5.7865
    A[10, 10] = 0.8071
    B, C = np.zeros((13, 2)), np.zeros((4, 13))
    B[5, 0], B[7, 1] = 1, 1
    C[0, 0], C[1, [0, 6, 7, 8]], C[2, 11], C[3, 12] = 3.318, [1.5484, -0.3981, -0.5113, -5.7865], 1, 1
    return Case(A, B, C.T @ np.diag([0.5, 5, 0.5, 5]) @ C, np.diag([400.0, 700]))


CASES = {
    "1.1": Case(matrix("2 -1; 1 0"), matrix("1; 0"), np.diag([0.0, 1]), np.zeros((1, 1)), X=np.eye(2)),
    "1.3": Case(
        matrix("0 1; 0 0"), matrix("0; 1"), matrix("1 2; 2 4"), np.eye(1), X=np.array([[1, 2], [2, 2 + SQRT5]])
    ),
    "1.5": Case(
        matrix("0.998 0.067 0 0; -0.067 0.998 0 0; 0 0 0.998 0.153; 0 0 -0.153 0.998"),
        matrix("0.0033 0.02; 0.1 -0.0007; 0.04 0.0073; -0.0028 0.1"),
        matrix("1.87 0 0 -0.244; 0 0.744 0.205 0; 0 0.205 0.589 0; -0.244 0 0 1.048"),
        np.eye(2),
    ),
    "1.6": Case(
        matrix(
            "0.98475 -0.079903 0.0009054 -0.0010765; 0.041588 0.99899 -0.035855 0.012684;"
            "-0.54662 0.044916 -0.32991 0.19318; 2.6624 -0.10045 -0.92455 -0.26325"
        ),
        matrix("0.0037112 0.0007361; -0.087051 9.3411e-6; -1.19844 -4.1378e-4; -3.1927 9.2535e-4"),
        0.01 * np.eye(4),
        np.eye(2),
    ),
    "1.7": lu_lin(),
    "1.8": gajic_shen(),
    "1.9": davison_wang(),
    "1.10": patnaik(),
    "1.11": sima_integrators(),
    "1.12": sima_disturbances(),
    "2.1": laub_1(1.0),
    "2.1 r=1e6": laub_1(1e6),
    "2.2": laub_2(1.0),
    "2.2 eps=1e6": laub_2(1e6),
    "2.3 eps=1": bad_scaling(1.0),
    "2.3 eps=1e6": bad_scaling(1e6),
    "2.4 eps=1": petkov(1.0),
    "2.4 eps=1e6": petkov(1e6),
    "2.5 tau=1.57": paper_process(1.57, 12.34),
    "2.5 tau=100": paper_process(100.0),
    "2.5 tau=1e4": paper_process(1e4),
    "2.5 tau=1e8": paper_process(1e8),
    "4.1 n=3": shift(3, 4.0),
    "4.1 n=100": shift(100),
}  # fmt: skip

TOLERANCE = 1e-10

# What keeps a solver from the tolerance, and the figure that shows it.
REFUSED_BY_DRAKE = "Q - N R^-1 N^T is semidefinite, and rounding puts a pivot of Drake's own test below 0"
REASONS = {
    ("1.1", "drake"): "R = 0; Drake takes R > 0 only",
    ("1.9", "drake"): REFUSED_BY_DRAKE,
    ("1.11", "drake"): REFUSED_BY_DRAKE,
    ("1.12", "drake"): REFUSED_BY_DRAKE,
    ("2.5 tau=1e8", "recursion"): "the closed loop's radius is 1 - 2.2e-8: the recursion needs some 1e9 steps",
}


# Where the distance from the closed form exceeds the tolerance although the residual does not.
ERRORS = {
    ("2.1 r=1e6", "scipy"): 1e-9,  # residual 6e-13 over 1 - radius^2 = 2e-3
    ("2.5 tau=1e8", "drake"): 1e-8,  # condition 1.8e8: a relative 2e-16 in A moves X by 4e-8
    ("2.5 tau=1e8", "doubling"): 1e-8,
    ("2.5 tau=1e8", "scipy"): 4e-8,
}


@pytest.mark.family
@pytest.mark.parametrize(("name", "solver"), [pair for pair in product(CASES, SOLVERS) if pair not in REASONS])
def test_residual_and_closed_form(name, solver):
    A, B, Q, R, N, X_exact = CASES[name]
    X = SOLVERS[solver](A, B, Q, R, N)
    assert residual(A, B, Q, R, X, N) < TOLERANCE
    assert np.array_equal(X, X.T)
    assert np.linalg.eigvalsh(X)[0] > -1e-12 * np.linalg.norm(X, 2)
    if X_exact is not None:
        assert np.linalg.norm(X - X_exact) / np.linalg.norm(X_exact) < ERRORS.get((name, solver), TOLERANCE)
    if len(A) < 100:
        result = assess(A, B, Q, R, X, N)
        assert result.spectral_radius < 1
        assert 0 < result.distance_to_instability <= 1 - result.spectral_radius + 1e-12


def test_reasons_hold():
    with pytest.raises(InputError, match="R: Drake takes positive definite ones only"):
        SOLVERS["drake"](*CASES["1.1"][:4])
    with pytest.raises(SystemExit, match="R_llt"):
        RAW["drake"](*CASES["1.1"][:4])

    for name in ("1.9", "1.11", "1.12"):
        A, B, Q, R, N, _ = CASES[name]
        with suppress(InputError):  # in balanced units the rounding is another
            assert residual(A, B, Q, R, SOLVERS["drake"](A, B, Q, R, N), N) < TOLERANCE
        with pytest.raises(SystemExit, match="Q_ldlt"):
            RAW["drake"](A, B, Q, R, *([] if N is None else [N]))
        eigenvalues = np.linalg.eigvalsh(Q if N is None else Q - N @ np.linalg.solve(R, N.T))
        assert abs(eigenvalues[0]) < 1e-13 * eigenvalues[-1]

    A, B, Q, R, N, X_exact = CASES["2.5 tau=1e8"]
    with pytest.raises(InputError, match="recursion: still changes"):
        RAW["recursion"](A, B, Q, R, limit=1000)
    radius = assess(A, B, Q, R, X_exact).spectral_radius
    assert 1 - radius == pytest.approx(2.236e-8, rel=0.01)


@pytest.mark.parametrize(
    ("name", "radius", "norm", "kappa"),
    [("2.1", 0.5, 21.034, 18.845), ("2.5 tau=1.57", 2.3253e-2, 1.1898, 264.84), ("4.1 n=3", 0.0, 3.0, 1.9854)],
)
def test_figures_printed_with_the_collection(name, radius, norm, kappa):
    A, B, Q, R, _, X = CASES[name]
    assert assess(A, B, Q, R, X).spectral_radius == pytest.approx(radius, rel=5e-5)
    assert np.linalg.norm(X, 2) == pytest.approx(norm, rel=5e-5)
    assert condition(A, B, Q, R, X) == pytest.approx(kappa, rel=5e-5)


# 1.2 (Ionescu, Weiss) and 1.4 (Sun) have indefinite weights: equations with a solution, but of no least cost.
INDEFINITE = {
    "1.2": (
        matrix("0 1; 0 -1"),
        matrix("1 0; 2 1"),
        matrix("-4 -4; -4 7") / 11,
        matrix("9 3; 3 1"),
        matrix("3 1; -1 7"),
    ),
    "1.4": (
        matrix("0 0.1 0; 0 0 0.01; 0 0 0"),
        np.eye(3)[:, [0, 2]],
        np.diag([1e5, 1e3, -10.0]),
        np.diag([0.0, 1.0]),
        np.zeros((3, 2)),
    ),
}


@pytest.mark.parametrize("name", INDEFINITE)
def test_indefinite_weights_are_refused_by_all(name):
    messages = set()
    for solver in SOLVERS.values():
        with pytest.raises(InputError, match=r"^Q: eigenvalue -.*: must be positive semidefinite") as error:
            solver(*INDEFINITE[name])
        messages.add(str(error.value))
    assert len(messages) == 1
    A, B, Q, R, N = INDEFINITE[name]
    X = RAW["scipy"](A, B, Q, R, N)
    assert residual(A, B, Q, R, X, N) < TOLERANCE  # a solution there is
    if name == "1.4":  # by hand, of the figures as stored in SLICOT
        assert np.allclose(X, np.diag([1e5, 1e3, -9.9]), rtol=1e-12, atol=1e-9)
