"""Bounds on the mean covariance: published values, SciPy's Riccati solver, closed forms, Monte Carlo in between."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag, solve_discrete_are
from scipy.stats import ortho_group

from ortilo_drake.model.hover import disturbance_W
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.theory.arrivals.arrival_simulation import draw_independent, simulate
from ortilo_drake.theory.arrivals.arrivals import Model, check_model, pattern_probabilities
from ortilo_drake.theory.arrivals.critical_rate import critical_rate, critical_recovery
from ortilo_drake.theory.arrivals.expected_riccati import (
    TRANSLATION,
    lower_bound,
    translation_noise,
    upper_bound,
    vehicle_model,
)
from ortilo_drake.theory.arrivals.expected_riccati_kernel import (
    SETTLED,
    averaged_update,
    coupled_fixed_point,
    predicted,
)

H = 1.0 / 30.0
V_PRINTED = np.diag(np.repeat([0.05, 0.08, 0.01], 3))
SMALL_W = vehicle_model(1e-4 * np.eye(12), V_PRINTED, H)
TUNED = vehicle_model(disturbance_W(M100, H, 0.27, 0.005), np.diag(np.repeat([9e-4, 1e-2, 1e-4], 3)), H)
ALL_OR_NOTHING = np.array([[False], [True]])
SCALAR = check_model(
    Model(np.array([[1.25]]), np.ones((1, 1)), np.ones((1, 1)), np.array([[2.5]]), ALL_OR_NOTHING)
)  # Sinopoli et al. (2004), first example


def expected_step(X: np.ndarray, model: Model, probabilities: np.ndarray) -> np.ndarray:
    return predicted(averaged_update(X, model.C, model.V, model.rows, probabilities), model.A, model.W)


def translation_lower_bound(A: np.ndarray, W: np.ndarray, uwb: float, camera: float) -> np.ndarray:
    at_most = 1.0 - (1.0 - uwb) * (1.0 - camera)
    return lower_bound(A[np.ix_(TRANSLATION, TRANSLATION)], translation_noise(W), at_most)


def printed_g(X: np.ndarray, model: Model, probabilities: np.ndarray) -> np.ndarray:
    """g as THEORY.md prints it, with NumPy's general solver."""
    A, C, W, V, rows = model
    total = A @ X @ A.T + W
    for p, probability in zip(rows, probabilities, strict=True):
        C_p, V_p = C[p], V[np.ix_(p, p)]
        total -= probability * A @ X @ C_p.T @ np.linalg.solve(C_p @ X @ C_p.T + V_p, C_p @ X @ A.T)
    return total


@pytest.mark.parametrize(
    ("W_scale", "rates", "P_xx", "P_zz"),
    [
        (1e-4, (1.0, 0.0), 0.005744, 0.003656),
        (1e-4, (0.5, 0.5), 0.006898, 0.004272),
        (1e-4, (0.1, 0.0), 0.046706, 0.021684),
        (1.0, (1.0, 0.0), 1.085270, 1.084872),
    ],
)
def test_theory_values_to_six_digits(W_scale: float, rates: tuple[float, float], P_xx: float, P_zz: float) -> None:
    model = vehicle_model(W_scale * np.eye(12), V_PRINTED, H)
    X = upper_bound(model, pattern_probabilities(*rates))
    assert round(X[0, 0], 6) == P_xx
    assert round(X[2, 2], 6) == P_zz


