"""An estimator of one's own that declares the linear filter that it is about hover has the theory of that filter."""

from dataclasses import asdict, replace
from pathlib import Path
from runpy import run_path
from types import SimpleNamespace
from typing import Any, Literal

import numpy as np
import pytest
from scipy.linalg import block_diag, expm, solve_discrete_are

import ortilo_drake as od
from ortilo_drake.floor.cramer_rao import rows_by_kind
from ortilo_drake.onboard.servo.lq_gain import gain_of
from ortilo_drake.scenario import Scenario
from ortilo_drake.studies.linearization.operating_point import frozen_gain
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, hover_loop, why_no_loop
from ortilo_drake.studies.report.analyze import theory
from ortilo_drake.studies.tube.tube import predict_tube

EXAMPLES = Path(__file__).parents[2] / "examples"
SD, H = 0.1, 1.0 / 30.0
pytestmark = pytest.mark.usefixtures("own_register")


def own_scenario(base: str = "nominal_imu_uwb") -> tuple[dict[str, Any], Scenario]:
    module = run_path(str(EXAMPLES / "kalman_filter.py"))
    return module, od.load_scenario(base, {"estimator": {"kind": "own_kalman", "sd": SD}, "camera.kind": "projected"})


def steady() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return Phi, Gamma, K and P of the hover model in closed form, of a position's and the angles' measurements."""
    vehicle, A, B = od.Vehicle(), np.zeros((12, 12)), np.zeros((12, 6))
    A[:6, 6:] = np.eye(6)
    A[6, 4], A[7, 3] = 9.81, -9.81
    B[6:9, :3], B[9:, 3:] = np.eye(3) / vehicle.mass, np.diag(1.0 / np.array(vehicle.inertia))
    exp = expm(H * np.block([[A, B], [np.zeros((6, 18))]]))
    Phi, Gamma_d = exp[:12, :12], exp[:12, 12:]
    W = Gamma_d @ np.diag([0.27**2] * 3 + [0.005**2] * 3) @ Gamma_d.T
    C, V = np.eye(6, 12), np.diag([SD**2] * 3 + [1e-4] * 3)
    P = solve_discrete_are(Phi.T, C.T, W, V)
    return Phi, Gamma_d[:, 2:], Phi @ P @ C.T @ np.linalg.inv(C @ P @ C.T + V), P


def test_its_gain_and_its_loop_are_the_closed_forms() -> None:
    _, own = own_scenario()
    Phi, Gamma, expected, _ = steady()
    K, delta = frozen_gain(own)
    np.testing.assert_allclose(K[:, [0, 1, 2, 6, 7, 8]], expected, rtol=1e-6, atol=1e-9)
    assert not K[:, 3:6].any()  # no camera flies
    # Of a servo on the estimate and the estimate's integral the loop's modes are the servo's and the filter's.
    servo = np.block([[Phi, np.zeros((12, 3))], [-np.eye(3, 12), np.eye(3)]])
    servo -= np.vstack([Gamma, np.zeros((3, 4))]) @ gain_of(own)
    modes = np.linalg.eigvals(block_diag(servo, Phi - expected @ np.eye(6, 12)))
    found = np.linalg.eigvals(closed_loop_matrix(hover_loop(own), K, delta))
    assert all(np.abs(found - mode).min() < 1e-6 for mode in modes)


def test_what_it_declares_is_what_it_flies() -> None:
    module, own = own_scenario()
    Phi, Gamma, K, P = steady()
    box = module["make"](own.belief, np.zeros(15))
    tables, anchors = box.given.tables, own.load_room().anchor_positions
    true = np.array([4.0, 1.0, 1.5, 0.01, -0.02, 0.03, *[0.0] * 6])
    uwb = np.array([1.0, 0.0, *np.linalg.norm(true[:3] - anchors, axis=1), *np.ones(len(anchors))])
    imu = np.array([1.0, 0.0, *true[3:6], *np.zeros(6)])
    hover = np.array([own.vehicle.hover_thrust, 0.0, 0.0, 0.0])

    def after(x: np.ndarray, u: np.ndarray = hover) -> tuple[np.ndarray, np.ndarray]:
        x, its_P = x.copy(), P.copy()
        n = SimpleNamespace(hover=hover[0])
        module["step"](n, uwb, imu, u, anchors, *(tables[name] for name in ("V", "Phi", "Gamma", "W")), x, its_P)
        return x, its_P

    slope = [(after(true + e)[0] - after(true - e)[0]) / 2e-5 for e in 1e-5 * np.eye(12)]
    np.testing.assert_allclose(np.array(slope).T, Phi - K @ np.eye(6, 12), atol=1e-7)
    np.testing.assert_allclose(after(true)[1], P, rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(after(true, hover + [0.0, 1e-3, 0.0, 0.0])[0], after(true)[0] + 1e-3 * Gamma[:, 1])


@pytest.mark.long
def test_its_theory_and_its_tube_are_those_of_the_papers_filter() -> None:
    _, own = own_scenario("nominal_imu_uwb_yolo")
    assert own.linear_filter is not None
    paper = own.model_copy(update={"estimator": own.linear_filter})
    found, expected = theory(own), theory(paper)
    assert found.linearization is None  # of Drake's derivatives
    np.testing.assert_equal(asdict(found), asdict(replace(expected, linearization=None)))
    np.testing.assert_array_equal(predict_tube(own).covariance, predict_tube(paper).covariance)


class Silent(od.Frozen):
    """Settings of an estimator that is never flown."""

    kind: Literal["silent"] = "silent"


def never(belief: od.Belief, xbar_0: np.ndarray) -> Any:
    raise NotImplementedError("it is not flown")


def test_the_floor_counts_what_it_reads() -> None:
    od.register_estimator(
        "silent", Silent, never, linear=lambda b: od.IntermittentFilter(rates="measured", force="measured")
    )
    reads = od.load_scenario("nominal_imu_uwb", {"estimator": {"kind": "silent"}})
    truth = np.tile([3.0, 1.0, 1.5, *[0.0] * 9], (4, 1))
    found = rows_by_kind(reads, truth, reads.load_room(), with_errors=True)
    assert found is not None
    assert set(found[0]) == {"uwb", "imu", "rates", "force"}


def test_without_a_declaration_a_line_says_what_is_missing() -> None:
    run_path(str(EXAMPLES / "range_follower.py"))
    flown = od.load_scenario("nominal_imu_uwb", {"estimator": {"kind": "range_follower"}})
    line = "estimator.kind: range_follower: must be intermittent, or registered with its linear filter at hover"
    assert why_no_loop(flown) == line
    with pytest.raises(od.InputError, match=line):
        hover_loop(flown)
