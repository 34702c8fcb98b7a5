""""""

import json
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mpmath import eye, inverse, matrix, mnorm, mpf, sqrt, workdps
from scipy.linalg import eigvals
from scipy.stats import ortho_group

from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.signals import STATE_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import Scenario, load_scenario
from ortilo_drake.studies.loop.hover_loop import hover_loop, steady_predictor
from ortilo_drake.studies.loop.riccati_report import (
    Unsolved,
    filter_dare,
    four_solutions,
    riccati_report,
    servo_and_filter_dares,
    servo_dare,
)
from ortilo_drake.theory.modes.modes import unreached_modes, unseen_modes
from ortilo_drake.theory.riccati.riccati import RAW, SOLVERS, gain, solve
from ortilo_drake.theory.riccati.riccati_check import assess, least_singular_value, stability_radius
from ortilo_drake.theory.riccati.riccati_ill_posed import ILL_POSED, solver_outcomes
from ortilo_drake.theory.riccati.riccati_problem import require_well_posed

V = np.diag([0.05] * 3 + [0.08] * 3 + [1e-4] * 3)
ALL = ("uwb", "camera", "imu")
seeds = st.integers(0, 2**32 - 1)


def random_problem(seed):
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 7), rng.integers(1, 4)
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, m))
    M = rng.standard_normal((n + m, n + m + 2))
    weights = M @ M.T
    return A, B, weights[:n, :n]


@settings(max_examples=15, deadline=None)
@given(seeds)
def test_singular_R_is_solved_by_all_but_drake(seed):
    A, B, Q = random_problem(seed)
    R = np.zeros((B.shape[1], B.shape[1]))
    if B.shape[1] > len(A):
        B, R = B[:, : len(A)], R[: len(A), : len(A)]
    solutions = [solver(A, B, Q, R) for name, solver in SOLVERS.items() if name != "drake"]
    for X in solutions:
        assert np.allclose(X, solutions[0], rtol=0, atol=1e-6 * np.linalg.norm(X))


@pytest.mark.parametrize("case", ILL_POSED)
def test_all_four_refuse_with_one_error(case):
    messages = set()
    for solver in SOLVERS.values():
        with pytest.raises(InputError) as error:
            solver(*ILL_POSED[case])
        messages.add(str(error.value))
    assert len(messages) == 1
    assert "\n" not in messages.pop()


@pytest.mark.parametrize(
    ("case", "words"),
    [
        ("hidden on the circle", "no weight sees eigenvalue 1 in a, numerically on the unit circle"),
        ("hidden outside", "no weight sees eigenvalue 2 in a, outside the unit circle"),
        ("stuck on the circle", "not stabilisable: no control moves eigenvalue 1 in a"),
        ("stuck outside", "not stabilisable: no control moves eigenvalue 2 in a"),
        ("unweighted turn", r"eigenvalue 0\+1i in a, b; eigenvalue 0-1i in a, b"),
        ("Q indefinite", "Q: eigenvalue -1: must be positive semidefinite"),
        ("R indefinite", "R: eigenvalue -1: must be positive semidefinite"),
        ("Q not symmetric", "Q: differs from its transpose by 1"),
        ("B of another height", r"B: shape \(3, 3\): must have the 2 rows of A"),
        ("NaN", "A: holds NaN"),
    ],
)
def test_errors_name_the_modes(case, words):
    with pytest.raises(InputError, match=words):
        require_well_posed(*ILL_POSED[case], names=("a", "b"))


def test_cross_weight_too_large_and_unknown_solver():
    with pytest.raises(InputError, match="indefinite"):
        solve(np.eye(1), np.eye(1), np.eye(1), np.eye(1), 2 * np.eye(1))
    with pytest.raises(InputError, match=r"N: shape \(2, 1\): must be \(1, 1\)"):
        solve(np.eye(1), np.eye(1), np.eye(1), np.eye(1), np.ones((2, 1)))
    with pytest.raises(InputError, match="must be one of drake, scipy, doubling, recursion"):
        solve(np.eye(1), np.eye(1), np.eye(1), np.eye(1), solver="slicot")
    with pytest.raises(InputError, match=r"R: .*singular"):
        solve(np.eye(1), np.zeros((1, 1)) + [[1.0, 0.0]], np.eye(1), np.diag([1.0, 0.0]))


@pytest.mark.parametrize("solver", [*RAW.values(), *SOLVERS.values()], ids=[*RAW, *(f"{name} checked" for name in RAW)])
@pytest.mark.parametrize("name", ["A", "B", "Q", "R", "N"])
def test_complex_matrices_are_refused_not_cut(solver, name):
    rng = np.random.default_rng(0)
    matrices = {"A": 0.5 * np.eye(2), "B": np.eye(2), "Q": np.eye(2), "R": np.eye(2), "N": np.zeros((2, 2))}
    X = solver(**matrices)
    matrices[name] = matrices[name] + 0.1j * rng.normal(size=(2, 2))
    with pytest.raises(InputError, match=f"^{name}: is complex: must be a matrix of real numbers$"):
        solver(**matrices)
    with pytest.raises(InputError, match=f"^{name}: is complex"):
        assess(X=X, **matrices)
    with pytest.raises(InputError, match=f"^{name}: is complex"):
        require_well_posed(**matrices)