@given(seed=st.integers(0, 2**32 - 1))
def test_one_step_is_the_printed_formula(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, m, patterns = rng.integers(1, 7), rng.integers(1, 6), rng.integers(1, 5)
    spd = [M @ M.T + 0.1 * np.eye(len(M)) for M in (rng.normal(size=(k, k)) for k in (n, n, m))]
    model = check_model(
        Model(rng.normal(size=(n, n)), rng.normal(size=(m, n)), spd[0], spd[2], rng.random((patterns, m)) < 0.5)
    )
    probabilities = rng.dirichlet(np.ones(patterns))
    X = expected_step(spd[1], model, probabilities)
    np.testing.assert_array_equal(X, X.T)
    np.testing.assert_allclose(X, printed_g(spd[1], model, probabilities), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("model", [SMALL_W, TUNED])
@pytest.mark.parametrize(
    ("rates", "rows"), [((1, 1), slice(0, 9)), ((1, 0), [0, 1, 2, 6, 7, 8]), ((0, 1), slice(3, 9))]
)
def test_without_chance_it_is_the_filters_riccati_equation(model: Model, rates: tuple, rows: slice | list) -> None:
    C, V = model.C[rows], model.V[rows][:, rows]
    P = solve_discrete_are(model.A.T, C.T, model.W, V)
    X = upper_bound(model, pattern_probabilities(*rates))
    np.testing.assert_allclose(np.diag(X), np.diag(P), rtol=1e-7)  # SciPy's own residual is about 1e-9 here


@pytest.mark.parametrize("model", [SMALL_W, TUNED])
@pytest.mark.parametrize("rates", [(0.5, 0.5), (0.05, 0.0), (0.01, 0.0)])
def test_settled_to_the_stated_tolerance(model: Model, rates: tuple[float, float]) -> None:
    probabilities = pattern_probabilities(*rates)
    X = upper_bound(model, probabilities)
    far = (X[None] * 3.0, *model, probabilities[None], np.ones((1, 1)), 1e-12, 100_000)  # from above, further on
    from_above, _, state, _ = coupled_fixed_point(*far)
    assert state == SETTLED
    scale = np.sqrt(np.outer(np.diag(X), np.diag(X)))
    assert np.max(np.abs(X - from_above[0]) / scale) < 2e-9


@pytest.mark.long
def test_scalar_example_of_the_literature() -> None:
    """a = 1.25, c = 1, q = 1, r = 2.5, rate 0.7; upper: the positive root of the scalar equation."""
    a2, r, rate = 1.25**2, 2.5, 0.7
    upper = np.roots([1.0 - (1.0 - rate) * a2, r - a2 * r - 1.0, -r]).max()
    X = upper_bound(SCALAR, np.array([0.3, 0.7]))[0, 0]
    assert pytest.approx(upper, rel=1e-9) == X
    assert round(X, 4) == 5.4008
    assert round(lower_bound(SCALAR.A, SCALAR.W, 0.7)[0, 0], 4) == 1.8824
    mean, error = simulate(SCALAR, np.eye(1), draw_independent(np.array([0.3, 0.7]), 10_000, 200, seed=1))
    assert mean[0, 0] == pytest.approx(5.14, abs=3 * error[0] + 0.005)
    assert error[0] < 0.06


TWO_STATES = [[[1.25, 0.0], [1.0, 1.1]], [[1.25, 1.0], [0.0, 1.1]]]


def two_states(A: list) -> Model:
    """A plant of the literature: C = [1 1], R = 2.5, Q = 20 I."""
    return check_model(Model(np.array(A), np.ones((1, 2)), 20.0 * np.eye(2), np.array([[2.5]]), ALL_OR_NOTHING))


@pytest.mark.long
@pytest.mark.parametrize("A", TWO_STATES)
@pytest.mark.parametrize("rate", [0.3, 0.5, 0.8])
def test_the_exact_mean_of_two_states_lies_between_the_recursions(A: list, rate: float) -> None:
    """E[P_14] by all 2^14 arrival sequences, no chance left, also below the critical rate."""
    model = two_states(A)
    A_, C, W, V, _ = model
    P, weight = W[None], np.ones(1)
    upper = lower = W
    for _ in range(14):
        lost = A_ @ P @ A_.T + W
        K = A_ @ P @ C.T / (C @ P @ C.T + V)
        arrived = lost - K @ C @ P @ A_.T
        P, weight = np.concatenate([lost, arrived]), np.concatenate([(1 - rate) * weight, rate * weight])
        upper = expected_step(upper, model, np.array([1 - rate, rate]))
        lower = (1 - rate) * A_ @ lower @ A_.T + W
    mean = np.einsum("s,sij->ij", weight, P)
    assert np.linalg.eigvalsh(upper - mean).min() > 0.0
    assert np.linalg.eigvalsh(mean - lower).min() > 0.0
    assert np.all(np.diag(lower) < np.diag(mean) - 1e-3)


@pytest.mark.long
@pytest.mark.parametrize("A", TWO_STATES)
def test_two_states_of_the_literature(A: list) -> None:
    """Above 1 - 1 / (1.25 1.1)^2 = 0.4711 there is a fixed point; 10^4 drawn sequences lie between the bounds."""
    model = two_states(A)
    probabilities = np.array([0.2, 0.8])
    upper, lower = upper_bound(model, probabilities), lower_bound(model.A, model.W, 0.8)
    mean, error = simulate(model, model.W, draw_independent(probabilities, 10_000, 100, seed=2))
    assert np.all(np.diag(lower) < np.diag(mean) - 3 * error)
    assert np.all(np.diag(mean) < np.diag(upper))
    upper_bound(model, np.array([0.52, 0.48]))
    with pytest.raises(InputError, match=r"eigenvalue 1\.25 in .*eigenvalue 1\.1 in .*too seldom"):
        upper_bound(model, np.array([0.54, 0.46]))


@pytest.mark.long
@pytest.mark.parametrize(("rates", "runs"), [((0.5, 0.3), 10_000), ((0.2, 0.0), 3_000)])
def test_monte_carlo_lies_between_the_bounds(rates: tuple[float, float], runs: int) -> None:
    probabilities = pattern_probabilities(*rates)
    certain = upper_bound(SMALL_W, pattern_probabilities(1.0, float(rates[1] > 0)))
    upper = np.diag(upper_bound(SMALL_W, probabilities))
    mean, error = simulate(SMALL_W, certain, draw_independent(probabilities, runs, 100, seed=3))
    lower = np.diag(certain).copy()
    lower[TRANSLATION] = np.maximum(lower[TRANSLATION], np.diag(translation_lower_bound(*SMALL_W[0::2][:2], *rates)))
    seldom = [0, 1, 2, 3, 4, 6, 7, 8, 9, 10]  # all but yaw, which the imu alone sees, always
    assert np.all(lower[seldom] < (np.diag(mean) - 3 * error)[seldom])
    assert np.all((np.diag(mean) + 3 * error)[seldom] < upper[seldom])
    np.testing.assert_allclose(np.diag(mean)[[5, 11]], upper[[5, 11]], rtol=1e-8)
    np.testing.assert_allclose(np.diag(mean)[[5, 11]], lower[[5, 11]], rtol=1e-8)


@pytest.mark.long
@given(rate=st.floats(0.0, 1.0), other=st.floats(0.05, 1.0))
def test_more_arrivals_never_raise_the_bounds(rate: float, other: float) -> None:
    few, many = (min(rate, other), other), (max(rate, other), other)
    scale = np.sqrt(np.diag(SMALL_W.W).max())
    for bound in (
        lambda r: upper_bound(SMALL_W, pattern_probabilities(*r)),
        lambda r: translation_lower_bound(SMALL_W.A, SMALL_W.W, *r),
    ):
        assert np.linalg.eigvalsh(bound(few) - bound(many)).min() > -1e-7 * scale


def test_the_noise_of_who_knows_attitude_is_that_of_the_force_alone() -> None:
    """Attitude and rates known give the torque away; what is left of W is the force's part."""
    W_t = translation_noise(TUNED.W)
    force_only = disturbance_W(M100, H, 0.27, 0.0)[np.ix_(TRANSLATION, TRANSLATION)]
    np.testing.assert_allclose(W_t, force_only, rtol=1e-9, atol=1e-20)
    assert TUNED.W[0, 0] > W_t[0, 0]
    with_force_only = translation_lower_bound(TUNED.A, disturbance_W(M100, H, 0.27, 0.0), 0.3, 0.1)
    np.testing.assert_allclose(translation_lower_bound(TUNED.A, TUNED.W, 0.3, 0.1), with_force_only, rtol=1e-9)


def test_lower_bound_of_one_axis_by_summation() -> None:
    """sum_k q^k Phi_t^k W_t Phi_t^kT, the solution of the linear equation as a series."""
    Phi_t, W_t = SMALL_W.A[np.ix_(TRANSLATION, TRANSLATION)], 1e-4 * np.eye(6)
    q = (1 - 0.3) * (1 - 0.2)
    total, term = np.zeros((6, 6)), W_t
    for _ in range(200):
        total, term = total + term, q * Phi_t @ term @ Phi_t.T
    np.testing.assert_allclose(translation_lower_bound(SMALL_W.A, SMALL_W.W, 0.3, 0.2), total, rtol=1e-12)
    assert np.all(np.isinf(translation_lower_bound(SMALL_W.A, SMALL_W.W, 0.0, 0.0)))
    assert np.isinf(lower_bound(np.array([[1.25]]), np.eye(1), 0.36)[0, 0])


@pytest.mark.parametrize("rates", [(-0.1, 0.5), (0.5, 1.1), (float("nan"), 0.5)])
def test_a_rate_that_is_none_is_refused(rates: tuple[float, float]) -> None:
    with pytest.raises(InputError, match=r"arrival rate of .*must lie in \[0, 1\]"):
        pattern_probabilities(*rates)


def test_no_position_sensor_names_the_modes() -> None:
    with pytest.raises(InputError, match=r"eigenvalue 1 \(6 times\) in x, y, z, x_dot, y_dot, z_dot"):
        upper_bound(SMALL_W, pattern_probabilities(0.0, 0.0))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"W": -np.eye(12)}, "W: smallest eigenvalue -1: must be positive semidefinite"),
        ({"V": np.zeros((9, 9))}, "V: smallest eigenvalue 0: must be positive definite"),
        ({"W": np.eye(3)}, r"W: shape \(3, 3\): must be \(12, 12\)"),
        ({"W": np.full((12, 12), np.nan)}, "W: must have finite entries"),
        ({"V": V_PRINTED + np.eye(9, k=1)}, "V: must be symmetric"),
    ],
)
def test_bad_matrices_are_refused(change: dict, message: str) -> None:
    arguments = {"W": np.eye(12), "V": V_PRINTED} | change
    with pytest.raises(InputError, match=message):
        vehicle_model(arguments["W"], arguments["V"], H)


