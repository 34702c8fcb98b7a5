"""The methods against OpenCV's projection, the Cramer-Rao bound and their own covariances; the system."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from played_box import PlayedBox
from scipy import stats
from seen_landmarks import (
    ATTITUDE_SD,
    CAMERA,
    EACH,
    EXACT,
    OUTLINES,
    POINTS,
    ROOM,
    boxes,
    centers,
    covariance,
    jacobian,
    solve,
    state,
)

from ortilo_drake.model.signals import DETECTION_SIZE, DETECTIONS_SIZE, PAYLOAD
from ortilo_drake.onboard.landmarks.fix_element import ELEMENTS, camera_fix_box
from ortilo_drake.onboard.landmarks.known_attitude import pose_from_boxes
from ortilo_drake.onboard.landmarks.landmark_fix import METHODS, LandmarkFix
from ortilo_drake.scenario import Camera as CameraSettings
from ortilo_drake.scenario import LandmarkFix as Settings
from ortilo_drake.scenario.camera import ParametricErrors
from ortilo_drake.world.sensors.projected_camera import camera_box

POSITION = [0, 1, 2]
SEEN_BY = {"known_tilt": [0, 1, 2, 5], "pose": [0, 1, 2, 3, 4, 5]}  # what a fix gives of the pose
offsets = st.tuples(*[st.floats(-0.3, 0.3)] * 3)
angles = st.tuples(*[st.floats(-0.1, 0.1)] * 3)


@pytest.mark.family
@pytest.mark.parametrize("method", METHODS)
def test_noise_free_boxes_give_the_position(method):
    @settings(deadline=None, max_examples=40)
    @given(offsets, angles)
    def check(offset, rpy):
        pose = np.array([0.0, 0.0, 1.5, *rpy])
        xhat = state(pose)
        xhat[:3] += offset
        found, value, cov = solve(method, centers(pose), xhat)
        assert found
        np.testing.assert_allclose(value, pose[SEEN_BY.get(method, POSITION)], atol=1e-6)
        assert np.all(np.linalg.eigvalsh(cov) > 0.0)

    check()


@pytest.mark.long
def test_pnp_needs_no_attitude():
    xhat = state()
    xhat[3:6] += [0.02, -0.02, 0.05]
    found, p_WB, _ = solve("pnp", centers(EXACT), xhat)
    assert found
    np.testing.assert_allclose(p_WB, EXACT[:3], atol=1e-6)


FEWEST = {"known_attitude": 2, "known_tilt": 2, "pose": 2, "cosine_law": 3, "pnp": 4}


@pytest.mark.parametrize("method", EACH)
def test_fewest_landmarks(method):
    seen, fewest = SEEN_BY.get(method, POSITION), FEWEST[method]
    exact, m = np.array(EXACT)[seen], len(seen)
    for n in range(fewest):
        found, value, cov = solve(method, centers(EXACT)[:n], state(), slice(n))
        assert not found
        np.testing.assert_array_equal(value, exact)
        np.testing.assert_array_equal(cov, np.zeros((m, m)))
    found, value, _ = solve(method, centers(EXACT)[:fewest], state(), slice(fewest))
    assert found
    np.testing.assert_allclose(value, exact, atol=1e-6)


def runs(method: str, count: int, attitude_sd: float, sd: float = 1.0):
    """Errors (count, m) and squared Mahalanobis distances of fixes under noise."""
    rng, exact = np.random.default_rng(0), np.array(EXACT)[SEEN_BY.get(method, POSITION)]
    errors, nees = [], []
    for _ in range(count):
        xhat = state()
        xhat[:3] += rng.normal(0.0, 0.05, 3)
        xhat[3:6] += rng.normal(0.0, attitude_sd, 3)
        z = centers(EXACT) + rng.normal(0.0, sd, (len(POINTS), 2))
        P = covariance(angle_sd=max(attitude_sd, 1e-12))
        found, value, cov = solve(method, z, xhat, P=P, sd=sd, max_residual=8.0)
        assert found
        errors.append(value - exact)
        nees.append(errors[-1] @ np.linalg.solve(cov, errors[-1]))
    return np.array(errors), np.array(nees)


@pytest.mark.long
def test_known_attitude_reaches_the_cramer_rao_bound():
    errors, _ = runs("known_attitude", 2000, attitude_sd=0.0)
    J = jacobian(np.array(EXACT))[:, :3]
    bound = np.linalg.inv(J.T @ J)
    # chi-square of 2000 samples: the ratio of variances is within 1 +- 4 sqrt(2 / 2000).
    np.testing.assert_allclose(np.diag(np.cov(errors.T)) / np.diag(bound), 1.0, atol=0.13)
    assert np.all(np.abs(errors.mean(axis=0)) < 4.0 * np.sqrt(np.diag(bound) / 2000.0))


@pytest.mark.long
@pytest.mark.parametrize("method", ["cosine_law", "pnp"])
def test_methods_without_attitude_against_their_cramer_rao_bound(method):
    """The bound for an unknown attitude; least squares on the pixels reaches it, the law of cosines comes near."""
    errors, _ = runs(method, 500, attitude_sd=0.0, sd=0.5)
    J = jacobian(np.array(EXACT))
    bound = 0.25 * np.diag(np.linalg.inv(J.T @ J))[:3]
    ratio = np.mean(errors**2, axis=0) / bound
    assert np.all(ratio > 1.0 - 4.0 * np.sqrt(2.0 / 500.0))
    assert np.all(ratio < (1.0 + 4.0 * np.sqrt(2.0 / 500.0) if method == "pnp" else 4.0)), ratio


@pytest.mark.family
@pytest.mark.parametrize("method", METHODS)
def test_covariance_is_honest(method):
    """Mean squared Mahalanobis distance of the error, its chi-square band of 99.9 %."""
    count, m = 2000 if method == "known_attitude" else 500, len(SEEN_BY.get(method, POSITION))
    _, nees = runs(method, count, ATTITUDE_SD, sd=0.7)
    low, high = stats.chi2.ppf([0.0005, 0.9995], m * count) / count
    assert low < nees.mean() < high


def test_the_attitude_error_is_part_of_the_covariance():
    """Without noise of the boxes the whole error comes from the attitude: cov = G P_a G^T."""
    J = jacobian(np.array(EXACT))
    G = np.linalg.solve(J[:, :3].T @ J[:, :3], J[:, :3].T @ J[:, 3:])
    found, _, cov = solve("known_attitude", centers(EXACT), state(), sd=1e-6)
    assert found
    # At a corner's kink the differences differ: compare as matrices.
    expected = ATTITUDE_SD**2 * G @ G.T
    assert np.linalg.norm(cov - expected) < 1e-4 * np.linalg.norm(expected)


@pytest.mark.parametrize("bad", range(len(POINTS)))
def test_an_outlier_is_dropped(bad):
    rng = np.random.default_rng(bad)
    z = centers(EXACT) + rng.normal(0.0, 0.5, (len(POINTS), 2))
    others = np.delete(np.arange(len(POINTS)), bad)
    expected = solve("known_attitude", z[others], state(), others)
    z[bad] += [20.0, -15.0]
    found, p_WB, cov = solve("known_attitude", z, state())
    assert found
    np.testing.assert_allclose(p_WB, expected[1], atol=1e-6)
    np.testing.assert_allclose(cov, expected[2], atol=1e-9)


@pytest.mark.long
def test_pnp_repeats_itself_and_drops_an_outlier():
    z = centers(EXACT) + np.random.default_rng(1).normal(0.0, 0.3, (len(POINTS), 2))
    z[4] += [30.0, 0.0]
    first = solve("pnp", z, state())
    cv2.setRNGSeed(12345)
    second = solve("pnp", z, state())
    assert first[0]
    assert second[0]
    assert first[1].tolist() == second[1].tolist()
    assert first[2].tolist() == second[2].tolist()
    others = np.array([0, 1, 2, 3, 5, 6])
    clean = solve("pnp", z[others], state(), others)
    np.testing.assert_allclose(first[1], clean[1], atol=1e-6)


@pytest.mark.parametrize("method", EACH)
def test_boxes_of_twice_the_noise_give_four_times_the_covariance(method):
    """With the attitude known, where it counts."""
    P = covariance(angle_sd=1e-9)
    once, twice = (solve(method, centers(EXACT), state(), P=P, sd=sd)[2] for sd in (0.005, 0.01))
    np.testing.assert_allclose(twice, 4.0 * once, rtol=1e-4, atol=1e-4 * np.abs(twice).max())


@pytest.mark.long
def test_two_boxes_do_not_tell_a_pose():
    xhat = state()
    seen = centers(EXACT)[:2], POINTS[:2], OUTLINES[:2]
    found, pose, cov, _ = pose_from_boxes(*seen, xhat, covariance(), CAMERA, np.ones((2, 2)), np.inf, 6, np.inf)
    assert not found
    np.testing.assert_array_equal(pose, EXACT)
    np.testing.assert_array_equal(cov, np.zeros((6, 6)))


@pytest.mark.long
def test_a_start_without_numbers_is_no_fix():
    """OpenCV's RANSAC may return NaN as found, as it does for some sets of four boxes that fit no pose."""
    seen, start = (centers(EXACT), POINTS, OUTLINES), np.array([np.nan] * 3 + [0.0] * 3)
    assert not pose_from_boxes(*seen, start, covariance(), CAMERA, np.ones((7, 2)), np.inf, 6, np.inf)[0]


