"""LQG through lossy links: SciPy's DARE, closed forms, Kronecker products, a minimiser, and simulated costs."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.optimize import minimize

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, weight_matrices
from ortilo_drake.scenario import ServoWeights
from ortilo_drake.theory.lossy_control.lossy_gain import (
    acknowledged_gain,
    critical_command_rate,
    critical_unacknowledged_rate,
    unacknowledged_gain,
)

A = np.array([[1.2, 0.3], [0.0, 0.9]])
B = np.array([[0.1], [1.0]])
W, U, Q = np.diag([1.0, 0.2]), np.array([[0.5]]), np.array([[0.3, 0.1], [0.1, 0.2]])
ONE = np.eye(1)


def cost_of(L: np.ndarray, nu: float) -> float:
    """Return E[x^T W x + nu_k u^T U u] of a tick with u = -L x, x known: the second moment by Kronecker products."""
    closed = A - B @ L
    step = (1.0 - nu) * np.kron(A, A) + nu * np.kron(closed, closed)
    if np.max(np.abs(np.linalg.eigvals(step))) >= 1.0:
        return np.inf
    X = np.linalg.solve(np.eye(4) - step, Q.ravel()).reshape(2, 2)
    return float(np.trace((W + nu * L.T @ U @ L) @ X))


def test_without_losses_both_gains_are_the_lq_gain() -> None:
    S = solve_discrete_are(A, B, W, U)
    L = np.linalg.solve(B.T @ S @ B + U, B.T @ S @ A)
    np.testing.assert_allclose(acknowledged_gain(A, B, W, U, 1.0)[0], L, rtol=1e-7)
    for gamma in (1.0, 0.6):
        np.testing.assert_allclose(unacknowledged_gain(A, B, W, U, 1.0, gamma)[0], L, rtol=1e-7)


@pytest.mark.parametrize("nu", [0.45, 0.7, 0.95])
def test_no_other_gain_costs_less_and_the_cost_is_the_trace(nu: float) -> None:
    L, S = acknowledged_gain(A, B, W, U, nu)
    assert cost_of(L, nu) == pytest.approx(np.trace(S @ Q), rel=1e-7)
    best = minimize(lambda ell: cost_of(ell[None], nu), L[0] * 1.1, method="Nelder-Mead", options={"xatol": 1e-8})
    assert best.fun == pytest.approx(np.trace(S @ Q), rel=1e-6)
    np.testing.assert_allclose(best.x, L[0], atol=1e-4)


@pytest.mark.parametrize(("a", "nu"), [(1.0, 0.1), (1.25, 0.5), (2.0, 0.9)])
def test_a_scalar_acknowledged(a: float, nu: float) -> None:
    """s = a^2 s + w - nu a^2 s^2 / (s + u) is s^2 (1 - a^2 (1 - nu)) + s (u - a^2 u - w) - w u = 0 for b = 1."""
    w, u = 0.7, 0.4
    s = max(np.roots([1.0 - a**2 * (1.0 - nu), u - a**2 * u - w, -w * u]))
    L, S = acknowledged_gain(a * ONE, ONE, w * ONE, u * ONE, nu)
    assert S[0, 0] == pytest.approx(s, rel=1e-8)
    assert L[0, 0] == pytest.approx(s * a / (s + u), rel=1e-8)


def test_the_least_acknowledged_arrivals_of_one_control() -> None:
    """1 - 1 / prod |s_u|^2 of the unstable eigenvalues; the vehicle, all of whose eigenvalues are 1, bears any loss."""
    two = np.diag([1.3, -1.2, 0.4])
    critical = critical_command_rate(two, np.ones((3, 1)))
    assert critical == pytest.approx(1.0 - 1.0 / (1.3 * 1.2) ** 2, abs=2e-6)
    assert critical_command_rate(two, np.eye(3)) == pytest.approx(1.0 - 1.0 / 1.3**2, abs=2e-6)
    with pytest.raises(InputError, match=r"^nu: 0\.58: must be above 0\.58"):
        acknowledged_gain(two, np.ones((3, 1)), np.eye(3), ONE, 0.58)
    L, _ = acknowledged_gain(two, np.ones((3, 1)), np.eye(3), ONE, critical + 0.01)
    closed = two - L
    step = (1.0 - critical - 0.01) * np.kron(two, two) + (critical + 0.01) * np.kron(closed, closed)
    assert np.max(np.abs(np.linalg.eigvals(step))) < 1.0
    Phibar, Gammabar = augmented_pair(M100, 1.0 / 30.0)
    assert critical_command_rate(Phibar, Gammabar) == 0.0
    L, _ = acknowledged_gain(Phibar, Gammabar, *weight_matrices(ServoWeights()), 0.1)
    closed = Phibar - Gammabar @ L
    step = 0.9 * np.kron(Phibar, Phibar) + 0.1 * np.kron(closed, closed)
    assert np.max(np.abs(np.linalg.eigvals(step))) < 1.0


@pytest.mark.family
@pytest.mark.parametrize(("nu", "gamma"), [(0.8, 1.0), (0.7, 0.6), (0.9, 0.75)])
def test_the_unacknowledged_cost_is_that_of_a_simulation(nu: float, gamma: float) -> None:
    """4000 paths of 400 ticks, the first 100 left out: the cost by what the estimator does, no formula of its error."""
    L, S, T = unacknowledged_gain(A, B, W, U, nu, gamma)
    random = np.random.default_rng(3)
    paths, root = 4000, np.linalg.cholesky(Q)
    x, xhat, costs = np.zeros((paths, 2)), np.zeros((paths, 2)), []
    for k in range(400):
        arrived = random.random((paths, 1)) < gamma
        xhat = np.where(arrived, x, xhat)
        u, acts = -xhat @ L.T, random.random((paths, 1)) < nu
        if k >= 100:
            costs.append(np.einsum("ij,jk,ik->i", x, W, x) + acts[:, 0] * np.einsum("ij,jk,ik->i", u, U, u))
        x = x @ A.T + acts * (u @ B.T) + random.normal(size=(paths, 2)) @ root.T
        xhat = xhat @ A.T + nu * (u @ B.T)
    of_paths = np.mean(costs, axis=0)
    error = float(of_paths.std() / np.sqrt(paths))
    assert of_paths.mean() == pytest.approx(np.trace((S + (1.0 - gamma) * T) @ Q), abs=4.0 * error)
    assert error < 0.03 * of_paths.mean()


def test_where_the_state_always_arrives_acknowledgement_changes_nothing() -> None:
    L, S = acknowledged_gain(A, B, W, U, 0.7)
    with_none = unacknowledged_gain(A, B, W, U, 0.7, 1.0)
    np.testing.assert_allclose(with_none[0], L, rtol=1e-6)
    np.testing.assert_allclose(with_none[1], S, rtol=1e-6)


@pytest.mark.family
@pytest.mark.parametrize("gamma", [0.5, 0.8, 1.0])
@pytest.mark.parametrize("n", [1, 3])
def test_the_least_unacknowledged_arrivals(n: int, gamma: float) -> None:
    """For a square B the recursion settles above the closed form; below it diverges, with fewer controls too."""
    random = np.random.default_rng(n)
    wild = random.normal(size=(n, n))
    wild *= 1.2 / np.max(np.abs(np.linalg.eigvals(wild)))
    square = random.normal(size=(n, n))
    critical = critical_unacknowledged_rate(wild, gamma)
    assert critical is not None
    assert 1.44 * (critical + gamma - 2.0 * critical * gamma) == pytest.approx(critical + gamma - critical * gamma)
    unacknowledged_gain(wild, square, np.eye(n), np.eye(n), critical + 0.02, gamma)
    for B_n in (square, square[:, :1]):
        with pytest.raises(InputError, match="too few arrivals"):
            unacknowledged_gain(wild, B_n, np.eye(n), np.eye(B_n.shape[1]), critical - 0.02, gamma)


def test_no_command_helps_where_the_state_arrives_too_seldom() -> None:
    assert critical_unacknowledged_rate(np.diag([2.0, 0.5]), 0.74) is None
    assert critical_unacknowledged_rate(np.diag([2.0, 0.5]), 1.0) == pytest.approx(0.75)
    assert critical_unacknowledged_rate(np.diag([1.0, 0.5]), 0.1) == 0.0


def test_pairs_without_a_gain_are_refused() -> None:
    for gain in (acknowledged_gain, lambda *pair: unacknowledged_gain(*pair, 0.9)):
        with pytest.raises(InputError, match=r"not stabilisable: no control reaches eigenvalue 1\.5 in state 1"):
            gain(np.diag([1.5, 0.5]), np.array([[0.0], [1.0]]), np.eye(2), ONE, 0.9)
    with pytest.raises(InputError, match="not detectable: no weight sees eigenvalue 1 in state 1"):
        acknowledged_gain(np.diag([1.0, 0.5]), np.eye(2), np.diag([0.0, 1.0]), np.eye(2), 0.9)
    with pytest.raises(InputError, match=r"^nu: 1\.2: an arrival rate must lie in \[0, 1\]$"):
        acknowledged_gain(A, B, W, U, 1.2)
