"""Updates of the tight filter: the textbook's Kalman update, Jacobians by AutoDiffXd and differences, late messages."""

import numpy as np
import pytest
from pydrake.autodiffutils import AutoDiffXd, ExtractGradient, InitializeAutoDiff
from scipy.stats import chi2

from ortilo_drake.loop.plain import plain_source
from ortilo_drake.model.pinhole import box_center
from ortilo_drake.onboard.estimator.tight.attitude_rows import inverse_rate_matrix, take_angles, take_fix
from ortilo_drake.onboard.estimator.tight.inertial import angles_of, inertial_step, matrix_of, quaternion_of
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, GYRO, N_INERTIAL, Layout, Q, make_layout, nominal_size
from ortilo_drake.onboard.estimator.tight.model import aids_of
from ortilo_drake.onboard.estimator.tight.pixels import pose_belief, take_boxes
from ortilo_drake.onboard.estimator.tight.ranges import predicted_range, range_row, take_ranges
from ortilo_drake.onboard.estimator.tight.tick import keep_pose
from ortilo_drake.onboard.estimator.tight.update import none_taken, settle, update
from ortilo_drake.scenario import load_scenario

# As plain Python: the few steps here take less time than to compile them, and flights run them compiled.
take_angles, take_fix, inertial_step = plain_source(take_angles), plain_source(take_fix), plain_source(inertial_step)
pose_belief, take_boxes, take_ranges = plain_source(pose_belief), plain_source(take_boxes), plain_source(take_ranges)
keep_pose, settle, update = plain_source(keep_pose), plain_source(settle), plain_source(update)

SCENARIO = load_scenario("tight_imu_uwb_yolo")
ROOM = SCENARIO.load_room()
ANCHORS = np.ascontiguousarray(ROOM.anchor_positions)
CAMERA = ROOM.camera.scaled_to(320).constants
LEVER = np.array([0.1, -0.05, 0.2])
NOISE = np.array([0.05, 0.0])
OPEN = 1e9  # a gate that refuses nothing
AIDS = aids_of(SCENARIO.estimator, ROOM, SCENARIO)._replace(
    lever=LEVER, range_noise=NOISE, differences=False, gates=np.full(3, OPEN), huber=np.inf
)
ONLY_DIFFERENCES = AIDS._replace(differences=True)


