"""Riccati solutions against 120 digits, and the one refusal of equations that have none."""

from collections.abc import Iterator

import numpy as np
import pytest
from mpmath import eye, inverse, matrix, mnorm, mpf, sqrt, workdps
from scipy.stats import ortho_group

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.theory.riccati.riccati import RAW, SOLVERS, solve
from ortilo_drake.theory.riccati.riccati_ill_posed import solver_outcomes

Problem = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
UNITS = np.array([2.0**20, 1.0, 2.0**-20, 1.0])  # so that scaling rounds nothing


def exact_solution(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> matrix:
    """X to some 100 digits, by doubling; it solves the equation and stabilises, so it is the one."""
    A, B, Q, R = (matrix(M.tolist()) for M in (A, B, Q, R))
    A_k, G, X, one = A, B * inverse(R) * B.T, Q, eye(A.rows)
    for _ in range(60):
        W = inverse(one + G * X)
        A_k, G, X, before = A_k * W * A_k, G + A_k * W * G * A_k.T, X + A_k.T * X * W * A_k, X
        if mnorm(X - before, 1) <= mpf(10) ** -100 * mnorm(X, 1):
            break
    L = inverse(R + B.T * X * B) * B.T * X * A
    A_c = A - B * L
    assert mnorm(A.T * X * A_c - X + Q, 1) < mpf(10) ** -80 * mnorm(X, 1)
    for _ in range(40):
        A_c = A_c * A_c
    assert mnorm(A_c, 1) < 1e-9
    return X


def error(X: np.ndarray, exact: matrix) -> float:
    """The largest |X_ij - exact_ij| / sqrt(exact_ii exact_jj), the same in all units."""
    n = range(len(X))
    return float(max(abs(X[i, j] - exact[i, j]) / sqrt(exact[i, i] * exact[j, j]) for i in n for j in n))


def weight(rng: np.random.Generator, n: int, digits: float, turned: bool) -> np.ndarray:
    """A weight of condition 10^digits, diagonal or turned at random."""
    U = ortho_group.rvs(n, random_state=rng) if turned else np.eye(n)
    M = U * np.logspace(0.0, -digits, n) @ U.T
    return (M + M.T) / 2.0


def family() -> Iterator[Problem]:
    """Equations of 4 states and 3 inputs, over the condition of R and Q, in units of one size and far apart."""
    rng = np.random.default_rng(0)
    for of_R in (0.0, 8.0, 12.0, 15.0):
        for of_Q in (0.0, 11.0):
            for turned in (False, True):
                A, B = rng.standard_normal((4, 4)), rng.standard_normal((4, 3))
                Q, R = weight(rng, 4, of_Q, turned), weight(rng, 3, of_R, turned)
                yield A, B, Q, R
                yield UNITS[:, None] * A / UNITS, UNITS[:, None] * B, Q / UNITS / UNITS[:, None], 1e-6 * R


@pytest.mark.long
def test_every_solver_is_right_to_eight_digits_or_refuses() -> None:
    right = dict.fromkeys(SOLVERS, 0)
    with workdps(120):
        for problem in family():
            exact = exact_solution(*problem)
            for name, solver in SOLVERS.items():
                try:
                    X = solver(*problem)
                except InputError:
                    continue
                assert error(X, exact) < 1e-8, name
                right[name] += 1
    assert right["scipy"] == right["doubling"] == right["recursion"] == 32
    assert right["drake"] >= 24  # elsewhere, with R of condition 1e12 and more, Drake's X does not stabilise


def test_a_small_weight_that_drake_loses_is_recovered() -> None:
    """A state apart, that no input moves: X_22 = q / (1 - a^2)."""
    a, q = 0.9, 1e-11
    problem = np.diag([0.5, a]), np.array([[1.0], [0.0]]), np.diag([1.0, q]), np.eye(1)
    assert abs(RAW["drake"](*problem)[1, 1] * (1.0 - a * a) / q - 1.0) > 1e-3
    for name in SOLVERS:
        assert solve(*problem, solver=name)[1, 1] == pytest.approx(q / (1.0 - a * a), rel=1e-11)


def free_control(k: float, q: float) -> Problem:
    """R = [k, 1]^T [k, 1] makes u = (1, -k) free; with it, A - B L = [[0, 0], [0, 1]] for X = diag(q, 0).

    The other control moves the second state only at a cost. Without any, the cost stays 0 and the state where it is.
    """
    A, B = np.array([[0.0, -1.0], [0.0, k]]), np.array([[1.0, 0.0], [1.0, 1.0]])
    return A, B, np.diag([q, 0.0]), np.array([[k * k, k], [k, 1.0]])


@pytest.mark.parametrize(("k", "q"), [(2.0, 1.0), (5.0, 0.3), (0.7, 1e4)])  # the first: QuantEcon.py, issue 360
@pytest.mark.parametrize("units", [(1.0, 1.0), (1e5, 1e-3)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_mode_that_a_singular_R_hides_is_refused_by_all_alike(
    k: float, q: float, units: tuple[float, ...], sign: float
) -> None:
    A, B, Q, R = free_control(k, q)
    A, B = sign * A, sign * B  # the mode is then -1
    T = np.array(units)
    problem = A * T / T[:, None], B / T[:, None], Q * T * T[:, None], R
    messages = set()
    for solver in SOLVERS.values():
        with pytest.raises(
            InputError, match=f"R makes free, .* sees eigenvalue {sign:g} in state 2, numerically on"
        ) as e:
            solver(*problem)
        messages.add(str(e.value))
    assert len(messages) == 1


def test_a_control_that_moves_the_mode_makes_it_solvable() -> None:
    A, B, Q, R = free_control(3.0, 2.0)
    Q[1, 1] = 1e-4
    solutions = [solve(A, B, Q, R, solver=name) for name in ("scipy", "doubling", "recursion")]
    for X in solutions:
        np.testing.assert_allclose(X, solutions[0], rtol=1e-9, atol=1e-12)


def test_units_change_nothing_but_units() -> None:
    A, B = np.eye(4) + 0.1 * np.eye(4, k=1), np.eye(4)[:, 3:]
    for name in SOLVERS:
        X = solve(A, B, np.eye(4), np.eye(1), solver=name)
        scaled = UNITS[:, None] * A / UNITS, UNITS[:, None] * B, np.diag(UNITS**-2.0), np.eye(1)
        np.testing.assert_allclose(UNITS[:, None] * solve(*scaled, solver=name) * UNITS, X, rtol=1e-9)


def test_a_slow_mode_without_weight_is_solved_and_one_on_the_circle_is_not() -> None:
    one, nothing = np.eye(1), np.zeros((1, 1))
    for name in SOLVERS:
        assert solve((1.0 - 1e-7) * one, one, nothing, one, solver=name) == 0.0  # the cost of doing nothing
        with pytest.raises(InputError, match=r"sees eigenvalue 1 in state 1, numerically on the unit circle"):
            solve((1.0 - 1e-10) * one, one, nothing, one, solver=name)


def test_a_closed_loop_numerically_on_the_circle_is_refused_before_solving() -> None:
    """For a = 1 the closed loop is at about 1 - sqrt(q)."""
    messages = set()
    for solver in SOLVERS.values():
        with pytest.raises(InputError, match="from the unit circle, numerically on it: no stabilising solution") as e:
            solver(np.diag([1.0, 0.5]), np.ones((2, 1)), np.diag([1e-18, 1.0]), np.eye(1))
        messages.add(str(e.value))
    assert len(messages) == 1


def test_indefinite_weights_do_not_hide_behind_units() -> None:
    with pytest.raises(InputError, match=r"^Q: eigenvalue -0\.01: must be positive semidefinite"):
        solve(0.5 * np.eye(2), np.eye(2), np.diag([1e12, -1e-2]), np.eye(2))
    with pytest.raises(InputError, match=r"^R: eigenvalue -1e-06"):
        solve(0.5 * np.eye(2), np.eye(2), np.eye(2), np.diag([1e12, -1e-6]))


def test_solvers_failing_on_a_well_posed_problem_say_so() -> None:
    """Three inputs for one state, all but free: R + B^T X B is singular but for rounding."""
    B = np.array([[-4.25e4, -1.938, -7.04e7]])
    problem = np.array([[0.5]]), B, np.array([[2.4e-4]]), np.diag([2.6e-7, 2.4e-19, 1.1e-6])
    assert solver_outcomes(*problem).error is None
    with pytest.raises(InputError, match=r"scipy fails on a well-posed problem: R .* is numerically singular"):
        solve(*problem)