@pytest.mark.parametrize("probabilities", [[0.5, 0.6], [1.2, -0.2], [1.0]])
def test_probabilities_that_are_none_are_refused(probabilities: list) -> None:
    with pytest.raises(InputError, match="probabilities"):
        upper_bound(SCALAR, np.array(probabilities))


VEHICLE = vehicle_model(np.eye(12), np.eye(9), 1.0 / 30.0)


def test_scalar() -> None:
    found = critical_rate(np.array([[1.25]]), np.array([[1.0]]))
    assert (found.rate, found.lower, found.upper) == pytest.approx((0.36, 0.36, 0.36), abs=1e-12)


def test_complex_matrices_are_refused_not_cut() -> None:
    with pytest.raises(InputError, match=r"^A: is complex: must be a matrix of real numbers$"):
        critical_rate(np.array([[1.25 + 1.0j]]), np.array([[1.0]]))
    with pytest.raises(InputError, match=r"^V: is complex"):
        check_model(VEHICLE._replace(V=VEHICLE.V * (1.0 + 0.1j)))


@pytest.mark.parametrize("A", [[[1.25, 0.0], [1.0, 1.1]], [[1.25, 1.0], [0.0, 1.1]]])
def test_two_states_one_output(A: list) -> None:
    """One output: g's fixed point exists above 1 - 1 / prod |s_u|^2 (Schenato et al., 2007); E[P] above 0.36."""
    found = critical_rate(np.array(A), np.array([[1.0, 1.0]]))
    assert found.lower == pytest.approx(0.36, abs=1e-12)
    assert found.upper == pytest.approx(1.0 - 1.0 / (1.25 * 1.1) ** 2, abs=2e-6)
    assert found.rate == found.lower


