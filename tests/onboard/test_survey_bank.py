"""What is learned of the anchors' survey, against dense Gaussians and drawn surveys."""

import numpy as np
import pytest
from drawn_ranges import ANCHORS, BANK, FRACTION, NOISE, SD, N, flown, residuals_of
from scipy.stats import multivariate_normal

from ortilo_drake.diagrams.wiring.intermittent import filtering_of
from ortilo_drake.model.measurement import UWB
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.lasting_element import (
    LearnedCoefficients,
    Sort,
    learned_coefficients_of,
    told_layout,
    vary,
)
from ortilo_drake.onboard.ranging.bank_element import N_NOISE, bank_box
from ortilo_drake.onboard.ranging.lasting_error import KEPT, KEY, keep, put_lasting
from ortilo_drake.onboard.ranging.survey_bank import gather, learned_first, log_likelihood, weigh
from ortilo_drake.scenario import Multilateration, load_scenario

SETTINGS = Multilateration(bias_sd=SD, bias_bank=BANK)


def units(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    away = p - ANCHORS
    d = np.linalg.norm(away, axis=1)
    return away / d[:, None], d


def gathered_of(p: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    gathered = np.zeros((N, N + 1))
    gather(gathered, p, np.concatenate(([1.0, 0.0], ranges, np.ones(N))), ANCHORS, NOISE, np.zeros((N, 3)))
    return gathered


@pytest.mark.parametrize("s", [0.0, 0.02, 0.05, 0.2])
def test_the_likelihood_is_that_of_a_dense_gaussian_of_all_residuals(s: float) -> None:
    gathered, _, y, V, seen = residuals_of(4, 0.04)
    dense = [multivariate_normal(cov=V + sd**2 * seen @ seen.T).logpdf(y) for sd in (s, 0.0)]
    found = log_likelihood(gathered, s, np.zeros((N, N)), np.zeros(N))
    assert found == pytest.approx(dense[0] - dense[1], abs=1e-6, rel=1e-8)


def test_an_error_of_the_position_itself_says_nothing() -> None:
    p = np.array([8.0, 1.0, 1.5])
    J, d = units(p)
    moved = J @ np.array([0.3, -0.2, 0.1])  # ranges longer as if p were elsewhere, to first order
    with_, without = (gathered_of(p, ranges) for ranges in (d + moved, d))
    M = np.diag((FRACTION * (d + moved)) ** -2.0)
    assert np.abs(with_[:, N]).max() < 1e-9 * np.abs(M @ moved).max()
    np.testing.assert_allclose(without[:, N], 0.0, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize(("sd", "right", "wrong"), [(0.0, 0, 2), (0.05, 2, 0)])
def test_within_six_seconds_it_tells_five_centimetres_from_none(sd: float, right: int, wrong: int) -> None:
    for seed in range(20):
        weights = flown(1.0, sd, seed, its=SETTINGS)[1][:-N_NOISE][-len(BANK) :]
        assert weights.sum() == pytest.approx(1.0)
        assert weights[wrong] < 0.02 < weights[right], (seed, weights)


def test_before_the_first_fix_all_models_are_equally_likely() -> None:
    learned = bank_box(SETTINGS, ANCHORS, 0.1).given.start["learned"][:-N_NOISE]
    assert learned[0] == pytest.approx(np.sqrt(np.mean(np.square(BANK))))
    np.testing.assert_array_equal(learned[-3:], 1.0 / 3.0)


def fix_errors(p: np.ndarray, errors: np.ndarray, heard: slice) -> np.ndarray:
    """Return the errors of weighted fits at p (m, 3), to first order, by errors of the anchors heard (m, n, 3)."""
    (J, d), errors = (part[heard] for part in units(p)), errors[:, heard]
    W = np.diag(1.0 / ((FRACTION * d) ** 2 + SD**2))
    along = -np.einsum("ij,mij->mi", J, errors)
    return np.linalg.solve(J.T @ W @ J, J.T @ W @ along.T).T


@pytest.mark.parametrize("heard", [slice(None), slice(1, None)], ids=["all", "all_but_the_first"])
def test_what_lasts_is_what_drawn_surveys_make_of_a_fix(heard: slice) -> None:
    its = np.zeros(N)
    its[heard] = 1.0
    errors = np.random.default_rng(3).normal(0.0, SD, (40_000, N, 3))
    here, there = np.array([4.0, 1.0, 1.5]), np.array([4.8, 1.2, 1.6])
    learned = learned_first(np.array(BANK), 6 * N)
    said = np.zeros(6 + 6 * N)
    put_lasting(said[:6], here, its, ANCHORS, NOISE, learned, said[6:])
    drawn = fix_errors(here, errors, heard), fix_errors(there, errors, heard)
    np.testing.assert_allclose(said[:3], drawn[0].std(axis=0), rtol=0.02)
    np.testing.assert_array_equal(said[3:6], 1.0)  # nothing was said before
    keep(learned, said[:6], said[6:])
    put_lasting(said[:6], there, its, ANCHORS, NOISE, learned, said[6:])
    together = [np.corrcoef(drawn[0][:, axis], drawn[1][:, axis])[0, 1] for axis in range(3)]
    np.testing.assert_allclose(said[:3], drawn[1].std(axis=0), rtol=0.02)
    np.testing.assert_allclose(said[3:6], together, atol=0.02)
    keep(learned, said[:6], said[6:])
    is_far = min(together) < 0.7
    assert (learned[KEPT : KEPT + 3] == 1.0).all() == is_far
    assert (learned[KEY : KEY + 6 * N] == said[6:]).all() == is_far


def test_coefficients_and_variances_follow_what_a_fix_tells() -> None:
    its = filtering_of(load_scenario("imu_uwb").belief)
    told = learned_coefficients_of(its.seen, Sort(UWB, (0.03, 0.05, 0.09)))
    lasting = np.array([0.06, 0.05, 0.0, 1.0, 0.5, 0.8])
    weights = np.zeros(its.seen.layout.weights.shape)
    layout = told_layout(its.seen.layout, told, lasting, weights)
    seen = [layout.weights[row, column] for row, column in zip(told.row, told.column, strict=True)]
    np.testing.assert_allclose(seen, [2.0, 1.0, 0.0])
    assert [
        layout.states[row, column] for row, column in zip(told.row, told.column, strict=True)
    ] == told.state.tolist()

    n = its.n
    root = np.random.default_rng(2).normal(size=(n, n))
    x, P = np.arange(1.0, n + 1.0), root @ root.T
    belief = np.concatenate((x, P.ravel()))
    vary(belief, n, told, lasting)
    A, Q = np.eye(n), np.zeros((n, n))
    for state, r, sd in zip(told.state, lasting[3:], told.sd, strict=True):
        A[state, state], Q[state, state] = r, (1.0 - r**2) * sd**2
    np.testing.assert_allclose(belief[:n], A @ x)
    np.testing.assert_allclose(belief[n:].reshape(n, n), A @ P @ A.T + Q, atol=1e-12)


def test_a_filter_without_such_states_is_told_nothing() -> None:
    its = filtering_of(load_scenario("imu_uwb", ("estimator.biases.uwb_sd=[0, 0, 0]",)).belief)
    told: LearnedCoefficients = learned_coefficients_of(its.seen, Sort(UWB, (0.0, 0.0, 0.0)))
    assert all(len(part) == 0 for part in told)


def test_a_bank_has_something_to_share() -> None:
    with pytest.raises(InputError, match=r"bias_bank: must be null without bias_sd"):
        load_scenario("nominal_imu_uwb", ("multilateration.bias_bank=[0, 1]",))


def test_anchors_that_are_never_heard_leave_the_weights_of_those_that_are() -> None:
    """The first of four is silent: the weights are those of the dense Gaussians of the other three's errors."""
    A = np.random.default_rng(4).normal(size=(3, 3))
    Lambda, eta, bank = np.zeros((4, 4)), np.zeros(4), np.array([0.0, 0.5, 1.0])
    Lambda[1:, 1:], eta[1:] = 30.0 * A @ A.T, [3.0, -5.0, 2.0]
    weights, S, e = np.zeros(3), np.zeros((4, 4)), np.zeros(4)
    weigh(weights, np.column_stack([Lambda, eta]), bank, 0.3, S, e)
    prior = [np.eye(4) + (0.3 * c) ** 2 * Lambda for c in bank]
    logs = [
        0.5 * (0.3 * c) ** 2 * eta @ np.linalg.solve(M, eta) - 0.5 * np.linalg.slogdet(M)[1]
        for c, M in zip(bank, prior, strict=True)
    ]
    np.testing.assert_allclose(weights, np.exp(logs) / np.sum(np.exp(logs)), rtol=1e-12)
