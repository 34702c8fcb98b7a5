"""The servo's two laws in closed form, hover, and the feed-forward against Newton's law."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from ortilo_drake.diagrams.single_parts import make_lq_servo
from ortilo_drake.model.equations import small_angle_dynamics
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, servo_gain
from ortilo_drake.onboard.servo.lq_servo import resting_integral, servo_control
from ortilo_drake.scenario import ServoWeights, load_scenario

H = 1.0 / 30.0
L = servo_gain(M100, ServoWeights(), H)
HOVER = np.array([2.7 * 9.81, 0.0, 0.0, 0.0])
XBAR = arrays(float, 15, elements=st.floats(-5.0, 5.0))
REFERENCE = arrays(float, 9, elements=st.floats(-5.0, 5.0))
NOTHING = np.zeros(3)


@given(XBAR, REFERENCE)
def test_paper_form_is_minus_L_times_the_augmented_estimate(xbar: np.ndarray, reference: np.ndarray) -> None:
    u = servo_control(xbar, reference, L, M100.mass, 0.3, False)
    np.testing.assert_allclose(u, HOVER - L @ xbar, rtol=1e-12, atol=1e-10)


@given(XBAR, REFERENCE)
def test_error_form_is_minus_L_times_the_error_without_acceleration(xbar: np.ndarray, reference: np.ndarray) -> None:
    reference[6:] = 0.0
    r, r_dot = reference[:3], reference[3:6]
    x_ref = np.concatenate([r, [0.0, 0.0, 0.4], r_dot, NOTHING])
    u = servo_control(xbar, reference, L, M100.mass, 0.4, True)
    np.testing.assert_allclose(u, HOVER - L @ np.concatenate([xbar[:12] - x_ref, xbar[12:]]), rtol=1e-12, atol=1e-10)


@given(REFERENCE, st.floats(-0.5, 0.5), arrays(float, 3, elements=st.floats(-0.3, 0.3)))
def test_feed_forward_tilts_and_lifts_to_the_planned_acceleration(
    reference: np.ndarray, yaw: float, a: np.ndarray
) -> None:
    reference[6:] = a
    still = np.zeros(15)
    feed_forward = servo_control(still, reference, np.zeros((4, 15)), M100.mass, yaw, True)
    # x_ref, which the servo keeps to itself: with u_0 = -(x - x_ref)_k, each entry shows at x = 0.
    x_ref = np.zeros(12)
    for k in range(12):
        u = servo_control(still, reference, np.eye(4, 15, k=k), M100.mass, yaw, True)
        x_ref[k] = u[0] - feed_forward[0]
    np.testing.assert_allclose(x_ref[[0, 1, 2, 6, 7, 8]], reference[:6], atol=1e-12)
    np.testing.assert_allclose(x_ref[[5, 9, 10, 11]], [yaw, 0.0, 0.0, 0.0], atol=1e-12)
    # The vehicle tilted like that and lifted like that accelerates as planned, but for terms of second order.
    x_dot = small_angle_dynamics(x_ref, feed_forward, np.zeros(6), M100.mass, np.array(M100.inertia))
    second_order = float(a @ a) / 9.81
    np.testing.assert_allclose(x_dot[6:9], a, rtol=0.0, atol=2.0 * second_order + 1e-12)


@pytest.mark.long
@pytest.mark.parametrize("form", ["paper", "error"])
@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_holding_still_at_the_reference_needs_the_weight_and_no_torque(form: str, yaw: float) -> None:
    if form == "paper":
        yaw = 0.0  # the paper's law holds the heading 0
    r = np.array([3.0, -1.5, 1.2])
    xbar = np.concatenate([r, [0.0, 0.0, yaw], np.zeros(6), resting_integral(L, r, form)])
    reference = np.concatenate([r, np.zeros(6)])
    u = servo_control(xbar, reference, L, M100.mass, yaw, form == "error")
    np.testing.assert_allclose(u, HOVER, atol=1e-9)


@pytest.mark.parametrize("form", ["paper", "error"])
def test_linear_loop_settles_at_the_reference_from_elsewhere(form: str) -> None:
    Phibar, Gammabar = augmented_pair(M100, H)
    r = np.array([0.7, -0.4, 0.5])
    reference = np.concatenate([r, np.zeros(6)])
    xbar = np.zeros(15)
    for _ in range(12_000):
        u = servo_control(xbar, reference, L, M100.mass, 0.0, form == "error") - HOVER
        xbar = Phibar @ xbar + Gammabar @ u
        xbar[12:] += r
    np.testing.assert_allclose(xbar[:12], [*r, *np.zeros(9)], atol=1e-9)


@pytest.mark.parametrize("form", ["paper", "error"])
@pytest.mark.parametrize("velocities", ["estimate", "truth"])
def test_the_system_flies_its_settings(form: str, velocities: str) -> None:
    rng = np.random.default_rng(31)
    xbar, reference, v = rng.normal(size=15), rng.normal(size=9), rng.normal(size=6)
    yaw = 2.1 if form == "error" else 0.0  # the paper's law holds none
    settings = f"servo={{form: {form}, velocities: {velocities}, yaw: {yaw}}}"
    servo = make_lq_servo(load_scenario("imu_uwb", (settings,)))
    context = servo.CreateDefaultContext()
    assert context.is_stateless()
    servo.GetInputPort("estimate").FixValue(context, xbar)
    servo.GetInputPort("reference").FixValue(context, reference)
    known = xbar.copy()
    if velocities == "truth":
        servo.GetInputPort("velocity").FixValue(context, [1.0, 0.0, *v])
        known[6:12] = v
    expected = servo_control(
        known, reference, servo_gain(M100, ServoWeights(), H, yaw), M100.mass, yaw, form == "error"
    )
    np.testing.assert_array_equal(servo.get_output_port().Eval(context), expected)
