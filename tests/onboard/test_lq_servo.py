"""The servo's two laws in closed form, hover, and the feed-forward against Newton's law."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.linalg import block_diag, solve_discrete_are
from scipy.stats import ortho_group

from ortilo_drake.diagrams.single_parts import make_lq_servo
from ortilo_drake.model.equations import small_angle_dynamics
from ortilo_drake.model.hover import output_C
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100, Vehicle
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, is_detectable, lq_gain, servo_gain, weight_matrices
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


PHIBAR, GAMMABAR = augmented_pair(M100, H)
Q, R = weight_matrices(ServoWeights())


def scaled_gap(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.max(np.abs(a - b)) / np.max(np.abs(b)))


def test_augmented_pair_is_the_papers_with_uwb_for_the_position() -> None:
    E = make_measurement().selection_matrix(np.ones(3))
    np.testing.assert_array_equal(PHIBAR[12:, :12], -E @ output_C())
    np.testing.assert_array_equal(PHIBAR[12:, 12:], np.eye(3))
    np.testing.assert_array_equal(PHIBAR[:12, 12:], np.zeros((12, 3)))
    np.testing.assert_array_equal(GAMMABAR[12:], np.zeros((3, 4)))


def test_weights_stand_at_their_states() -> None:
    weights = ServoWeights(
        position=(1.0, 2.0, 3.0), angle=(4.0, 5.0, 6.0), velocity=(7.0, 8.0, 9.0), rate=(10.0, 11.0, 12.0),
        integral=(13.0, 14.0, 15.0), control=(16.0, 17.0, 18.0, 19.0),
    )  # fmt: skip
    Q_15, R_4 = weight_matrices(weights)
    np.testing.assert_array_equal(Q_15, np.diag(np.arange(1.0, 16.0)))
    np.testing.assert_array_equal(R_4, np.diag([16.0, 17.0, 18.0, 19.0]))


def test_drake_scipy_and_the_papers_backward_recursion_agree() -> None:
    L, S = lq_gain(PHIBAR, GAMMABAR, Q, R)
    S_scipy = solve_discrete_are(PHIBAR, GAMMABAR, Q, R)
    # The paper: S_k = Q + Phi^T S Phi - Phi^T S Gamma L, L = (Gamma^T S Gamma + R)^-1 Gamma^T S Phi, from S_N = Q.
    S_back = Q
    for _ in range(20_000):
        L_back = np.linalg.solve(GAMMABAR.T @ S_back @ GAMMABAR + R, GAMMABAR.T @ S_back @ PHIBAR)
        before = Q + PHIBAR.T @ S_back @ (PHIBAR - GAMMABAR @ L_back)
        before = (before + before.T) / 2
        settled, S_back = scaled_gap(before, S_back) < 1e-14, before
        if settled:
            break
    assert scaled_gap(S, S_scipy) < 1e-8
    assert scaled_gap(S, S_back) < 1e-8
    assert scaled_gap(L, L_back) < 1e-8


@pytest.mark.parametrize(
    ("Phi", "Gamma", "Q", "R", "S"),
    [
        ([[0, 1], [0, 0]], [[0], [1]], [[1, 2], [2, 4]], [[1]], [[1, 2], [2, 2 + np.sqrt(5)]]),
        (
            [[4, 3], [-4.5, -3.5]], [[1], [-1]], [[9, 6], [6, 4]], [[1]],
            (1 + np.sqrt(5)) / 2 * np.array([[9, 6], [6, 4]]),
        ),
        *(
            (np.eye(n, k=1), np.eye(n)[:, -1:], np.eye(n), [[1]], np.diag(np.arange(1.0, n + 1)))
            for n in (2, 5, 10)
        ),
    ],
    ids=["laub", "golden", "shift 2", "shift 5", "shift 10"],
)  # fmt: skip
def test_textbook_riccati_equations(Phi: list, Gamma: list, Q: list, R: list, S: list) -> None:
    system = [np.array(M, dtype=float) for M in (Phi, Gamma, Q, R)]
    found = lq_gain(*system)[1]
    np.testing.assert_allclose(found, S, rtol=1e-10, atol=1e-10)


@settings(max_examples=40)
@given(
    st.floats(0.3, 10.0),
    arrays(float, 3, elements=st.floats(0.002, 0.5)),
    st.floats(0.005, 0.1),
    arrays(float, 4, elements=st.floats(0.01, 10.0)),
    arrays(float, 3, elements=st.floats(1e-4, 1.0)),
)
def test_closed_loop_is_stable_for_any_vehicle(
    mass: float, inertia: np.ndarray, h: float, control: np.ndarray, integral: np.ndarray
) -> None:
    vehicle = Vehicle(mass=mass, inertia=tuple(inertia), rotor_max_speed=5000.0)
    weights = ServoWeights(control=tuple(control), integral=tuple(integral))
    Phibar, Gammabar = augmented_pair(vehicle, h)
    L = servo_gain(vehicle, weights, h)
    assert np.max(np.abs(np.linalg.eigvals(Phibar - Gammabar @ L))) < 1.0


def without_weight(states: slice) -> np.ndarray:
    lighter = Q.copy()
    lighter[states, states] = 0.0
    return lighter


def test_an_unweighted_integral_or_yaw_is_refused() -> None:
    for states in (slice(12, 15), slice(13, 14), slice(5, 6)):
        with pytest.raises(InputError, match=r"^servo\.weights: .*not detectable.*$"):
            lq_gain(PHIBAR, GAMMABAR, without_weight(states), R)
    lq_gain(PHIBAR, GAMMABAR, without_weight(slice(0, 3)), R)  # the integrals see the position


def test_matrices_beyond_what_can_be_computed_with_are_refused() -> None:
    with pytest.raises(InputError, match="mass, inertia and control_rate differ too much in size"):
        lq_gain(np.full_like(PHIBAR, np.inf), GAMMABAR, Q, R)


def test_a_vehicle_that_cannot_yaw_is_refused() -> None:
    crippled = GAMMABAR.copy()
    crippled[:, 3] = 0.0
    with pytest.raises(InputError, match="not stabilisable"):
        lq_gain(PHIBAR, crippled, Q, R)


def test_every_weight_counts() -> None:
    L = servo_gain(M100, ServoWeights(), H)
    for group in ("position", "angle", "velocity", "rate", "integral"):
        heavier = tuple(10.0 * w for w in getattr(ServoWeights(), group))
        assert scaled_gap(servo_gain(M100, ServoWeights(**{group: heavier}), H), L) > 1e-3, group


def test_detectability_of_small_pairs_by_hand() -> None:
    double = np.array([[1.0, H], [0.0, 1.0]])
    assert is_detectable(double, np.array([[1.0, 0.0]]))
    assert not is_detectable(double, np.array([[0.0, 1.0]]))  # the speed never tells the position
    assert is_detectable(np.diag([0.5, 1.0]), np.array([[0.0, 1.0]]))  # the unseen part decays by itself
    assert not is_detectable(np.diag([1.5, 1.0]), np.array([[0.0, 1.0]]))


def test_turned_coordinates_hide_nothing_from_detectability() -> None:
    """Four integrators in a chain: its first state shows all of them, its second never the first, in any basis.

    A general eigenvalue solver splits the 1 by some 1e-4, so that a rank test at its values finds full rank.
    """
    chain = block_diag(np.eye(4) + np.eye(4, k=1), 0.5)
    for seed in range(200):
        T = ortho_group.rvs(5, random_state=np.random.default_rng(seed))
        Phi = T @ chain @ T.T
        assert is_detectable(Phi, np.array([[1.0, 0.0, 0.0, 0.0, 1.0]]) @ T.T), seed
        assert not is_detectable(Phi, np.array([[0.0, 1.0, 0.0, 0.0, 1.0]]) @ T.T), seed