def test_one_landmark_seen_twice_gives_no_position():
    """Two boxes of one point in space tell the direction, not the distance."""
    twice = np.array([4, 4])
    assert not solve("known_attitude", centers(EXACT)[twice], state(), twice)[0]


def detections(pose, shown, arrived: float = 1.0) -> np.ndarray:
    message = np.zeros(DETECTIONS_SIZE)
    message[0], message[1] = arrived, 7.5
    message[PAYLOAD::DETECTION_SIZE] = -1.0
    box = boxes(pose, ROOM.landmark_positions[shown], ROOM.landmark_outlines[shown]) if shown else []
    for row, (i, edges) in enumerate(zip(shown, box, strict=True)):
        message[PAYLOAD + 6 * row : PAYLOAD + 6 * row + 6] = [ROOM.landmark_labels[i], 0.9, *edges]
    return message


def fix(message, xhat, P, chosen: Settings) -> np.ndarray:
    if chosen.method in ELEMENTS:
        return PlayedBox(camera_fix_box(chosen, ROOM, 320)).say(message=message, belief=np.concatenate([xhat, P]))
    system = LandmarkFix(chosen, ROOM, 320, 1.0 / 30.0)
    context = system.CreateDefaultContext()
    system.GetInputPort("detections").FixValue(context, message)
    system.GetInputPort("estimate").FixValue(context, xhat)
    system.GetInputPort("covariance").FixValue(context, P)
    return system.GetOutputPort("fix").Eval(context)


