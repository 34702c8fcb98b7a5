"""What is learned of the ranges' noise, against SciPy's distributions and drawn ranges."""

import numpy as np
import pytest
from drawn_ranges import BANK, FRACTION, SD, WORTH, N, flown, residuals_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.stats import invgamma, multivariate_normal, multivariate_t

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.ranging.bank_element import LIMIT, SCALE, counted, weigh_scales
from ortilo_drake.scenario import Multilateration, load_scenario


def judged(gathered: np.ndarray, scale: np.ndarray, bank: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the models' weights and c^2."""
    weights, after = np.zeros(bank.size), scale.copy()
    weigh_scales(gathered, after, bank, SD, WORTH, weights, np.zeros(bank.size), np.zeros((N, N)), np.zeros(N))
    return weights, after[SCALE]


def test_what_is_left_of_residuals_is_a_dense_sum_of_squares() -> None:
    _, scale, values, V, _ = residuals_of(4, 0.04)
    np.testing.assert_allclose(scale[:2], [values @ np.linalg.solve(V, values), len(values)], rtol=1e-8)


def test_a_scale_alone_is_the_inverse_gamma_that_bayes_theorem_makes_of_dense_gaussians() -> None:
    gathered, scale, values, V, _ = residuals_of(2, 0.08)
    found = judged(gathered, scale, np.zeros(1))[1]
    nu = WORTH + scale[1]
    assert found == pytest.approx(1.0 / invgamma(nu / 2.0, scale=nu * found / 2.0).expect(lambda v: 1.0 / v), rel=1e-6)

    prior, best = invgamma(WORTH / 2.0, scale=WORTH / 2.0), multivariate_normal(cov=found * V).logpdf(values)

    def density(v: float) -> float:
        return float(prior.pdf(v) * np.exp(multivariate_normal(cov=v * V).logpdf(values) - best))

    whole, precision = (quad(f, 0.05, 60.0)[0] for f in (density, lambda v: density(v) / v))
    assert found == pytest.approx(whole / precision, rel=1e-6)


@pytest.mark.parametrize("white", [0.02, 0.04, 0.15])
def test_models_are_weighed_as_students_t_of_all_residuals(white: float) -> None:
    gathered, scale, values, V, A = residuals_of(4, white)
    scale[SCALE] = 1.7  # in whose units what lasts is
    shapes = [V + (share * SD) ** 2 / 1.7 * A @ A.T for share in BANK]
    logs = np.array([multivariate_t(shape=shape, df=WORTH).logpdf(values) for shape in shapes])
    squares = [values @ np.linalg.solve(shape, values) for shape in shapes]
    weights, found = judged(gathered, scale, np.array(BANK))
    likely = np.exp(logs - logs.max())
    np.testing.assert_allclose(weights, likely / likely.sum(), rtol=1e-6, atol=1e-12)
    assert found == pytest.approx(weights @ (WORTH + np.array(squares)) / (WORTH + len(values)), rel=1e-8)


@settings(max_examples=15)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.5), st.sampled_from([0.0, SD]))
def test_the_order_of_the_anchors_does_not_matter(seed: int, white: float, s_2: float) -> None:
    gathered, scale, *_ = residuals_of(1, white, seed)
    other = np.random.default_rng(seed).permutation(N)
    whole = np.tril(gathered[:, :N]) + np.tril(gathered[:, :N], -1).T
    moved, bank = np.column_stack((whole[np.ix_(other, other)], gathered[other, N])), np.array(BANK) * s_2 / SD
    for one, its in zip(judged(gathered, scale, bank), judged(moved, scale, bank), strict=True):
        np.testing.assert_allclose(one, its, rtol=1e-6, atol=1e-9)


@settings(max_examples=15)
@given(st.floats(0.0, 0.5), st.floats(1.0, 10.0), st.floats(0.0, 1.0))
def test_larger_residuals_make_a_larger_scale(white: float, factor: float, share: float) -> None:
    gathered, scale, *_ = residuals_of(1, white)
    larger = np.column_stack((gathered[:, :N], factor * gathered[:, N])), scale * [factor**2, 1.0, 1.0]
    model = np.array([share])
    assert judged(*larger, model)[1] >= judged(gathered, scale, model)[1] * (1.0 - 1e-9)


@given(st.floats(0.0, 1e9), st.floats(1e-3, 1e3))
def test_no_fix_counts_beyond_the_limit(squares: float, expected: float) -> None:
    part = counted(squares, expected)
    assert part**2 * squares <= LIMIT * expected * (1.0 + 1e-9)
    assert part == 1.0 or squares > LIMIT * expected


@pytest.mark.parametrize("c", [0.5, 1.4, 4.0])
def test_within_six_seconds_it_tells_the_scale_and_that_nothing_lasts(c: float) -> None:
    found, learned = flown(c, 0.0, 0)
    assert found == pytest.approx(c, rel=0.12)
    np.testing.assert_allclose(learned[-3:], [0.0, found * FRACTION, learned[0] * SD])
    weights = learned[-6:-3]
    assert weights.sum() == pytest.approx(1.0)
    assert weights[2] < 0.02 or c == 4.0, weights  # beside noise of 30 cm, 5 cm are not told in so short a time


@pytest.mark.parametrize("c", [0.5, 2.0])
def test_what_lasts_is_no_noise(c: float) -> None:
    found, learned = flown(c, 0.05, 0)
    assert found == pytest.approx(c, rel=0.15)
    weights = learned[-6:-3]
    assert weights[0] < 0.02 < (0.9 if c < 2.0 else 0.3) < weights[2], weights


def test_without_a_bank_the_scale_is_learned_alone() -> None:
    found, learned = flown(2.0, 0.0, 0, its=Multilateration(noise_scale=WORTH))
    assert found == pytest.approx(2.0, rel=0.12)
    np.testing.assert_array_equal(learned[-1], 0.0)


def test_one_range_that_a_wall_lengthens_is_no_noise() -> None:
    found = flown(1.0, 0.0, 0, far=2.0)[0]
    assert found == pytest.approx(1.0, rel=0.3)
    assert 2.0 / (FRACTION * 10.0) > 20.0  # of which without the limit c would be several


@pytest.mark.parametrize("change", ["method=nearest_three", "exclude={}"])
def test_a_scale_needs_the_residuals_of_all_ranges(change: str) -> None:
    with pytest.raises(InputError, match=r"noise_scale: must be null with (method 'nearest_three'|exclude): "):
        load_scenario("nominal_imu_uwb", ("multilateration.noise_scale=10", f"multilateration.{change}"))
