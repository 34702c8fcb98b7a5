"""Drag's k as a state: found by a flight whose accelerometer fails, and left as it was told without a deviation."""

import numpy as np
import pytest
from made_up_motion import ANCHORS

from ortilo_drake.interop.recorded.map_file import FilterSettings, Start
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import GRAVITY, Imu
from ortilo_drake.studies.recorded.doubts import of_failed
from ortilo_drake.studies.recorded.filter_types import NO_AIDS, FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate

K, TOLD, STEP = 0.6, 0.3, 1e-3
SETTINGS = FilterSettings(acceleration=0.05, range_white=0.02, range_correlated=0.001)


def flight():
    """Return ranges, IMU, stamps and places of 20 s at one height that pitch flies back and forth against drag.

    With f = (-K v_B, 0, T) in the body and T such that nothing climbs; the accelerometer's x is 12 m/s² off.
    """
    rng = np.random.default_rng(2)
    t = np.arange(0.0, 20.0, STEP)
    theta, rate = 0.25 * np.sin(1.3 * t), 0.325 * np.cos(1.3 * t)
    x, v = np.empty(len(t)), np.empty(len(t))
    x[0], v[0] = 2.0, 0.5
    thrust = np.empty(len(t))
    for k in range(len(t)):
        drag = K * v[k] * np.cos(theta[k])
        thrust[k] = (GRAVITY - drag * np.sin(theta[k])) / np.cos(theta[k])
        if k + 1 < len(t):
            a = -drag * np.cos(theta[k]) + thrust[k] * np.sin(theta[k])
            x[k + 1], v[k + 1] = x[k] + STEP * v[k] + 0.5 * STEP**2 * a, v[k] + STEP * a
    p = np.column_stack([x, np.full(len(t), 4.0), np.full(len(t), 1.2)])
    imu = np.column_stack([0.0 * t, rate, 0.0 * t, 12.0 + 0.0 * t, 0.0 * t, thrust])[::10]
    imu += rng.standard_normal(imu.shape) * [0.001, 0.001, 0.001, 0.05, 0.05, 0.05]
    heard = t[::50]
    r = np.linalg.norm(p[::50, None] - ANCHORS, axis=2) + 0.02 * rng.standard_normal((len(heard), 6))
    ranges = single_ranges(np.repeat(heard, 6), np.tile(np.arange(6), len(heard)), r.ravel())
    return ranges, Imu(t[::10], imu[:, :3], imu[:, 3:], None), t, p


def known(k_sd: float) -> FilterSetup:
    aids = NO_AIDS._replace(drag=TOLD, drag_sd=0.02, doubted=3.0)
    start = Start(position=(2.0, 4.0, 1.2), position_sd=0.05, heading_sd=0.01)
    return FilterSetup(ANCHORS, np.zeros(6), np.zeros(3), 0.0, start=start, aids=aids, k_sd=k_sd)


@pytest.fixture(scope="module")
def flown():
    ranges, imu, t, p = flight()
    imu = imu._replace(force=imu.force * [0.0, 1.0, 1.0] + np.outer(12.0 * (imu.t > 0.5), [1.0, 0.0, 0.0]))
    at = np.arange(5.0, 19.9, 0.1)
    return [
        estimate(ranges, imu, known(sd), SETTINGS, at, smoothed)
        for sd, smoothed in ((0.3, False), (0.0, False), (0.3, True))
    ], p[np.searchsorted(t, at)]


@pytest.mark.long
def test_k_is_found_with_its_deviation_and_the_estimate_is_better(flown) -> None:
    (state, told, smooth), true = flown
    k, sd = state.drag
    assert np.isfinite(state.failed[0])
    assert 0.0 < sd < 0.05
    assert abs(k - K) < 3.0 * sd
    assert told.drag == (TOLD, 0.0)
    rms = [np.sqrt(np.mean((one.p - true) ** 2)) for one in (state, told, smooth)]
    assert rms[0] < rms[1]
    assert rms[2] < rms[0]
    assert any(note.startswith("drag: its k") for note in of_failed(state.failed, state.drag))
    assert not any(note.startswith("drag: its k") for note in of_failed(told.failed, told.drag))