SHOWN = [0, 2, 4, 6, 8, 9]  # in the image, whole, from EXACT


@pytest.mark.family
@pytest.mark.parametrize("method", METHODS)
def test_system_turns_boxes_into_a_stamped_fix(method):
    xhat = state()
    xhat[:3] += [0.1, -0.1, 0.05]
    message = fix(detections(EXACT, shown=SHOWN), xhat, covariance(), Settings(method=method))
    m = len(SEEN_BY.get(method, POSITION))
    assert message.shape == (PAYLOAD + m + m * m,)
    assert message[0] == 1.0
    assert message[1] == 7.5
    np.testing.assert_allclose(message[2 : 2 + m], np.array(EXACT)[SEEN_BY.get(method, POSITION)], atol=1e-6)
    cov = message[2 + m :].reshape(m, m)
    np.testing.assert_allclose(cov, cov.T, rtol=1e-6)
    assert np.all(np.linalg.eigvalsh(cov) > 0.0)


@pytest.mark.parametrize("method", EACH)
def test_system_without_enough_is_no_fix(method):
    chosen, m = Settings(method=method), len(SEEN_BY.get(method, POSITION))
    nothing = [0.0] * (PAYLOAD + m + m * m)
    assert fix(detections(EXACT, shown=SHOWN, arrived=0.0), state(), covariance(), chosen).tolist() == nothing
    assert fix(detections(EXACT, shown=[]), state(), covariance(), chosen).tolist() == nothing
    assert fix(detections(EXACT, shown=[4]), state(), covariance(), chosen).tolist() == nothing
    # The clock and the bicycle below it, seen from afar: nearly one direction, the distance unknown.
    far = (0.5, 1.28, 1.5, 0.0, 0.0, 0.0)
    chosen = Settings(method=method, center_sd=5.0)
    assert fix(detections(far, shown=[10, 13]), state(far), covariance(), chosen).tolist() == nothing


