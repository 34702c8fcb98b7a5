"""The onboard half's elements on AutoDiffXd: the values of floats, and the slopes of differences."""

import numpy as np
import pytest
from played_box import PlayedBox
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff

from ortilo_drake.loop.element import Box
from ortilo_drake.model.hover import discretize, hover_A, hover_B, output_C
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.estimator.filter_element import filter_box
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATOR_HOLD, FilterModel
from ortilo_drake.onboard.estimator.measurement_handler import handler_box, incoming_of
from ortilo_drake.onboard.estimator.robust.weights import gate_box, opening_variances, weighing_of
from ortilo_drake.onboard.ranging.fix_element import fix_box
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.onboard.servo.lq_servo import servo_box
from ortilo_drake.scenario import LqServo, Multilateration, ServoWeights
from ortilo_drake.scenario.estimator import HuberWeight, Opening, Robust

H = 1.0 / 30.0
P_WB = np.array([1.0, 0.7, 1.4])
# Not in one plane, so that three ranges or more fix the position well.
ANCHORS = np.array([[0.0, 0.0, 0.1], [4.0, 0.2, 2.5], [3.7, 3.9, 0.3], [0.3, 4.1, 2.2], [2.0, 5.0, 1.0]])
SIZES = {"uwb": 14, "imu": 5}


def varied(values: np.ndarray) -> np.ndarray:
    """The same numbers, each of which is differentiated by."""
    return InitializeAutoDiff(values[:, None])[:, 0]


def differences(box: Box, name: str, at: np.ndarray, size: float, **others: np.ndarray) -> np.ndarray:
    its = PlayedBox(box)
    ends = [[its.say(**{name: at + s * d}, **others) for s in (1, -1)] for d in size * np.eye(len(at))]
    return np.column_stack([(after - before) / (2.0 * size) for after, before in ends])


@pytest.mark.parametrize(("method", "bias_sd"), [("least_squares", 0.0), ("least_squares", 0.05), ("nearest_three", 0)])
def test_a_fix_follows_the_ranges_as_the_geometry_says(method: str, bias_sd: float) -> None:
    settings = Multilateration.model_validate({"method": method, "bias_sd": bias_sd})
    box = fix_box(settings, ANCHORS)
    away = P_WB - ANCHORS
    d = np.linalg.norm(away, axis=1)
    uwb, belief = np.concatenate([[1.0, 0.1], d, np.ones(5)]), np.concatenate([P_WB + 0.1, np.zeros(237)])
    ranges = slice(2, 7)
    found = PlayedBox(box).say(message=varied(uwb), belief=belief)[:, None]
    plain = PlayedBox(box).say(message=uwb, belief=belief)
    np.testing.assert_allclose(ExtractValue(found)[:, 0], plain, atol=1e-12)
    slopes = ExtractGradient(found)
    # dp/dr = (J^T R^-1 J)^-1 J^T R^-1 over the ranges used, J = u_i^T; for three of them J^-1.
    used = np.argsort(d)[:3] if method == "nearest_three" else np.arange(5)
    fraction = getattr(settings.noise, "fraction", 0.0)
    J, weights = (away / d[:, None])[used], 1.0 / ((fraction * d[used]) ** 2 + bias_sd**2)
    expected = np.zeros((3, 5))
    expected[:, used] = np.linalg.solve(J.T @ (weights[:, None] * J), J.T * weights)
    np.testing.assert_allclose(slopes[2:5, ranges], expected, atol=1e-10)
    numbers = differences(box, "message", uwb, 1e-5, belief=belief)
    np.testing.assert_allclose(slopes[:, ranges], numbers[:, ranges], rtol=1e-6, atol=1e-7)  # the covariance, too


def test_no_fix_has_no_slope() -> None:
    uwb = np.concatenate([[1.0, 0.1], np.ones(5), [1.0, 1.0, 0.0, 0.0, 0.0]])  # two ranges
    found = PlayedBox(fix_box(Multilateration(), ANCHORS)).say(message=varied(uwb), belief=np.zeros(240))
    assert not ExtractValue(found[:, None]).any()
    assert not ExtractGradient(found[:, None]).any()


def handler(gates: dict[str, float], drops: bool = False) -> Box:
    measurement = make_measurement()
    V = {"uwb": None, "camera": np.eye(3), "imu": 1e-4 * np.eye(3)}
    incoming = incoming_of(measurement, SIZES, V, gates)
    return handler_box(incoming, measurement.layout, drops, H)


def messages() -> np.ndarray:
    uwb = np.concatenate([[1.0, 0.0], P_WB, 0.01 * (np.eye(3) + 0.1).ravel()])
    return np.concatenate([uwb, [1.0, 0.0, 0.01, 0.02, 0.03]])


