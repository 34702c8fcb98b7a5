"""Ranges left out against brute force over subsets, chi-square and SciPy's least squares; the clock's offset too."""

from itertools import combinations
from typing import Any

import numpy as np
import pytest
import scipy.optimize
from played_box import PlayedBox
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from scipy.stats import chi2

from ortilo_drake.model.room import load_room
from ortilo_drake.model.signals import FIX_SIZE
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.ranging.fault_exclusion import (
    AFRESH,
    KNOWN,
    PLAIN,
    Consistent,
    consistency_of,
    consistent_fix,
)
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.onboard.ranging.range_equations import least_squares
from ortilo_drake.scenario import Exclusion, Multilateration, load_scenario

ANCHORS = load_room().anchor_positions
N = len(ANCHORS)
ALL, NO_CLOCK = np.ones(N), np.zeros(3)
NOISE = np.array([0.05, 0.0])
P_WB = np.array([7.0, -0.6, 1.4])
TRUE = np.linalg.norm(P_WB - ANCHORS, axis=1)


def noisy(seed: int) -> np.ndarray:
    return TRUE + NOISE[0] * np.random.default_rng(seed).normal(size=N)


def fixed(ranges: np.ndarray, known: np.ndarray = NO_CLOCK, there: np.ndarray = ALL, **settings: Any) -> Consistent:
    return consistent_fix(ranges, there, ANCHORS, NOISE, P_WB + 0.1, known, consistency_of(Exclusion(**settings), N))


def scipy_fit(ranges: np.ndarray, used: list[int], offset: bool = False) -> Any:
    def residuals(z: np.ndarray) -> np.ndarray:
        d = np.linalg.norm(z[:3] - ANCHORS[used], axis=1) + (z[3] if offset else 0.0)
        return np.asarray((ranges[used] - d) / NOISE[0])

    start = np.append(P_WB + 0.1, 0.0) if offset else P_WB + 0.1
    return scipy.optimize.least_squares(residuals, start, xtol=1e-14, ftol=1e-14, gtol=1e-14)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(5))
def test_ranges_that_fit_make_the_fix_of_all_bit_for_bit(seed: int) -> None:
    fix = fixed(noisy(seed))
    found, p, C = least_squares(noisy(seed), ALL, ANCHORS, NOISE, P_WB + 0.1)
    assert fix.found == found
    assert fix.unknowns == PLAIN
    np.testing.assert_array_equal(fix.used, ALL)
    np.testing.assert_array_equal(fix.p, p)
    np.testing.assert_array_equal(fix.C, C)


@pytest.mark.long
@pytest.mark.parametrize("wrong", [(0,), (5,), (3, 8), (1, 6, 10)])
def test_the_ranges_left_out_are_those_of_brute_force(wrong: tuple[int, ...]) -> None:
    """Of all subsets of the largest size that passes chi-square's test, the one of least cost by SciPy."""
    ranges = noisy(3)
    ranges[list(wrong)] += [1.5, 2.5, -2.0][: len(wrong)]
    probability, best = 0.9999, None
    for left_out in range(4):
        costs = {}
        for out in combinations(range(N), left_out):
            fit = scipy_fit(ranges, [i for i in range(N) if i not in out])
            costs[out] = 2.0 * fit.cost, fit.x
        best = min(costs, key=lambda out: costs[out][0])
        if costs[best][0] <= chi2.ppf(probability, N - left_out - 3):
            break
    assert best == wrong
    fix = fixed(ranges, probability=probability, clock=False)
    assert fix.found
    assert tuple(np.flatnonzero(fix.used == 0.0)) == best
    np.testing.assert_allclose(fix.p, costs[best][1], atol=1e-7)


@pytest.mark.long
def test_right_ranges_fail_the_test_as_seldom_as_it_says() -> None:
    kept = [bool(np.all(fixed(noisy(seed), probability=0.9, clock=False).used)) for seed in range(1500)]
    sd = np.sqrt(0.9 * 0.1 / len(kept))
    assert abs(np.mean(kept) - 0.9) < 4.0 * sd


@pytest.mark.long
@pytest.mark.parametrize("by", [0.7, -0.9])
def test_an_offset_of_all_ranges_is_found_as_scipy_finds_it(by: float) -> None:
    ranges = noisy(2) + by
    fix, fit = fixed(ranges), scipy_fit(ranges, list(range(N)), offset=True)
    assert fix.found
    assert fix.unknowns == AFRESH
    np.testing.assert_array_equal(fix.used, ALL)
    np.testing.assert_allclose(fix.p, fit.x[:3], atol=1e-7)
    np.testing.assert_allclose(fix.clock[:2], [1.0, fit.x[3]], atol=1e-7)
    covariance = np.linalg.inv(fit.jac.T @ fit.jac)
    np.testing.assert_allclose(fix.C, covariance[:3, :3], rtol=1e-4, atol=1e-9)
    assert fix.clock[2] == pytest.approx(covariance[3, 3], rel=0.01)