def test_one_unstable_eigenvalue_among_three() -> None:
    """Sinopoli et al. (2004): A = [1.25 1 0; 0 0.9 7; 0 0 0.6], C = [1 0 2]: both bounds are 0.36."""
    A = np.array([[1.25, 1.0, 0.0], [0.0, 0.9, 7.0], [0.0, 0.0, 0.6]])
    found = critical_rate(A, np.array([[1.0, 0.0, 2.0]]))
    assert (found.rate, found.lower, found.upper) == pytest.approx((0.36, 0.36, 0.36), abs=1e-12)


def test_invertible_output() -> None:
    found = critical_rate(np.array([[1.25, 0.0], [1.0, 1.1]]), np.array([[1.0, 1.0], [0.0, 1.0]]))
    assert found.rate == found.upper == pytest.approx(0.36, abs=1e-12)
    assert found.hypotheses["C has full column rank on the unstable subspace"]


@pytest.mark.long
def test_two_outputs_that_share_three_modes() -> None:
    """Decoupled: 1.3 and 1.2 by one output, 1.1 by another; the fixed point needs the worse of the two."""
    C = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    found = critical_rate(np.diag([1.3, 1.2, 1.1]), C)
    assert found.upper == pytest.approx(1.0 - 1.0 / (1.3 * 1.2) ** 2, abs=2e-6)
    # A third output that repeats the first changes nothing.
    assert critical_rate(np.diag([1.3, 1.2, 1.1]), np.vstack([C, C[0]])).upper == pytest.approx(found.upper, abs=2e-6)


