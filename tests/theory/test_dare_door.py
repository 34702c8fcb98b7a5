"""`od.solve_dare`: beside SciPy's solver, a filter's closed form, and what is refused."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

import ortilo_drake as od

A, B = [[1.0, 0.1], [0.0, 1.0]], [[0.005], [0.1]]


@pytest.mark.parametrize("solver", ["scipy", "drake", "doubling", "recursion"])
@pytest.mark.parametrize("N", [None, [[0.1], [0.2]]])
def test_lists_are_solved_as_scipy_solves_them(solver: str, N: list[list[float]] | None) -> None:
    found = od.solve_dare(A, B, np.eye(2), [[1.0]], N, solver=solver)
    X = solve_discrete_are(A, B, np.eye(2), [[1.0]], s=N)
    np.testing.assert_allclose(found.X, X, rtol=1e-9)
    L = np.linalg.solve(1.0 + np.transpose(B) @ X @ B, np.transpose(B) @ X @ A + (0 if N is None else np.transpose(N)))
    np.testing.assert_allclose(found.L, L, rtol=1e-9)
    assert found.quality.spectral_radius == pytest.approx(max(abs(np.linalg.eigvals(A - B @ L))), rel=1e-9)


def test_a_random_walks_filter_is_the_textbooks() -> None:
    w, v = 0.3, 2.0  # P = w / 2 + sqrt(w^2 / 4 + w v) before a measurement
    P = w / 2 + np.sqrt(w**2 / 4 + w * v)
    found = od.solve_dare([[1.0]], [[1.0]], [[w]], [[v]])
    np.testing.assert_allclose([found.X[0, 0], found.L[0, 0]], [P, P / (P + v)], rtol=1e-12)


GROWING = 1.01 * np.array(A)  # no weight sees it: minimum energy


def test_minimum_energy_mirrors_the_growing_modes_at_the_circle() -> None:
    """With Q = 0, Y = X^-1 solves A Y A^T = Y + B R^-1 B^T, and the closed loop has the eigenvalues 1 / z."""
    found = od.solve_dare(GROWING, B, np.zeros((2, 2)), [[1.0]])
    back = np.linalg.inv(GROWING)
    Y = solve_discrete_lyapunov(back, back @ np.array(B) @ np.transpose(B) @ back.T)
    np.testing.assert_allclose(found.X, np.linalg.inv(Y), rtol=1e-8)
    closed = np.linalg.eigvals(GROWING - np.array(B) @ found.L)
    np.testing.assert_allclose(abs(closed), 1.0 / 1.01, rtol=1e-6)  # a double eigenvalue
    assert found.quality.residual < 1e-10


@pytest.mark.parametrize("solver", ["drake", "doubling", "recursion"])
def test_a_solver_that_does_not_reach_the_stabilising_solution_names_one_that_does(solver: str) -> None:
    with pytest.raises(od.InputError, match=r"does not stabilise: .*'scipy' gives"):
        od.solve_dare(GROWING, B, np.zeros((2, 2)), [[1.0]], solver=solver)


def test_an_unseen_mode_inside_is_not_in_the_way_but_one_on_the_circle_is() -> None:
    X = od.solve_dare(np.diag([2.0, 0.5]), [[1.0], [1.0]], np.zeros((2, 2)), [[1.0]]).X
    np.testing.assert_allclose(X, [[3.0, 0.0], [0.0, 0.0]], atol=1e-9)  # z^2 - 1 of the growing mode alone
    for triple in (np.diag([1.0, 2.0, 0.5]), np.eye(3) + np.eye(3, k=1)):  # the second splits by rounding
        with pytest.raises(od.InputError, match="Riccati equation: "):
            od.solve_dare(triple, [[1.0], [1.0], [1.0]], np.zeros((3, 3)), [[1.0]])


@pytest.mark.parametrize(
    ("A", "solver", "said"),
    [
        ([[2.0, 0.0], [0.0, 0.5]], "scipy", r"not stabilisable: no control moves eigenvalue 2"),
        ([[1.0, 0.1]], "scipy", r"^A: shape \(1, 2\)"),
        ([[1.0, np.nan], [0.0, 1.0]], "scipy", "^A: holds NaN or infinity"),
        ([[1.0, 0.1], [0.0, 1.0]], "mine", "^solver: 'mine': must be one of"),
        ([["a", 0.1], [0.0, 1.0]], "scipy", "^A: holds .*must be a matrix of real numbers"),
        ([[1.0, 0.1], [1.0]], "scipy", "^A: its rows differ in length: must be a matrix of real numbers"),
    ],
)
def test_what_has_no_solution_is_told_in_a_line(A: list[list[float]], solver: str, said: str) -> None:
    with pytest.raises(od.InputError, match=said) as refused:
        od.solve_dare(A, [[0.0], [1.0]], np.eye(2), [[1.0]], solver=solver)
    assert "\n" not in str(refused.value)