def test_words_are_refused_as_matrices():
    with pytest.raises(InputError, match=r"^Q: holds <U1: must be a matrix of real numbers$"):
        solve(np.eye(1), np.eye(1), np.array([["1"]]), np.eye(1))


def test_hidden_mode_on_the_circle_is_an_eigenvalue_of_the_pencil():
    A, B, Q, R = ILL_POSED["hidden on the circle"]
    left = np.block([[A, np.zeros((2, 2)), B], [-Q, np.eye(2), np.zeros((2, 1))], [np.zeros((1, 4)), R]])
    right = np.block(
        [
            [np.eye(2), np.zeros((2, 3))],
            [np.zeros((2, 2)), A.T, np.zeros((2, 1))],
            [np.zeros((1, 2)), -B.T, np.zeros((1, 1))],
        ]
    )
    z = eigvals(left, right)
    assert min(abs(abs(z[np.isfinite(z)]) - 1)) < 1e-7


def test_drake_ends_the_process_and_scipy_is_silent():
    A, B, Q, R = ILL_POSED["hidden on the circle"]
    with pytest.raises(SystemExit, match="IsDetectable"):
        RAW["drake"](A, B, Q, R)
    X = RAW["scipy"](A, B, Q, R)
    assert abs(np.linalg.eigvals(A - B @ gain(A, B, R, X))).max() == pytest.approx(1, abs=1e-9)

    told = {case: solver_outcomes(*matrices) for case, matrices in ILL_POSED.items()}
    json.dumps(as_data(told), allow_nan=False)
    assert all(row.error for row in told.values())
    assert all(row.drake.outcome == "ends the process" for row in told.values())
    assert told["hidden on the circle"].scipy.outcome == "returns a solution: not stabilising"
    assert told["hidden outside"].recursion.spectral_radius == pytest.approx(2)
    assert told["hidden outside"].scipy.spectral_radius == pytest.approx(0.5)
    assert told["Q indefinite"].scipy.outcome == "returns a solution: stabilising, indefinite"
    assert told["Q not symmetric"].doubling.outcome == "returns what is no solution"
    well_posed = solver_outcomes(np.eye(1), np.eye(1), np.eye(1), np.eye(1))
    assert well_posed.error is None
    assert all(getattr(well_posed, solver).X[0][0] == pytest.approx((1 + np.sqrt(5)) / 2) for solver in RAW)


@settings(max_examples=30, deadline=None)
@given(seeds)
def test_unreached_modes_are_those_of_a_hidden_block(seed):
    rng = np.random.default_rng(seed)
    n, hidden = 5, int(rng.integers(0, 4))
    A, B = rng.standard_normal((n, n)), rng.standard_normal((n, 2))
    A[n - hidden :, : n - hidden], B[n - hidden :] = 0, 0
    T = np.linalg.qr(rng.standard_normal((n, n)))[0]
    modes = unreached_modes(T @ A @ T.T, T @ B, radius=0.0)
    found = np.sort_complex([mode.eigenvalue for mode in modes for _ in range(mode.multiplicity)])
    expected = np.sort_complex(np.round(np.linalg.eigvals(A[n - hidden :, n - hidden :]), 10)) if hidden else []
    assert len(found) == hidden
    assert np.allclose(found, expected, atol=5e-3)


def test_vehicle_without_position_or_imu():
    loop = hover_loop(Scenario())
    (mode,) = unseen_modes(loop.Phi, loop.C[6:], STATE_NAMES)
    assert str(mode) == "eigenvalue 1 (6 times) in x, y, z, x_dot, y_dot, z_dot"
    (mode,) = unseen_modes(loop.Phi, loop.C[:6], STATE_NAMES)
    assert str(mode) == "eigenvalue 1 (2 times) in psi, psi_dot"
    assert unseen_modes(loop.Phi, loop.C, STATE_NAMES) == []


def test_stability_radius_closed_forms():
    rng = np.random.default_rng(0)
    U = np.linalg.qr(rng.standard_normal((5, 5)))[0]
    assert stability_radius(U @ np.diag([0.9, -0.95, 0.3, 0, 0.5]) @ U.T) == pytest.approx(0.05, rel=1e-9)  # normal
    for a, c in ((0.5, 10.0), (0.9, 1.0), (-0.99, 100.0)):  # Jordan block: sigma_1 sigma_2 = d^2, sigma_1 - sigma_2 = c
        d = 1 - abs(a)
        expected = 2 * d**2 / (np.sqrt(c**2 + 4 * d**2) + c)
        assert stability_radius(np.array([[a, c], [0, a]])) == pytest.approx(expected, rel=1e-8)
    for n in (1, 3, 20):  # shift matrix: sigma_min(z I - J_n) = 2 sin(pi / (4 n + 2)) for every |z| = 1
        assert stability_radius(np.eye(n, k=1)) == pytest.approx(2 * np.sin(np.pi / (4 * n + 2)), rel=1e-9)
    with pytest.raises(InputError, match="eigenvalue 1"):
        stability_radius(np.eye(2))


