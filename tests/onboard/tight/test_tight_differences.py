"""Differences in the tight filter: the textbook's update by a numeric Jacobian of the measurement written out anew."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ortilo_drake.model.range_pairs import ROW
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, Layout, Q, make_layout, nominal_size
from ortilo_drake.onboard.estimator.tight.model import aids_of
from ortilo_drake.onboard.estimator.tight.ranges import take_differences
from ortilo_drake.onboard.estimator.tight.tick import keep_pose
from ortilo_drake.onboard.estimator.tight.update import inject
from ortilo_drake.scenario import load_scenario

ANCHORS = np.array([[0.0, 0.0, 0.3], [8.0, 0.5, 2.0], [7.0, 6.0, 0.4], [0.5, 6.5, 2.4]])
LEVER = np.array([0.1, -0.05, 0.2])
NOISE = np.array([0.05, 0.01])
SCENARIO = load_scenario("tight_differences")
AIDS = aids_of(SCENARIO.estimator, SCENARIO.load_room(), SCENARIO)._replace(
    anchors=ANCHORS, lever=LEVER, range_noise=NOISE, gates=np.full(3, 1e9), huber=np.inf
)


def made(layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(5)
    root = 1e-3 * rng.normal(size=(layout.core, layout.core))
    C = np.zeros((layout.n, layout.n))
    C[: layout.core, : layout.core] = root @ root.T
    x = np.zeros(nominal_size(layout))
    x[:6], x[ADDITIVE : layout.core + 1] = [5.0, 1.0, 1.5, 1.2, -0.8, 0.4], 0.01 * rng.normal(size=layout.core - GYRO)
    x[Q : Q + 4] = Rotation.from_euler("xyz", [0.05, -0.03, 0.4]).as_quat()[[3, 0, 1, 2]]
    for _ in range(layout.clones):
        keep_pose(x, C, layout)
        x[0:3] += [0.04, -0.03, 0.01]
    return x, C


def said(x: np.ndarray, layout: Layout, a: int, b: int, age: float, clone: int) -> tuple[float, float]:
    """Return what a row should say and the variance of its noise."""
    at = 0 if clone < 0 else layout.core + 1 + 7 * clone
    q = x[Q : Q + 4] if clone < 0 else x[at + 3 : at + 7]
    R = Rotation.from_quat(q[[1, 2, 3, 0]]).as_matrix()
    errors = x[ADDITIVE - GYRO :]
    place = x[at : at + 3] + R @ LEVER - (age + errors[layout.clock]) * x[3:6]
    r = [np.linalg.norm(place - ANCHORS[i]) + errors[layout.range_bias + i] + errors[layout.range_slow + i]
         for i in (a, b)]  # fmt: skip
    return float(r[1] - r[0]), float(np.sum((NOISE[0] + NOISE[1] * np.array(r)) ** 2))


def message_of(*rows: tuple[float, ...]) -> np.ndarray:
    return np.concatenate(([1.0, 0.0], *rows))


@pytest.mark.parametrize("clone", [-1, 0])
def test_a_row_is_the_textbooks_update(clone: int) -> None:
    layout = make_layout({"clock": 2, "range_bias": 4, "range_slow": 4}, 1)
    x, C = made(layout)
    a, b, age, step = 2, 1, 0.03, 1e-6
    value, variance = said(x, layout, a, b, age, clone)
    H = np.empty(layout.n)
    for i in range(layout.n):
        ends = []
        for sign in (1.0, -1.0):
            y, error = x.copy(), np.zeros(layout.n)
            error[i] = sign * step
            inject(y, error, layout.core)
            ends.append(said(y, layout, a, b, age, clone)[0])
        H[i] = (ends[0] - ends[1]) / (2.0 * step)
    S, e = H @ C @ H + variance, 0.01
    K, before, was = C @ H / S, x.copy(), C.copy()
    expected = before.copy()
    inject(expected, K * e, layout.core)
    message = message_of((a, b, value + e, 1.0, age), (0, 1, 3.0, 0.0, 0.0), (0, 9, 0.0, 1.0, 0.0))
    assert take_differences(x, C, layout, message, AIDS, clone) == (1, 0)  # none that is not there, or of no anchor
    np.testing.assert_allclose(x, expected, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(C, was - np.outer(K, H @ was), atol=1e-12)
    pose = [0, 6] if clone < 0 else [layout.core, layout.core + 3]
    assert np.abs(H[[*pose, 3, layout.clock, layout.range_bias + a, layout.range_slow + b]]).min() > 1e-3
    before, was = x.copy(), C.copy()
    message[2 + 2] += 50.0
    assert take_differences(x, C, layout, message, AIDS._replace(gates=np.full(3, 20.0)), clone) == (0, 1)  # the gate
    np.testing.assert_array_equal(x, before)
    np.testing.assert_array_equal(C, was)


def test_many_differences_find_the_place_whatever_all_ranges_err_by() -> None:
    layout = make_layout({}, 0)
    x, C = made(layout)
    truth = x.copy()
    x[0:3] += [0.1, -0.15, 0.08]
    C[:] = 0.0
    C[0:3, 0:3] = 0.2**2 * np.eye(3)
    R = Rotation.from_quat(truth[Q : Q + 4][[1, 2, 3, 0]]).as_matrix()
    d = np.linalg.norm(truth[0:3] + R @ LEVER - ANCHORS, axis=1) + 7.0  # of a clock that nobody knows
    rows = [(i, (i + 1) % 4, d[(i + 1) % 4] - d[i], 1.0, 0.0) for i in range(4)]
    for _ in range(4):
        take_differences(x, C, layout, message_of(*rows), AIDS._replace(range_noise=np.array([1e-3, 0.0])), -1)
    assert np.linalg.norm(x[0:3] - truth[0:3]) < 3e-3
    assert len(message_of(*rows)) == 2 + 4 * ROW