def test_a_prior_sd_stands_in_for_the_covariance():
    xhat, wide = state(), covariance(10.0, 1.0)
    message = detections(EXACT, shown=SHOWN)
    given_prior = fix(message, xhat, wide, Settings(prior_sd=(0.1, ATTITUDE_SD)))
    from_filter = fix(message, xhat, covariance(0.1, ATTITUDE_SD), Settings())
    assert given_prior[0] == 1.0
    assert given_prior.tolist() == from_filter.tolist()


def test_camera_and_fix_together_along_the_first_blackout():
    """Normal errors, false boxes and misses included: a fix in nearly every image, and its covariance holds."""
    errors = ParametricErrors(kind="parametric")
    camera = PlayedBox(camera_box(CameraSettings(errors=errors), ROOM, (), 1.0 / 30.0), seed=3)
    landmark_fix = PlayedBox(camera_fix_box(Settings(center_sd=errors.edge_sd / np.sqrt(2.0)), ROOM, 320))
    rng = np.random.default_rng(2)
    nees = []
    for tick, x in enumerate(np.linspace(1.5, 5.5, 300)):
        truth = state((x, 0.25 * x, 1.5, *rng.normal(0.0, 0.02, 3)))
        xhat = truth.copy()
        xhat[:3] += rng.normal(0.0, 0.1, 3)
        xhat[3:6] += rng.normal(0.0, ATTITUDE_SD, 3)
        message = camera.say(tick, sent=np.zeros(1), state=truth[:12])
        answer = landmark_fix.say(tick, message=message, belief=np.concatenate([xhat, covariance()]))
        if answer[0] == 1.0:
            e = answer[2:5] - truth[:3]
            nees.append(e @ np.linalg.solve(answer[5:].reshape(3, 3), e))
    assert len(nees) > 0.95 * 300
    low, high = stats.chi2.ppf([0.0005, 0.9995], 3 * len(nees)) / len(nees)
    assert low < np.mean(nees) < high


@pytest.mark.parametrize("method", EACH)
def test_an_estimate_that_has_diverged_is_no_fix_and_no_error(method):
    m = len(SEEN_BY.get(method, POSITION))
    message, nothing = detections(EXACT, shown=SHOWN), [0.0] * (PAYLOAD + m + m * m)
    for wrong in (np.inf, np.nan):
        assert fix(message, state(), np.full_like(covariance(), wrong), Settings(method=method)).tolist() == nothing
    for wrong in (1e7, 1e200, np.inf, np.nan):
        xhat = state()
        xhat[0] = wrong
        assert fix(message, xhat, covariance(), Settings(method=method)).tolist() == nothing