@pytest.mark.long
def test_an_offset_that_is_known_is_one_more_measurement() -> None:
    ranges, clock = noisy(4) + 0.7, np.array([1.0, 0.68, 0.02**2])

    def residuals(z: np.ndarray) -> np.ndarray:
        d = np.linalg.norm(z[:3] - ANCHORS, axis=1) + z[3]
        return np.append((ranges - d) / NOISE[0], (z[3] - clock[1]) / 0.02)

    fit = scipy.optimize.least_squares(residuals, np.append(P_WB, 0.7), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    fix = fixed(ranges, clock)
    assert fix.unknowns == KNOWN
    np.testing.assert_allclose(fix.p, fit.x[:3], atol=1e-7)
    np.testing.assert_allclose(fix.clock[1], fit.x[3], atol=1e-7)
    np.testing.assert_allclose(fix.C, np.linalg.inv(fit.jac.T @ fit.jac)[:3, :3], rtol=1e-4, atol=1e-9)


@pytest.mark.long
def test_an_offset_is_kept_while_it_lasts_and_forgotten_when_it_is_gone() -> None:
    clock, found = NO_CLOCK, []
    for seed in range(40):
        fix = fixed(noisy(seed) + (0.7 if 10 <= seed < 25 else 0.0), clock)
        clock = fix.clock
        found.append((bool(clock[0]), float(clock[1])))
        assert fix.found
        assert np.linalg.norm(fix.p - P_WB) < 0.3
    assert not any(known for known, _ in found[:10])
    assert all(known for known, _ in found[11:25])
    assert np.mean([b for _, b in found[15:25]]) == pytest.approx(0.7, abs=0.05)
    assert not any(known for known, _ in found[30:])


@pytest.mark.long
def test_too_many_wrong_ranges_make_no_fix() -> None:
    ranges = noisy(1) + 3.0 * (-1.0) ** np.arange(N)
    assert not fixed(ranges, share=0.2).found
    few = np.zeros(N)
    few[:4] = 1.0
    wrong = noisy(1)
    wrong[0] += 5.0
    fit = scipy_fit(wrong, [0, 1, 2, 3])
    assert 2.0 * fit.cost > chi2.ppf(0.9999, 1)  # one of four is wrong, and nothing says which
    assert not fixed(wrong, there=few).found
    few[3] = 0.0
    assert fixed(noisy(1), there=few).found  # three cannot be tested
    few[2] = 0.0
    assert not fixed(noisy(1), there=few).found


def fix_at(settings: Multilateration, uwb: np.ndarray, clock: np.ndarray) -> np.ndarray:
    its = PlayedBox(fix_box(settings, ANCHORS), clock=clock)
    return its.say(message=uwb, belief=np.append(P_WB + 0.1, np.zeros(237)))[:FIX_SIZE]


@pytest.mark.long
@pytest.mark.parametrize("bias_sd", [0.0, 0.05])
@pytest.mark.parametrize("case", ["one wrong", "offset", "known offset"])
def test_fixes_have_the_slopes_of_differences(case: str, bias_sd: float) -> None:
    settings = Multilateration.model_validate(
        {"noise": {"kind": "constant", "sd": NOISE[0]}, "bias_sd": bias_sd, "exclude": {}}
    )
    ranges, clock = TRUE.copy(), NO_CLOCK
    if case == "one wrong":
        ranges[4] += 2.0
    else:
        ranges += 1.5
        clock = np.array([1.0, 1.5, 1e-4]) if case == "known offset" else clock
    uwb = np.concatenate(([1.0, 0.1], ranges, ALL))
    found = fix_at(settings, InitializeAutoDiff(uwb[:, None])[:, 0], clock)[:, None]
    plain = fix_at(settings, uwb, clock)
    assert plain[0] == 1.0
    np.testing.assert_allclose(ExtractValue(found)[:, 0], plain, atol=1e-9)
    steps = 1e-5 * np.eye(uwb.size)[2 : 2 + N]
    slopes = [(fix_at(settings, uwb + s, clock) - fix_at(settings, uwb - s, clock)) / 2e-5 for s in steps]
    np.testing.assert_allclose(ExtractGradient(found)[:, 2 : 2 + N], np.column_stack(slopes), rtol=1e-4, atol=1e-5)


def test_only_least_squares_leaves_ranges_out() -> None:
    with pytest.raises(InputError, match=r"multilateration\.exclude: must be null with method 'nearest_three'"):
        load_scenario("imu_uwb", ("multilateration={method: nearest_three, exclude: {}}",))
    with pytest.raises(InputError, match=r"multilateration\.exclude\.least_ranges"):
        load_scenario("imu_uwb", ("multilateration.exclude.least_ranges=4",))
    with pytest.raises(InputError, match=r"multilateration\.bias_bank: .* with exclude, and so must noise_scale"):
        load_scenario("imu_uwb", ("multilateration.exclude={}",))