def made(layout: Layout, seed: int = 0, scale: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
    """Return a nominal state in the room and a covariance with correlations; the clones are the pose itself."""
    rng = np.random.default_rng(seed)
    root = scale * rng.normal(size=(layout.core, layout.core))
    C = np.zeros((layout.n, layout.n))
    C[: layout.core, : layout.core] = root @ root.T
    x = np.zeros(nominal_size(layout))
    x[0:3], x[3:6] = [5.0, 1.0, 1.5], rng.normal(0.0, 0.3, 3)
    x[Q : Q + 4] = quaternion_of(np.array([0.05, -0.03, 0.1]))
    for _ in range(layout.clones):
        keep_pose(x, C, layout)
    return x, C


def uwb_message(p: np.ndarray, R: np.ndarray, there: int = 12, offset: float = 0.0) -> np.ndarray:
    message = np.zeros(2 + 2 * len(ANCHORS))
    message[0] = 1.0
    for i in range(there):
        message[2 + i] = np.linalg.norm(p + R @ LEVER - ANCHORS[i]) + offset
        message[2 + len(ANCHORS) + i] = 1.0
    return message


def test_the_gradient_of_a_range_is_autodiffs() -> None:
    p, R = np.array([1.0, -2.0, 1.2]), matrix_of(quaternion_of(np.array([0.2, -0.3, 0.8])))
    row = np.empty(6)
    d = range_row(p, R, LEVER, ANCHORS[3], row)
    z = InitializeAutoDiff(np.zeros((6, 1))).ravel()
    skew = np.array([[0 * z[0], -z[5], z[4]], [z[5], 0 * z[0], -z[3]], [-z[4], z[3], 0 * z[0]]])
    found = predicted_range(p + z[:3], R @ (np.eye(3) + skew), LEVER, ANCHORS[3])
    assert isinstance(found, AutoDiffXd)
    np.testing.assert_allclose(found.value(), d)
    np.testing.assert_allclose(ExtractGradient(np.array([[found]])).ravel(), row, atol=1e-12)


def test_an_update_is_the_textbooks() -> None:
    layout = make_layout({"range_bias": 12}, 0)
    x, C = made(layout)
    H = np.zeros(layout.n)
    where, row = np.array([0, 4, 20]), np.array([0.5, -1.0, 2.0])
    H[where] = row
    S = H @ C @ H + 0.01
    K = C @ H / S
    expected = (np.eye(layout.n) - np.outer(K, H)) @ C
    before = x.copy()
    taken = none_taken(1, layout.n)
    squared = update(x, C, taken, where, row, 3, 0.02, 0.01, OPEN, np.inf, layout.core, np.empty(layout.n))
    settle(C, taken)
    assert squared == pytest.approx(0.02**2 / S)
    np.testing.assert_allclose(C, expected, atol=1e-15)
    np.testing.assert_allclose(x[0:6], before[0:6] + K[0:6] * 0.02, atol=1e-15)
    np.testing.assert_allclose(x[ADDITIVE:], before[ADDITIVE:] + K[GYRO:] * 0.02, atol=1e-15)


@pytest.mark.parametrize("rows", [1, 4, 7, 12])
@pytest.mark.parametrize("anchors", [0, 12, 13])  # an even and an odd number of states
def test_rows_taken_one_after_the_other_and_settled_together_are_the_textbooks(rows: int, anchors: int) -> None:
    layout = make_layout({"range_bias": anchors}, 0)
    x, C = made(layout)
    rng = np.random.default_rng(rows)
    before, H, e = x.copy(), np.zeros((rows, layout.n)), rng.normal(0.0, 1e-3, rows)
    expected, error = C.copy(), np.zeros(layout.n)
    taken, where, PHt = none_taken(rows, layout.n), np.array([0, 4, layout.n - 1]), np.empty(layout.n)
    for k in range(rows):
        H[k, where] = rng.normal(size=3)
        K = expected @ H[k] / (H[k] @ expected @ H[k] + 1e-6)
        error += K * e[k]
        update(x, C, taken, where, H[k, where], 3, e[k], 1e-6, OPEN, np.inf, layout.core, PHt)
        expected -= np.outer(K, H[k] @ expected)
    settle(C, taken)
    np.testing.assert_allclose(C, expected, atol=1e-12 * np.abs(expected).max())
    np.testing.assert_array_equal(C, C.T)  # bit for bit: no row of it needs to be made symmetric
    np.testing.assert_allclose(x[0:6] - before[0:6], error[0:6], atol=1e-12)
    settled = C.copy()
    settle(C, taken)  # nothing is left to take
    np.testing.assert_array_equal(C, settled)


def test_a_gate_refuses_and_changes_nothing_and_hubers_weight_corrects_less() -> None:
    layout = make_layout({}, 0)
    x, C = made(layout)
    where, row, PHt = np.array([0]), np.ones(1), np.empty(layout.n)
    for e in (1.0, np.nan):
        y, D, taken = x.copy(), C.copy(), none_taken(1, layout.n)
        gate = float(chi2.ppf(0.999, 1))
        assert not update(y, D, taken, where, row, 1, e, 1e-4, gate, np.inf, layout.core, PHt) >= 0.0
        settle(D, taken)
        np.testing.assert_array_equal(y, x)
        np.testing.assert_array_equal(D, C)
    moved = []
    for huber in (np.inf, 1.5):
        y, D, taken = x.copy(), C.copy(), none_taken(1, layout.n)
        update(y, D, taken, where, row, 1, 0.1, 1e-4, OPEN, huber, layout.core, PHt)
        settle(D, taken)
        moved.append((y[0] - x[0], D[0, 0]))
    assert 0.0 < moved[1][0] < moved[0][0]
    assert moved[1][1] > moved[0][1]


def test_ranges_without_noise_find_the_position_from_any_number_of_anchors() -> None:
    layout = make_layout({}, 0)
    truth = np.array([5.1, 0.9, 1.55])
    errors = []
    for there in (1, 2, 12):
        x, C = made(layout)
        C[:] = 0.0
        C[0:3, 0:3] = 0.1**2 * np.eye(3)
        message = uwb_message(truth, matrix_of(x[Q : Q + 4]), there)
        for _ in range(2):  # the first is linearised 15 cm off
            well = AIDS._replace(range_noise=np.array([1e-3, 0.0]))
            assert take_ranges(x, C, layout, message, well, -1)[:2] == (there, 0)
        errors.append(np.linalg.norm(x[0:3] - truth))
    assert errors[0] < 0.15  # one is better than none
    assert errors[2] < 3e-3 < errors[0]


def test_an_offset_that_all_ranges_share_changes_nothing_where_only_differences_count() -> None:
    layout = make_layout({"range_bias": 12}, 0)
    found = []
    for offset in (0.0, 7.0):
        x, C = made(layout)
        message = uwb_message(x[0:3] + [0.001, -0.002, 0.003], matrix_of(x[Q : Q + 4]), offset=offset)
        take_ranges(x, C, layout, message, ONLY_DIFFERENCES, -1)
        found.append((x, C))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=2e-6)  # the clock's own sd is 100 m, not infinite
    np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-12)