@pytest.mark.long
@settings(max_examples=8)
@given(seed=st.integers(0, 2**32 - 1), n=st.integers(2, 4))
def test_one_output_and_any_state_basis(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    moduli = 1.05 + 0.1 * np.arange(n) + 0.05 * rng.random(n)
    S = np.linalg.qr(rng.normal(size=(n, n)))[0] + 0.1 * np.eye(n)
    A = S @ np.diag(moduli * rng.choice([-1.0, 1.0], n)) @ np.linalg.inv(S)
    c = rng.choice([-1.0, 1.0], (1, n)) @ np.linalg.inv(S)
    found = critical_rate(A, c)
    assert found.upper == pytest.approx(1.0 - 1.0 / np.prod(moduli) ** 2, abs=2e-5)
    assert found.rate == pytest.approx(1.0 - 1.0 / moduli.max() ** 2, abs=1e-6)


def test_two_modes_that_differ_in_sign() -> None:
    """A = diag(a, -a), C = [1 1]: l_c = 1 - a^-4, which is also where g's fixed point begins to exist."""
    found = critical_rate(np.diag([1.2, -1.2]), np.array([[1.0, 1.0]]))
    assert found.rate == pytest.approx(1.0 - 1.2**-4, abs=1e-12)
    assert found.lower == pytest.approx(1.0 - 1.2**-2, abs=1e-12)
    assert found.upper == pytest.approx(found.rate, abs=2e-6)
    assert "1 - 1/1.2^4 = 0.517747: C shows the same combination of the two unstable modes again every 2 ticks" in (
        found.sentence
    )


@pytest.mark.parametrize(
    ("A", "power"),
    [([[0.0, 1.2], [-1.2, 0.0]], 4.0), ([[0.0, -1.44], [1.0, -1.2]], 3.0), ([[1.2, 1.0], [0.0, 1.2]], 2.0)],
    ids=["a quarter turn", "a third of a turn", "a Jordan block"],
)
def test_degenerate_second_order_systems_beside_a_mode_that_decays(A: list, power: float) -> None:
    """A third of a turn a tick: s^2 + 1.2 s + 1.44, the conjugate pair two thirds of a turn apart, so d = 3."""
    turned = ortho_group.rvs(3, random_state=5)
    found = critical_rate(turned @ block_diag(A, 0.7) @ turned.T, np.array([[1.0, 0.0, 1.0]]) @ turned.T)
    assert found.rate == pytest.approx(1.0 - 1.2**-power, abs=1e-7)
    assert found.lower - 1e-7 <= found.rate <= found.upper + 1e-7


def test_three_modes_of_one_modulus_keep_their_bounds_only() -> None:
    """No theorem named here closes the gap where more than two unstable modes are confused."""
    A = block_diag([[0.0, 1.2], [-1.2, 0.0]], 1.2)
    found = critical_rate(A, np.array([[1.0, 0.0, 1.0]]))
    assert found.rate is None
    assert found.lower == pytest.approx(1.0 - 1.2**-2, abs=1e-9)
    assert found.upper == pytest.approx(1.0 - 1.2**-6, abs=2e-6)
    assert "between" in found.sentence


def test_the_vehicles_is_zero_since_every_eigenvalue_is_one() -> None:
    found = critical_rate(VEHICLE.A, VEHICLE.C)
    assert (found.rate, found.lower, found.upper) == (0.0, 0.0, 0.0)
    assert not found.hypotheses["A has eigenvalues outside the unit circle"]
    assert "0" in found.sentence


def test_an_undetectable_pair_names_its_modes() -> None:
    with pytest.raises(InputError, match=r"eigenvalue 1 \(6 times\) in x, y, z, x_dot, y_dot, z_dot"):
        critical_rate(VEHICLE.A, VEHICLE.C[6:])
    with pytest.raises(InputError, match=r"not detectable: C never sees eigenvalue 2 in state 2"):
        critical_rate(np.diag([1.5, 2.0, 0.3]), np.array([[1.0, 0.0, 1.0]]))


def test_critical_recovery_rate() -> None:
    assert critical_recovery(np.array([[1.25]])) == pytest.approx(0.36)
    assert critical_recovery(np.diag([0.5, -2.0])) == pytest.approx(0.75)
    assert critical_recovery(np.array([[0.5]])) == 0.0
