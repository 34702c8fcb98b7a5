"""What keeps the recorded filter upright: one anchor behind metal, a height believed too low, a rest that is biased."""

import numpy as np
import pytest
from made_up_motion import ANCHORS
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import FilterSettings, Start
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import GRAVITY, Imu
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, THETA, Q, V
from ortilo_drake.studies.recorded.event_rows import grown_at
from ortilo_drake.studies.recorded.filter_types import NO_AIDS, FilterSetup, noise_of, nominal, states
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.imu_watch import (
    DIFFERS,
    HELD,
    RESTS,
    force_agrees,
    force_row,
    watch_rest,
    watched_from,
)

SETTINGS = FilterSettings(range_white=0.05, range_correlated=0.05, bias_start=0.05)


def hover(tail: float, far: float) -> float:
    """Return the RMS error of a hover [m] of which one anchor errs by more and more, up to `far` [m] within 4 s."""
    rng = np.random.default_rng(3)
    t, p = np.arange(0.0, 12.0, 0.01), np.array([2.0, 4.0, 1.2])
    imu = np.column_stack([np.zeros((len(t), 5)), np.full(len(t), GRAVITY)]) + 0.005 * rng.standard_normal((len(t), 6))
    heard = t[::5]
    r = np.linalg.norm(p - ANCHORS, axis=1) + 0.05 * rng.standard_normal((len(heard), len(ANCHORS)))
    r[:, 0] += far * np.clip((heard - 2.0) / 4.0, 0.0, 1.0)
    ranges = single_ranges(np.repeat(heard, len(ANCHORS)), np.tile(np.arange(len(ANCHORS)), len(heard)), r.ravel())
    known = FilterSetup(ANCHORS, None, np.zeros(3), 0.0, start=Start(position=tuple(p), heading_sd=0.05))
    settings = SETTINGS.model_copy(update={"range_tail": tail})
    found = estimate(ranges, Imu(t, imu[:, :3], imu[:, 3:], None), known, settings, np.arange(1.0, 11.9, 0.1))
    return float(np.sqrt(np.mean(np.sum((found.p - p) ** 2, axis=1))))


@pytest.mark.long
def test_an_anchor_that_errs_by_far_pulls_less_where_that_is_expected() -> None:
    assert hover(0.7, 0.6) < 0.7 * hover(0.0, 0.6)
    assert hover(0.7, 0.0) < 1.1 * hover(0.0, 0.0)


def test_a_height_that_may_be_larger_counts_near_the_floor() -> None:
    """By the docs 1 + (near_floor / height)^4, of the height two standard deviations above the one believed."""
    x = np.zeros(nominal(states(3)))
    x[2], x[Q] = 0.25, 1.0
    noise = noise_of(FilterSettings(near_floor=0.5), True)
    assert grown_at(x, 0.0, np.zeros(3), noise, NO_AIDS) == pytest.approx(10.0)  # at most
    assert grown_at(x, 0.375**2, np.zeros(3), noise, NO_AIDS) == pytest.approx(1.0 + 0.5**4)


@pytest.mark.parametrize("bias", [0.0, 0.19, -0.4])
def test_a_biased_force_is_no_take_off_and_hides_none(bias) -> None:
    x, C, watched = np.zeros(20), np.eye(19), watched_from(True)
    for _ in range(5000):
        watch_rest(x, C, watched, GRAVITY + bias, 1e-3)
    assert watched[RESTS] == 1.0
    for _ in range(300):
        watch_rest(x, C, watched, GRAVITY + bias + 2.0, 1e-3)
    assert watched[RESTS] == 0.0


@pytest.mark.parametrize("axis", [0, 1])
def test_the_row_of_the_force_by_drag_is_its_derivative(axis) -> None:
    N, k, v, b = states(3), 0.4, np.array([0.7, -0.4, 0.2]), np.array([0.05, -0.02, 0.1])
    R, D, w = Rotation.from_euler("ZYX", [0.6, 0.2, -0.15]), 1e-6, watched_from(False)
    x = np.zeros(N + 1)
    x[V : V + 3], x[Q + 7 : Q + 10], x[-1] = v, b, k

    def force(d):
        A = (R * Rotation.from_rotvec(d[THETA : THETA + 3])).as_matrix()
        return b[axis] + d[ACCEL + axis] - (k + d[N - 1]) * (A.T @ (v + d[V : V + 3]))[axis]

    where, row, w[DIFFERS + axis], w[HELD + axis] = np.zeros(16, np.int64), np.zeros(16), 0.03, 0.1
    assert force_row(x, R.as_matrix(), axis, w, where, row) == pytest.approx(0.3)
    dense = np.zeros(N)
    np.add.at(dense, where[:8], row[:8])
    np.testing.assert_allclose(dense, [(force(D * e) - force(-D * e)) / (2 * D) for e in np.eye(N)], atol=1e-8)


def test_force_and_drag_agree_only_after_they_did_for_a_while() -> None:
    watched = watched_from(False)
    seen = []
    for squared in [0.5] * 60 + [9.0] * 20:
        watched[HELD] = 0.1
        seen.append(force_agrees(watched, 0, squared))
    assert not seen[0]
    assert all(seen[30:60])
    assert not seen[-1]