def test_differences_are_those_to_one_anchor() -> None:
    """The textbook's update by eleven differences, whose noises share that of the twelfth range."""
    layout = make_layout({}, 0)
    x, C = made(layout)
    R = matrix_of(x[Q : Q + 4])
    truth = x[0:3] + [2e-4, -1e-4, 3e-4]
    H, row = np.zeros((12, layout.n)), np.empty(6)
    e = np.zeros(12)
    for i in range(12):
        e[i] = np.linalg.norm(truth + R @ LEVER - ANCHORS[i]) - range_row(x[0:3], R, LEVER, ANCHORS[i], row)
        H[i, 0:3], H[i, 6:9] = row[:3], row[3:]
    D = np.hstack([-np.ones((11, 1)), np.eye(11)])
    S = D @ (H @ C @ H.T + 0.05**2 * np.eye(12)) @ D.T
    K = C @ H.T @ D.T @ np.linalg.inv(S)
    expected = C - K @ D @ H @ C
    before = x.copy()
    take_ranges(x, C, layout, uwb_message(truth, R), ONLY_DIFFERENCES, -1)
    np.testing.assert_allclose(C, expected, atol=1e-9 * np.abs(C).max() + 1e-12)
    np.testing.assert_allclose(x[0:3] - before[0:3], (K @ D @ e)[0:3], atol=2e-8)


def test_a_late_message_is_as_good_as_in_time() -> None:
    """Ranges of the last tick, taken now at the pose kept, equal ranges taken then: to the linearisation's error."""
    layout = make_layout({"range_bias": 12}, 1)
    w, f, dt = np.array([0.1, -0.2, 0.05]), np.array([0.1, 0.2, 9.7]), 1.0 / 30.0
    keeps, steps = np.ones(layout.core - GYRO), np.zeros(layout.core - GYRO)
    from ortilo_drake.onboard.estimator.tight.inertial import propagate_covariance

    found = []
    for late in (False, True):
        x, C = made(layout, scale=1e-4)
        message = uwb_message(x[0:3] + [1e-4, -2e-4, 1e-4], matrix_of(x[Q : Q + 4]))
        if not late:
            take_ranges(x, C, layout, message, AIDS, -1)
        keep_pose(x, C, layout)
        A, N = np.eye(9, N_INERTIAL), np.zeros((9, 9))
        inertial_step(x, A, N, w, f, dt, np.array([1e-6, 1e-4]))
        propagate_covariance(C, A, N, keeps, steps, np.empty((9, layout.n)))
        if late:
            take_ranges(x, C, layout, message, AIDS, 0)
        found.append((x, C))
    np.testing.assert_allclose(found[0][0], found[1][0], atol=1e-9)
    np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-13)


