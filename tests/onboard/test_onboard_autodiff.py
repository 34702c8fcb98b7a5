"""The onboard half's systems on AutoDiffXd: the values of floats, and the slopes of differences."""

from typing import Any

import numpy as np
import pytest
from pydrake.autodiffutils import ExtractGradient, ExtractValue, InitializeAutoDiff
from pydrake.systems.framework import System

from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.onboard.estimator.measurement_handler import MeasurementStack_, incoming_of
from ortilo_drake.onboard.ranging.multilateration import Multilateration_
from ortilo_drake.scenario import Multilateration

H = 1.0 / 30.0
P_WB = np.array([1.0, 0.7, 1.4])
# Not in one plane, so that three ranges or more fix the position well.
ANCHORS = np.array([[0.0, 0.0, 0.1], [4.0, 0.2, 2.5], [3.7, 3.9, 0.3], [0.3, 4.1, 2.2], [2.0, 5.0, 1.0]])
SIZES = {"uwb": 14, "imu": 5}


def output_at(system: System, **inputs: np.ndarray) -> np.ndarray:
    context = system.CreateDefaultContext()
    for name, value in inputs.items():
        system.GetInputPort(name).FixValue(context, value)
    return np.array(system.get_output_port().Eval(context))


def differences(system: System, name: str, at: np.ndarray, size: float, **others: np.ndarray) -> np.ndarray:
    ends = [[output_at(system, **{name: at + s * d}, **others) for s in (1, -1)] for d in size * np.eye(len(at))]
    return np.column_stack([(after - before) / (2.0 * size) for after, before in ends])


@pytest.mark.parametrize(("method", "bias_sd"), [("least_squares", 0.0), ("least_squares", 0.05), ("nearest_three", 0)])
def test_a_fix_follows_the_ranges_as_the_geometry_says(method: str, bias_sd: float) -> None:
    settings = Multilateration.model_validate({"method": method, "bias_sd": bias_sd})
    system: Any = Multilateration_[float](settings, ANCHORS)
    away = P_WB - ANCHORS
    d = np.linalg.norm(away, axis=1)
    uwb, estimate = np.concatenate([[1.0, 0.1], d, np.ones(5)]), np.concatenate([P_WB + 0.1, np.zeros(12)])
    ranges = slice(2, 7)
    found = output_at(system.ToAutoDiffXd(), uwb=InitializeAutoDiff(uwb[:, None])[:, 0], estimate=estimate)[:, None]
    np.testing.assert_allclose(ExtractValue(found)[:, 0], output_at(system, uwb=uwb, estimate=estimate), atol=1e-12)
    slopes = ExtractGradient(found)
    # dp/dr = (J^T R^-1 J)^-1 J^T R^-1 over the ranges used, J = u_i^T; for three of them J^-1.
    used = np.argsort(d)[:3] if method == "nearest_three" else np.arange(5)
    fraction = getattr(settings.noise, "fraction", 0.0)
    J, weights = (away / d[:, None])[used], 1.0 / ((fraction * d[used]) ** 2 + bias_sd**2)
    expected = np.zeros((3, 5))
    expected[:, used] = np.linalg.solve(J.T @ (weights[:, None] * J), J.T * weights)
    np.testing.assert_allclose(slopes[2:5, ranges], expected, atol=1e-10)
    numbers = differences(system, "uwb", uwb[: len(uwb)], 1e-5, estimate=estimate)
    np.testing.assert_allclose(slopes[:, ranges], numbers[:, ranges], rtol=1e-6, atol=1e-7)  # the covariance, too


def test_no_fix_has_no_slope() -> None:
    system: Any = Multilateration_[float](Multilateration(), ANCHORS)
    uwb = np.concatenate([[1.0, 0.1], np.ones(5), [1.0, 1.0, 0.0, 0.0, 0.0]])  # two ranges
    found = output_at(system.ToAutoDiffXd(), uwb=InitializeAutoDiff(uwb[:, None])[:, 0], estimate=np.zeros(15))
    assert not ExtractValue(found[:, None]).any()
    assert not ExtractGradient(found[:, None]).any()


def stack(gates: dict[str, float], drops: bool = False) -> Any:
    measurement = make_measurement()
    V = {"uwb": None, "camera": np.eye(3), "imu": 1e-4 * np.eye(3)}
    incoming = incoming_of(measurement, SIZES, V, gates)
    return MeasurementStack_[float](sum(SIZES.values()), incoming, measurement.layout, H, drops)


def messages() -> np.ndarray:
    uwb = np.concatenate([[1.0, 0.0], P_WB, 0.01 * (np.eye(3) + 0.1).ravel()])
    return np.concatenate([uwb, [1.0, 0.0, 0.01, 0.02, 0.03]])


@pytest.mark.parametrize("gates", [{}, {"uwb": 0.999}])
@pytest.mark.parametrize("drops", [False, True])
def test_the_measurement_hands_slopes_on(gates: dict[str, float], drops: bool) -> None:
    system, at = stack(gates, drops), messages()
    predicted = {"estimate": np.concatenate([P_WB, np.zeros(12)]), "covariance": np.eye(15).ravel()} if gates else {}
    found = output_at(system.ToAutoDiffXd(), messages=InitializeAutoDiff(at[:, None])[:, 0], **predicted)[:, None]
    np.testing.assert_array_equal(ExtractValue(found)[:, 0], output_at(system, messages=at, **predicted))
    slopes = ExtractGradient(found)
    here = at != 0.0
    here[[0, 14]] = False  # the flags, which no slope crosses
    numbers = differences(system, "messages", at, 1e-3, **predicted)
    np.testing.assert_allclose(slopes[:, here], numbers[:, here], atol=1e-12)
    assert slopes[0:3, 2:5] == pytest.approx(np.eye(3))


def test_what_a_gate_shuts_out_has_no_slope() -> None:
    system, at = stack({"uwb": 0.999}), messages()
    far = {"estimate": np.zeros(15), "covariance": 1e-6 * np.eye(15).ravel()}
    found = output_at(system.ToAutoDiffXd(), messages=InitializeAutoDiff(at[:, None])[:, 0], **far)[:, None]
    p, s = 9, 3
    assert ExtractValue(found)[p, 0] == 0.0
    assert ExtractValue(found)[p + s - 1, 0] == 1.0
    assert not ExtractGradient(found)[0:3].any()