@settings(max_examples=12, deadline=None)
@given(seeds)
def test_stability_radius_is_the_least_over_a_dense_grid_and_reached(seed):
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((4, 4))
    A *= rng.uniform(0.5, 0.99) / abs(np.linalg.eigvals(A)).max()
    radius = stability_radius(A)
    omega = np.linspace(-np.pi, np.pi, 6001)
    values = least_singular_value(A, omega)
    assert radius <= values.min() * (1 + 1e-12)
    assert radius >= values.min() - (omega[1] - omega[0])  # sigma_min changes by at most |d omega|
    assert radius == pytest.approx(values.min(), rel=1e-2, abs=1e-5)
    z = np.exp(1j * omega[values.argmin()])
    U, s, Vh = np.linalg.svd(z * np.eye(4) - A)
    A_off = A.astype(complex) + s[-1] * np.outer(U[:, -1], Vh[-1])
    assert min(abs(np.linalg.eigvals(A_off) - z)) < 1e-6  # a perturbation of that norm is enough


def test_servo_and_filter_by_all_four():
    scenario = Scenario()
    tables = servo_and_filter_dares(scenario, ALL, V)
    loop = hover_loop(scenario)
    for table in tables.values():
        for solver, row in table.items():
            assert row.spectral_radius < 1
            assert row.asymmetry < 1e-12
            if row.note is None:
                assert row.residual < 1e-12
                assert all(d < 1e-10 for other, d in row.difference.items() if not table[other].note)
            else:
                assert solver == "drake"
    assert "1e-10 I added" in tables["filter"]["drake"].note  # W has rank 6
    assert 1e-9 < tables["filter"]["drake"].difference["doubling"] < 1e-4
    assert np.linalg.matrix_rank(loop.W) == 6
    # the gains that fly
    A, B, Q, R = filter_dare(scenario, ALL, V)
    K, P = steady_predictor(loop.Phi, loop.C, loop.W, V)
    X = solve(A, B, Q, R)
    assert np.allclose(X, P, rtol=1e-9, atol=1e-14)
    assert np.allclose(gain(A, B, R, X).T, K, rtol=1e-8, atol=1e-10)
    L = servo_gain(scenario.vehicle, scenario.servo.weights, scenario.h)
    A, B, Q, R = servo_dare(scenario)
    assert np.allclose(gain(A, B, R, solve(A, B, Q, R)), L, rtol=1e-9, atol=1e-12)


@pytest.mark.long
def test_report_is_json_and_names_what_no_sensor_sees():
    report = riccati_report(Scenario(), V)
    json.dumps(as_data(report), allow_nan=False)
    assert set(report.filter) == {"uwb+camera+imu", "camera+imu", "uwb+imu", "uwb+camera", "uwb", "camera", "imu"}
    assert "no sensor sees eigenvalue 1 (6 times) in x, y, z, x_dot" in report.filter["imu"].error
    assert "psi, psi_dot" in report.filter["uwb+camera"].error
    radii = [report.filter[s]["doubling"].residual for s in ("uwb+camera+imu", "camera+imu", "uwb+imu")]
    assert max(radii) < 1e-12


@pytest.mark.long
def test_what_drake_refuses_twice_is_a_note_and_ends_nothing():
    """Drake takes no singular R, whatever is added to Q."""
    found = four_solutions((0.5 * np.eye(2), np.eye(2), np.eye(2), np.ones((2, 2))), ("a", "b"), dual=False)
    assert max(abs(found[s].residual) for s in ("scipy", "doubling", "recursion")) < 1e-11
    assert isinstance(found["drake"], Unsolved)
    assert "also with 1e-10 I added" in found["drake"].note


def test_a_filter_with_errors_that_last_for_minutes():
    """33 states of time constants from a tick to minutes, biases that nothing drives among them."""
    scenario = load_scenario("imu_uwb_yolo", ("estimator.rates=none",))
    rows = [len(scenario.measurement.C_of(s)) for s in scenario.measurement.sensors]
    dare = filter_dare(scenario, ("uwb", "camera", "imu"), np.diag(np.repeat([1e-3, 1e-3, 1e-4], rows)))
    solutions = [solve(*dare, solver=name, dual=True) for name in ("scipy", "doubling")]
    np.testing.assert_allclose(solutions[0], solutions[1], rtol=1e-9, atol=1e-11 * abs(solutions[0]).max())


@pytest.mark.family
@pytest.mark.parametrize(
    ("sensors", "V", "words"),
    [
        ((), V, "sensors: none"),
        (("sonar",), V, "sonar"),
        (ALL, np.eye(3), r"V: shape \(3, 3\): must be \(9, 9\)"),
        (ALL, 0 * V, "V: must be finite and positive definite"),
    ],
)
def test_bad_filters(sensors, V, words):
    with pytest.raises(InputError, match=words):
        servo_and_filter_dares(Scenario(), sensors, V)


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