def test_angles_are_taken_through_the_kinematic_equation() -> None:
    """Measured roll, pitch and yaw of a turned body, known well, bring the attitude there."""
    layout = make_layout({}, 0)
    x, C = made(layout)
    C[:] = 0.0
    C[6:9, 6:9] = 0.1**2 * np.eye(3)
    truth = np.array([0.06, -0.025, 0.08])
    take_angles(x, C, layout, truth - angles_of(x[Q : Q + 4]), 1e-12, OPEN, np.inf, np.empty(3))
    np.testing.assert_allclose(angles_of(x[Q : Q + 4]), truth, atol=2e-4)  # a turn of 0.02 rad, squared
    rpy = np.array([0.4, -0.3, 1.0])
    rates = inverse_rate_matrix(rpy) @ [0.2, -0.1, 0.3]
    turned = angles_of(quaternion_of(rpy))
    q = quaternion_of(rpy)
    from ortilo_drake.onboard.estimator.tight.inertial import turned as turn

    ahead = angles_of(turn(q, 0.2e-6, -0.1e-6, 0.3e-6))
    np.testing.assert_allclose((ahead - turned) / 1e-6, rates, atol=1e-6)


def test_correlated_values_are_taken_as_by_the_textbook() -> None:
    layout = make_layout({}, 0)
    x, C = made(layout)
    rows = np.zeros((2, 12))
    rows[0, 6], rows[1, 7], rows[1, 2] = 1.0, 1.0, 0.5
    V = np.array([[0.02, 0.01], [0.01, 0.03]])
    H = np.zeros((2, layout.n))
    H[0, 3], H[1, 4], H[1, 2] = 1.0, 1.0, 0.5
    value = np.array([x[3] + 0.01, x[4] + 0.5 * x[2] - 0.02])
    S = H @ C @ H.T + V
    K = C @ H.T @ np.linalg.inv(S)
    expected = C - K @ H @ C
    before = x.copy()
    assert take_fix(x, C, layout, value, V, rows, np.zeros(3), OPEN, np.inf)
    np.testing.assert_allclose(C, expected, atol=1e-16)
    np.testing.assert_allclose(x[0:6] - before[0:6], (K @ [0.01, -0.02])[0:6], atol=1e-12)


@pytest.mark.parametrize("groups", [{}, {"survey": 87, "pixel_slow": 58, "clock": 2}])
def test_boxes_without_noise_find_the_pose(groups: dict[str, int]) -> None:
    """Centres of boxes as the true pose shows them bring the estimate there, from 5 cm and 1 degree."""
    layout = make_layout(groups, 0)
    x, C = made(layout)
    C[:] = 0.0
    C[0:3, 0:3], C[6:9, 6:9] = 0.05**2 * np.eye(3), 0.02**2 * np.eye(3)
    x[3:6] = 0.0
    p, rpy = np.array([5.04, 0.97, 1.52]), np.array([0.06, -0.02, 0.115])
    z, J = np.empty(2), np.empty((2, 6))
    chosen, centers = [], []
    for i in range(len(ROOM.landmarks)):
        R = matrix_of(quaternion_of(rpy))
        where = ROOM.landmark_positions[i], ROOM.landmark_outlines[i], p, rpy, R, CAMERA
        if box_center(*where, z, J) and np.all((z > 0) & (z < CAMERA.image)):
            chosen.append(i)
            centers.append(z.copy())
    assert len(chosen) >= 3
    aids = AIDS._replace(pixel_noise=np.array([0.01, 0.0, 0.0 if not groups else 0.01]))
    for _ in range(3):  # as from three pictures: the first is linearised 5 cm off
        used, refused = take_boxes(x, C, layout, np.array(chosen), np.array(centers), aids, np.zeros(3), -1)
        assert (used, refused) == (len(chosen), 0)
    np.testing.assert_allclose(x[0:3], p, atol=2e-3)
    np.testing.assert_allclose(angles_of(x[Q : Q + 4]), rpy, atol=1e-3)


def test_the_association_gets_the_pose_as_euler_angles() -> None:
    layout = make_layout({}, 1)
    x, C = made(layout)
    xhat, P = pose_belief(x, C, layout, 0)  # the clone is the pose itself here
    now, P_now = pose_belief(x, C, layout, -1)
    np.testing.assert_allclose(xhat, now)
    np.testing.assert_allclose(P, P_now, atol=1e-18)
    E = inverse_rate_matrix(angles_of(x[Q : Q + 4]))
    np.testing.assert_allclose(P.reshape(15, 15)[3:6, 3:6], E @ C[6:9, 6:9] @ E.T, atol=1e-15)
