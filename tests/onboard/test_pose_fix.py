"""Fixes that give yaw or attitude beside the position, and boxes of unequal errors, against dense algebra."""

import numpy as np
import pytest
from seen_landmarks import CAMERA, EXACT, POINTS, boxes, centers, covariance, solve, state

from ortilo_drake.model.cholesky import scaled_inverse
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.measurement import ATTITUDE_CAMERA
from ortilo_drake.model.measurement import CAMERA as CAMERA_ROWS
from ortilo_drake.model.signals import DETECTION_SIZE, DETECTIONS_SIZE, PAYLOAD
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.estimator.filter_model import filter_model
from ortilo_drake.onboard.estimator.intermittent_filter import filter_step, intermittent_step
from ortilo_drake.onboard.landmarks.known_attitude import FREE_SD
from ortilo_drake.onboard.landmarks.landmark_association import associate, center_sd
from ortilo_drake.onboard.landmarks.landmark_fix import METHODS
from ortilo_drake.scenario import IntermittentFilter, load_scenario
from ortilo_drake.scenario.belief import measurement_of

known_attitude, known_tilt, pose = METHODS["known_attitude"], METHODS["known_tilt"], METHODS["pose"]

DOTS = np.zeros((len(POINTS), 1, 3))  # an outline of one point has no kinks: the projection is smooth
SMALL = 1e-4  # errors so small that the projection is linear in them [px]
YAW = [0, 1, 2, 5]


def jacobian() -> np.ndarray:
    """d centres / d [p_WB, rpy] (2 n, 6) by central differences of OpenCV's projection."""
    ahead, back = ([centers(EXACT + d, POINTS, DOTS).ravel() for d in s * np.eye(6)] for s in (1e-5, -1e-5))
    return (np.array(ahead) - np.array(back)).T / 2e-5


def spread(seed: int) -> np.ndarray:
    """Errors of the boxes (n, 2) that differ by a factor of five [px]."""
    return SMALL * np.random.default_rng(seed).uniform(0.2, 1.0, (len(POINTS), 2))


def test_a_compass_that_is_off_moves_neither_the_yaw_nor_the_position_of_a_fix_with_yaw() -> None:
    xhat = state()
    xhat[5] += 0.1
    found, value, _ = solve("known_tilt", centers(EXACT), xhat)
    assert found
    np.testing.assert_allclose(value, np.array(EXACT)[YAW], atol=1e-6)
    held = solve("known_attitude", centers(EXACT), xhat, max_residual=1e3)
    assert np.linalg.norm(held[1] - EXACT[:3]) > 0.2  # what it does to one without


@pytest.mark.long
def test_the_covariance_of_position_and_yaw_is_that_of_its_boxes_and_of_the_tilt() -> None:
    sd, J = spread(0), jacobian()
    weighted, P = J / sd.reshape(-1, 1), covariance(angle_sd=1e-7)
    Q, A = weighted[:, YAW], weighted[:, 3:5]
    N_inverse = np.linalg.inv(Q.T @ Q)
    G = N_inverse @ Q.T @ A
    found, _, cov = known_tilt(centers(EXACT, POINTS, DOTS), POINTS, DOTS, state(), P, CAMERA, sd, 4.0)
    assert found
    np.testing.assert_allclose(
        cov, N_inverse + 1e-14 * G @ G.T, rtol=1e-4, atol=1e-4 * np.abs(cov[:3, :3]).max() * 0.01
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("method", "sought"), [(known_attitude, [0, 1, 2]), (known_tilt, YAW), (pose, list(range(6)))])
def test_boxes_of_unequal_errors_are_weighted_by_them(method, sought, seed: int) -> None:
    """The fix is the weighted least squares solution, as numpy's lstsq has it."""
    sd, J = spread(seed), jacobian()
    errors = sd * np.random.default_rng(100 + seed).normal(size=sd.shape)
    z = centers(EXACT, POINTS, DOTS) + errors
    found, value, _ = method(z, POINTS, DOTS, state(), 1e-30 * np.eye(15).ravel(), CAMERA, sd, 8.0)
    expected = np.linalg.lstsq(J[:, sought] / sd.reshape(-1, 1), (errors / sd).ravel(), rcond=None)[0]
    assert found
    np.testing.assert_allclose(value - np.array(EXACT)[sought], expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max())


def test_a_filter_given_the_whole_pose_knows_what_it_would_by_the_pixels() -> None:
    """Position and attitude of correlated errors: the six rows and their covariance lose nothing of the boxes."""
    rng, sd, J = np.random.default_rng(3), spread(3), jacobian()
    root = 3e-6 * rng.normal(size=(6, 6))
    P, error = root @ root.T, root @ rng.normal(size=6)
    pixels = sd * rng.normal(size=sd.shape)
    xhat = state(np.array(EXACT) + error)
    found, value, V = pose(centers(EXACT, POINTS, DOTS) + pixels, POINTS, DOTS, xhat, covariance(), CAMERA, sd, 8.0)
    assert found
    by_pose = P @ np.linalg.solve(P + V, value - xhat[:6])
    R, e = np.diag(sd.ravel() ** 2), pixels.ravel() - J @ error
    by_pixels = P @ J.T @ np.linalg.solve(J @ P @ J.T + R, e)
    np.testing.assert_allclose(by_pose, by_pixels, rtol=1e-3, atol=1e-3 * np.abs(by_pixels).max())
    after, dense = P - P @ np.linalg.solve(P + V, P), P - P @ J.T @ np.linalg.solve(J @ P @ J.T + R, J @ P)
    np.testing.assert_allclose(after, dense, rtol=1e-3, atol=1e-3 * np.abs(dense).max())