@pytest.mark.parametrize("gates", [{}, {"uwb": 0.999}])
@pytest.mark.parametrize("drops", [False, True])
def test_the_measurement_hands_slopes_on(gates: dict[str, float], drops: bool) -> None:
    box, at = handler(gates, drops), messages()
    belief = np.concatenate([P_WB, np.zeros(12), np.eye(15).ravel()])
    found = PlayedBox(box).say(messages=varied(at), belief=belief)[:, None]
    np.testing.assert_array_equal(ExtractValue(found)[:, 0], PlayedBox(box).say(messages=at, belief=belief))
    slopes = ExtractGradient(found)
    here = at != 0.0
    here[[0, 14]] = False  # the flags, which no slope crosses
    numbers = differences(box, "messages", at, 1e-3, belief=belief)
    np.testing.assert_allclose(slopes[:, here], numbers[:, here], atol=1e-12)
    assert slopes[0:3, 2:5] == pytest.approx(np.eye(3))


def test_what_a_gate_shuts_out_has_no_slope() -> None:
    far = np.concatenate([np.zeros(15), 1e-6 * np.eye(15).ravel()])
    found = PlayedBox(handler({"uwb": 0.999})).say(messages=varied(messages()), belief=far)[:, None]
    p, s = 9, 3
    assert ExtractValue(found)[p, 0] == 0.0
    assert ExtractValue(found)[p + s - 1, 0] == 1.0
    assert not ExtractGradient(found)[0:3].any()


@pytest.mark.parametrize("form", ["paper", "error"])
def test_the_servo_answers_the_estimate_with_its_gain(form: str) -> None:
    gain = servo_gain(M100, ServoWeights(), H)
    at = np.random.default_rng(3).normal(size=15)
    known = {"force": np.zeros(3), "reference": np.ones(9)}
    found = PlayedBox(servo_box(gain, M100.mass, LqServo(form=form))).say(belief=varied(at), **known)
    np.testing.assert_allclose(ExtractGradient(found[:, None]), -gain, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("delta", [(1.0, 1.0, 1.0), (1.0, 0.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0)])
def test_the_filter_follows_estimate_and_values_by_the_gain_of_what_arrived(delta: tuple[float, ...]) -> None:
    """d x_{k+1} / d x_k = Phi (I - K C) and d x_{k+1} / d y = Phi K, K = P C^T (C P C^T + V)^-1 of the rows there."""
    rng, (Phi, Gamma), measurement = (
        np.random.default_rng(4),
        discretize(hover_A(), hover_B(M100), H),
        make_measurement(),
    )
    root = 0.1 * rng.normal(size=(12, 12))
    P, V2 = np.zeros((15, 15)), np.array([0.01, 0.04, 1e-4])
    P[:12, :12] = root @ root.T
    x, y, here = rng.normal(size=15), rng.normal(size=9), np.repeat(delta, 3) == 1.0
    model = FilterModel.of(Phi, Gamma, 1e-4 * np.eye(12), INTEGRATOR_HOLD)
    box = filter_box(model, measurement, M100.hover_thrust, np.concatenate([x, P.ravel()]))
    both = varied(np.concatenate([x, y]))
    its = PlayedBox(box, belief=np.concatenate([both[:15], P.ravel()]))
    V = np.concatenate([v * np.eye(3).ravel() for v in V2])
    known = {
        "delta": np.array(delta),
        "V2": V,
        "control": np.zeros(4),
        "reference": np.zeros(9),
        "opening": np.zeros(15),
    }
    its.step(y=both[15:], **known)
    slopes = ExtractGradient(its.say(y=both[15:], **known)[:12, None])
    C = output_C()[here]
    K = P[:12, :12] @ C.T @ np.linalg.inv(C @ P[:12, :12] @ C.T + np.diag(np.repeat(V2, 3)[here]))
    np.testing.assert_allclose(slopes[:, :12], Phi @ (np.eye(12) - K @ C), atol=1e-10)
    np.testing.assert_allclose(slopes[:, 15:][:, here], Phi @ K, atol=1e-10)
    assert not slopes[:, 15:][:, ~here].any()


@pytest.mark.long
def test_what_is_refused_or_weighed_is_a_constant_of_the_slopes() -> None:
    """At 4 standard deviations Huber's weight of c = 2 is 2; at 100 a value is refused."""
    measurement, sd = make_measurement(), np.sqrt(0.01 + 0.03)
    robust = Robust(weight=HuberWeight(c=2.0), adaptation=None, drift=None)
    box = gate_box(weighing_of(robust, measurement, 3), opening_variances(Opening(), ()), [-1] * 3, H)
    y = np.zeros(9)
    y[0], y[3] = 4.0 * sd, 100.0 * sd
    V2, P = 0.03 * np.tile(np.eye(3).ravel(), 3), 0.01 * np.eye(15)
    belief, both = np.concatenate([np.zeros(15), P.ravel()]), varied(np.concatenate([y, V2]))
    said = PlayedBox(box).parts(y=both[:9], V2=both[9:], delta=np.ones(3), belief=belief, past=np.zeros(1))
    slopes = {name: ExtractGradient(values[:, None]) for name, values in said.items() if name in ("y", "V2")}
    np.testing.assert_array_equal(slopes["y"], np.eye(9, 36) * np.repeat([1.0, 0.0, 1.0], 3)[:, None])
    scaled = {0: 2.0, 2: 1.0}  # of the sensors that are used
    for j, factor in scaled.items():
        rows = slice(9 * j, 9 * j + 9)
        np.testing.assert_allclose(slopes["V2"][rows], factor * np.eye(27, 36, 9)[rows], rtol=1e-12)
