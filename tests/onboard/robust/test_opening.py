"""The filter's covariance opened: the step of a filter whose P was larger, in the ticks that are kept as well."""

import numpy as np
import pytest
from played_box import PlayedBox

from ortilo_drake.loop.element import Box
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.estimator.extra_states import augmented_rows, extra_states
from ortilo_drake.onboard.estimator.filter_element import filter_box
from ortilo_drake.onboard.estimator.filter_model import augmented_model, initial_covariance
from ortilo_drake.onboard.estimator.intermittent_filter import intermittent_step
from ortilo_drake.onboard.estimator.replay_element import replay_box
from ortilo_drake.onboard.estimator.robust.weights import opening_variances
from ortilo_drake.scenario import IntermittentFilter
from ortilo_drake.scenario.estimator import Opening

H = 1.0 / 30.0
SETTINGS = IntermittentFilter(force="thrust")
EXTRAS = extra_states(SETTINGS, M100, H)
MODEL = augmented_model(SETTINGS, M100, "hold", H, EXTRAS)
MEASUREMENT = augmented_rows(make_measurement().rows, EXTRAS)
P_0 = initial_covariance(SETTINGS, EXTRAS)
N = len(P_0)
BELIEF_0 = np.concatenate((np.zeros(N), P_0.ravel()))
PLAIN = filter_box(MODEL, MEASUREMENT, M100.hover_thrust, BELIEF_0)
REPLAYING = replay_box(MODEL, MEASUREMENT, M100.hover_thrust, BELIEF_0, 5, H)
OPENING = opening_variances(Opening(), ("d_x", "d_y", "d_z"))[2]
RNG = np.random.default_rng(8)
TICKS = 6
Y = RNG.normal(size=(TICKS, 9))
DELTA = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0], [1.0, 1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 0.0, 1.0]])
V2 = np.concatenate([0.01 * np.eye(3).ravel()] * 3)


def run(box: Box, opened: int, late: dict[int, int]) -> np.ndarray:
    """Return [xhat, P] after TICKS ticks, P opened in one of them; late maps a tick to the one its values are of."""
    kalman = PlayedBox(box, H)
    for k in range(TICKS):
        inputs = {"y": Y[k], "delta": DELTA[k], "V2": V2, "control": np.array([M100.hover_thrust, 0.0, 0.0, 0.0])}
        inputs |= {"reference": np.zeros(9), "opening": OPENING if k == opened else np.zeros(N)}
        if "stamps" in box.element.inputs:
            inputs["stamps"] = np.full(3, late.get(k, k) * H)
        kalman.step(k, **inputs)
    return kalman.say(TICKS, **inputs)


def expected(opened: int, y: np.ndarray, delta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return xhat and P by the equations as printed, of values that come in time."""
    x, P, layout = np.zeros(N), P_0.copy(), MEASUREMENT.layout
    for k in range(TICKS):
        if k == opened:
            P = P + np.diag(OPENING)
        x, P, _ = intermittent_step(x, P, y[k], delta[k], V2, np.zeros(4), np.zeros(3), MODEL, layout)
    return x, P


@pytest.mark.long
@pytest.mark.parametrize("opened", [-1, 0, 3])
@pytest.mark.parametrize("replays", [False, True])
def test_it_is_the_step_of_a_larger_covariance(opened: int, replays: bool) -> None:
    found = run(REPLAYING if replays else PLAIN, opened, {})
    x, P = expected(opened, Y, DELTA)
    np.testing.assert_allclose(found[:N], x, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(found[N:].reshape(N, N), P, rtol=1e-9, atol=1e-12)


@pytest.mark.long
def test_a_late_value_does_not_undo_it() -> None:
    """P is opened in tick 4; in tick 5 a value of tick 2 comes, by when every tick that is kept has been opened.

    So the filter is that of which P was opened in tick 2, the first that is run again. Of the imu tick 2 has a value.
    """
    found = run(REPLAYING, 4, {5: 2})
    y, delta = Y.copy(), DELTA.copy()
    y[2, :3], delta[2, 0], delta[5] = Y[5, :3], 1.0, 0.0
    x, P = expected(2, y, delta)
    np.testing.assert_allclose(found[:N], x, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(found[N:].reshape(N, N), P, rtol=1e-8, atol=1e-10)


def test_only_what_is_named_is_opened() -> None:
    opening = Opening(position=2.0, angle=0.5, velocity=3.0, rate=4.0, gyroscope=0.1)
    none, rates, whole = opening_variances(opening, ("d_x", "d_y", "d_z", "c_x", "c_y", "c_z"))
    assert not none.any()
    np.testing.assert_allclose(rates, np.repeat([0.0, 0.25, 0.0, 0.0, 0.0, 0.01, 0.0], 3))
    np.testing.assert_allclose(whole, np.repeat([4.0, 0.25, 9.0, 16.0, 0.0, 0.01, 0.0], 3))