def test_two_landmarks_leave_the_attitude_to_the_filter() -> None:
    """Six unknowns and four equations: with the filter's angles of FREE_SD the covariance is the dense one."""
    J, n = jacobian()[:4], 2
    found, _, cov = pose(
        centers(EXACT, POINTS[:n], DOTS[:n]), POINTS[:n], DOTS[:n], state(), covariance(), CAMERA, np.ones((n, 2)), 4.0
    )
    assert found
    expected = np.linalg.inv(J.T @ J + np.diag([0.0] * 3 + [FREE_SD**-2] * 3))
    np.testing.assert_allclose(cov, expected, rtol=1e-4, atol=1e-4 * expected.max())


def test_the_scaled_inverse_is_numpys_and_none_of_a_singular_matrix() -> None:
    root = np.random.default_rng(0).normal(size=(4, 4)) * [1.0, 1e3, 1e-3, 1.0]
    regular, inverse = scaled_inverse(root.T @ root)
    assert regular
    np.testing.assert_allclose(inverse @ (root.T @ root), np.eye(4), atol=1e-6)
    assert not scaled_inverse(root[:3].T @ root[:3])[0]
    assert not scaled_inverse(np.diag([1.0, 0.0, 1.0, 1.0]))[0]


@pytest.mark.long
def test_the_error_of_a_centre_grows_with_the_box() -> None:
    assert center_sd(0.0, 0.6, 0.025) == 0.6
    assert center_sd(40.0, 0.6, 0.025) == pytest.approx(0.6 * np.sqrt(2.0))
    size = np.array([0.4, 0.6, 1.0])
    corners = 0.5 * size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])[None]
    pose_0 = (0.0, 0.0, 1.5, 0.0, 0.0, 0.0)
    p_W = np.array([[5.0, 0.0, 1.5]])
    near = 5.0 - 0.2 - CAMERA.p_BC[0]  # depth of the box's nearest face
    seen = np.array([CAMERA.f * 0.6 / near, CAMERA.f * 1.0 / near])
    message = np.zeros(DETECTIONS_SIZE)
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    message[PAYLOAD : PAYLOAD + 6] = [0.0, 0.9, *boxes(np.array(pose_0), p_W, corners)[0]]
    known = p_W, corners, np.zeros(1), CAMERA
    sds = associate(message, state(pose_0), np.eye(15).ravel(), *known, 0.6, 13.8, 0.025)[2].sd
    np.testing.assert_allclose(sds[0], 0.6 * np.sqrt(1.0 + (0.025 * seen) ** 2), rtol=1e-2)


@pytest.mark.parametrize("angles", [ATTITUDE_CAMERA[2:], ATTITUDE_CAMERA])
def test_the_filter_takes_the_first_three_rows_of_a_longer_fix_for_the_integral(angles) -> None:
    """The loop kernel against the paper's matrices over random arrivals, and what E picks."""
    measurement = measurement_of(("uwb", "camera", "imu"), (*CAMERA_ROWS, *angles))
    first = measurement.rows_of("camera").start
    E = measurement.selection_matrix(np.array([0.0, 1.0, 1.0]))
    np.testing.assert_array_equal(E[:, first : first + 3], np.eye(3))
    assert E.sum() == 3.0
    model = filter_model(IntermittentFilter(), Vehicle(), "hold", 1.0 / 30.0)
    rng, layout = np.random.default_rng(0), measurement.layout
    belief = np.concatenate((np.zeros(15), 1e-2 * np.eye(15).ravel()))
    belief[15 + 16 * 12 :: 16] = 0.0  # the integral is known
    for _ in range(200):
        V2 = np.zeros(measurement.sizes["V2"])
        for sensor in measurement.sensors:
            m = len(measurement.C_of(sensor))
            root = 0.1 * rng.normal(size=(m, m))
            V2[measurement.block_of(sensor)] = (root @ root.T + 1e-3 * np.eye(m)).ravel()
        delta = (rng.random(3) < 0.5).astype(float)
        y, u, r = 0.1 * rng.normal(size=measurement.sizes["y"]), 0.1 * rng.normal(size=4), 0.1 * rng.normal(size=3)
        xhat, P, _ = intermittent_step(belief[:15], belief[15:].reshape(15, 15), y, delta, V2, u, r, model, layout)
        belief = filter_step(belief, y, delta, V2, u, r, model, layout)
        np.testing.assert_allclose(belief[:15], xhat, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(belief[15:].reshape(15, 15), P, rtol=1e-8, atol=1e-9)


def test_a_printed_V_of_three_is_refused_where_a_fix_gives_more() -> None:
    with pytest.raises(InputError, match=r"estimator\.V\.camera: \[0\.08, 0\.08, 0\.08\]: must be null"):
        load_scenario("paper_imu_uwb_yolo", ("landmark_fix.method=pose",))
