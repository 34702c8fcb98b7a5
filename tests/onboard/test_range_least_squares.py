"""Descent from far away and the start without an estimate, against SciPy and closed forms."""

import numpy as np
import pytest

from ortilo_drake.model.room import load_room
from ortilo_drake.onboard.ranging.range_equations import descend, least_squares, linear_start, normal_equations

ANCHORS = load_room().anchor_positions
ALL = np.ones(len(ANCHORS))
NOISE = np.array([0.02, 0.0075])
CUBE = np.array([[x, y, z] for x in (0.0, 6.0) for y in (0.0, 5.0) for z in (0.0, 3.0)])


def cost(p: np.ndarray, ranges: np.ndarray, anchors: np.ndarray) -> float:
    errors = ranges - np.linalg.norm(p - anchors, axis=1)
    return float(np.sum((errors / (NOISE[0] + NOISE[1] * ranges)) ** 2))


@pytest.mark.parametrize("far", [1.0, 5.0, 20.0, 100.0])
@pytest.mark.parametrize("seed", range(6))
def test_from_however_far_away_the_descent_ends_in_a_minimum_below_the_start(far: float, seed: int) -> None:
    """Gauss-Newton without damping runs astray from more than a few metres away."""
    rng = np.random.default_rng(seed)
    p = rng.uniform([0.0, -3.5, 0.2], [21.0, 3.5, 2.8])
    ranges = np.linalg.norm(p - ANCHORS, axis=1) * (1.0 + 0.0075 * rng.normal(size=len(ANCHORS)))
    direction = rng.normal(size=3)
    start = p + far * direction / np.linalg.norm(direction)
    least, q = descend(ranges, ALL, ANCHORS, NOISE, tuple(start))
    xx, xy, xz, yy, yz, zz = normal_equations(q, ranges, ALL, ANCHORS, NOISE)[1]
    assert least <= cost(start, ranges, ANCHORS)
    assert least == pytest.approx(cost(q, ranges, ANCHORS), rel=1e-9)
    slope = np.array([cost(q + d, ranges, ANCHORS) - cost(q - d, ranges, ANCHORS) for d in 1e-4 * np.eye(3)]) / 2e-4
    bend = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    assert np.linalg.norm(np.linalg.solve(bend, slope)) < 1e-5  # what a step would still gain [m]
    for axis in np.eye(3):  # no saddle
        for step in (-0.05, 0.05):
            assert cost(q + step * axis, ranges, ANCHORS) > least


def test_from_between_anchors_of_one_plane_the_damped_step_goes_on_where_no_other_can() -> None:
    """In the anchors' own plane the normal equations are singular."""
    square = np.array([[0.0, 0.0, 2.0], [6.0, 0.0, 2.0], [6.0, 6.0, 2.0], [0.0, 6.0, 2.0]])
    p = np.array([2.0, 2.5, 2.0])
    ranges = np.linalg.norm(p - square, axis=1)
    least, q = descend(ranges, np.ones(4), square, NOISE, (4.0, 4.0, 2.0))
    assert least < 1e-12
    np.testing.assert_allclose(q, p, atol=1e-6)


def test_what_cannot_converge_says_so() -> None:
    """No range: nothing to go by, no N to invert, whatever the damping."""
    least, q = descend(np.ones(len(ANCHORS)), 0.0 * ALL, ANCHORS, NOISE, (1.0, 2.0, 3.0))
    assert least == np.inf
    np.testing.assert_array_equal(q, [1.0, 2.0, 3.0])


@pytest.mark.long
@pytest.mark.parametrize("there", [ALL, 0.0 * ALL])
def test_without_a_fit_there_is_no_fix_and_its_covariance_is_of_the_same_shape(there: np.ndarray) -> None:
    last = np.array([1.0, 2.0, 3.0])
    found, p_WB, covariance = least_squares(np.full(len(ANCHORS), np.nan), there, ANCHORS, NOISE, last)
    assert not found
    np.testing.assert_array_equal(p_WB, last)
    np.testing.assert_array_equal(covariance, np.zeros((3, 3)))


@pytest.mark.parametrize("seed", range(10))
def test_the_start_without_an_estimate_is_exact_for_exact_ranges(seed: int) -> None:
    rng = np.random.default_rng(seed)
    there = np.ones(8)
    there[rng.choice(8, 3, replace=False)] = 0.0
    p = rng.uniform([-5.0, -5.0, -5.0], [11.0, 10.0, 8.0])
    ranges = np.where(there == 1.0, np.linalg.norm(p - CUBE, axis=1), 77.0)
    possible, start = linear_start(ranges, there, CUBE)
    if np.linalg.matrix_rank(CUBE[there == 1.0] - CUBE[there == 1.0].mean(axis=0)) == 3:
        assert possible
        np.testing.assert_allclose(start, p, atol=1e-9)
    else:
        assert not possible


@pytest.mark.parametrize(("spread", "possible"), [(0.0, False), (0.001, False), (0.004, False), (0.006, True)])
def test_anchors_that_are_nearly_in_one_plane_give_no_start(spread: float, possible: bool) -> None:
    """Four anchors, two of them above the plane and two below: 4 spread^2 is the least spread squared."""
    heights = 2.0 + spread * np.array([1.0, -1.0, 1.0, -1.0])
    flat = np.column_stack([[0.0, 6.0, 6.0, 0.0], [0.0, 0.0, 6.0, 6.0], heights])
    p = np.array([2.0, 2.5, 1.0])
    found, start = linear_start(np.linalg.norm(p - flat, axis=1), np.ones(4), flat)
    assert found == possible
    if possible:
        np.testing.assert_allclose(start, p, atol=1e-6)


def test_ranges_to_misplaced_anchors_do_not_lead_to_the_mirror_image() -> None:
    """3000 surveys of 5 cm, an anchor overhead at 0.8 m: its range alone is off by many of its own deviations."""
    rng, p = np.random.default_rng(0), np.array([0.17, 0.11, 1.5])
    wrong = {0.0: 0, 0.05: 0}
    for _ in range(3000):
        true = ANCHORS + 0.05 * rng.normal(size=ANCHORS.shape)
        ranges = np.linalg.norm(true - p, axis=1) * (1.0 + 0.0075 * rng.normal(size=len(ANCHORS)))
        start = p + 0.05 * rng.normal(size=3)
        for bias_sd in wrong:
            found, q, _ = least_squares(ranges, ALL, ANCHORS, np.array([0.0, 0.0075, bias_sd]), start)
            wrong[bias_sd] += not found or np.linalg.norm(q - p) > 0.5
    assert wrong[0.0] > 0
    assert wrong[0.05] == 0


def test_from_a_wrong_start_the_mirror_image_is_left_with_a_survey_that_is_not_exact_too() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        p = rng.uniform([0.0, -3.5, 0.2], [21.0, 3.5, 1.0])
        true = ANCHORS + 0.05 * rng.normal(size=ANCHORS.shape)
        ranges = np.linalg.norm(true - p, axis=1) * (1.0 + 0.0075 * rng.normal(size=len(ANCHORS)))
        start = np.array([p[0], p[1], 6.0])
        found, q, _ = least_squares(ranges, ALL, ANCHORS, np.array([0.0, 0.0075, 0.05]), start)
        assert found
        assert np.linalg.norm(q - p) < 1.0
