"""Fixes by a camera whose lens bends: every method finds the pose that OpenCV's pixels come from."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from seen_landmarks import COSINES, EACH, EXACT, OUTLINES, PNP, POINTS, ROOM, covariance, state

from ortilo_drake.model.pinhole import R_BC, Camera
from ortilo_drake.model.room import CameraModel, validate
from ortilo_drake.onboard.landmarks.cosine_law import rays
from ortilo_drake.onboard.landmarks.landmark_fix import METHODS

LENSES = {
    "brown_conrady": (-0.29, 0.09, 0.0012, -0.0007, -0.011),
    "fisheye": (-0.012, 0.031, -0.034, 0.011),
}
DOTS = np.zeros((len(POINTS), 1, 3))  # an outline of one point has no kinks
each_lens = pytest.mark.parametrize("distortion", LENSES)


def camera_of(distortion: str) -> Camera:
    changes = {"aspect": 0.97, "distortion": distortion, "coefficients": LENSES[distortion]}
    return validate(CameraModel, ROOM.camera.scaled_to(320).model_dump() | changes, "camera").constants


def opencv_centers(distortion: str, pose: np.ndarray, outlines: np.ndarray = OUTLINES) -> np.ndarray:
    camera = camera_of(distortion)
    R_WB = Rotation.from_euler("ZYX", [pose[5], pose[4], pose[3]]).as_matrix()
    p_WC, R_CW = np.asarray(pose[:3]) + R_WB @ camera.p_BC, (R_WB @ R_BC).T
    seen = ((POINTS[:, None] + outlines).reshape(-1, 3) - p_WC) @ R_CW.T
    K = np.array([[camera.f, 0.0, camera.c[0]], [0.0, 0.97 * camera.f, camera.c[1]], [0.0, 0.0, 1.0]])
    k, nothing = np.array(LENSES[distortion]), np.zeros(3)
    if distortion == "fisheye":
        uv = cv2.fisheye.projectPoints(seen[:, None], nothing, nothing, K, k)[0]
    else:
        uv = cv2.projectPoints(seen, nothing, nothing, K, k)[0]
    uv = uv.reshape(len(POINTS), -1, 2)
    return 0.5 * (uv.min(axis=1) + uv.max(axis=1))


def solve(method: str, distortion: str, z: np.ndarray, xhat: np.ndarray, outlines: np.ndarray, sd: float = 1.0):
    sds = np.full((len(POINTS), 2), sd)
    return METHODS[method](z, POINTS, outlines, xhat, covariance(), camera_of(distortion), sds, 4.0)


@each_lens
@pytest.mark.parametrize("method", EACH)
def test_the_pose_is_found_again(method: str, distortion: str) -> None:
    aside = np.array([0.05, -0.04, 0.03, 0.0, 0.0, 0.0])
    outlines = DOTS if method in ("cosine_law", "pnp") else OUTLINES  # a centre's offset is taken at the start else
    found, value, _ = solve(
        method, distortion, opencv_centers(distortion, EXACT, outlines), state(EXACT + aside), outlines
    )
    expected = {3: EXACT[:3], 4: (*EXACT[:3], EXACT[5]), 6: EXACT}[len(value)]
    assert found
    # Of the whole pose the filter's angles, right here, hold a little.
    np.testing.assert_allclose(value, expected, atol=1e-6)


@pytest.mark.long
@each_lens
def test_the_covariance_of_the_cosine_law_is_that_of_moved_pixels(distortion: str) -> None:
    z, sd, h = opencv_centers(distortion, EXACT, DOTS), 0.7, 1e-3
    columns = []
    for k in range(z.size):
        step = np.zeros(z.size)
        step[k] = h
        ahead, back = (
            solve("cosine_law", distortion, z + s * step.reshape(z.shape), state(), DOTS)[1] for s in (1.0, -1.0)
        )
        columns.append((ahead - back) / (2.0 * h))
    M = np.array(columns).T
    cov = solve("cosine_law", distortion, z, state(), DOTS, sd)[2]
    np.testing.assert_allclose(cov, sd**2 * M @ M.T, rtol=1e-4, atol=1e-5 * cov.max())


@each_lens
@pytest.mark.parametrize(
    ("method", "columns"),
    [("known_attitude", [0, 1, 2]), pytest.param("pnp", [0, 1, 2, 3, 4, 5], marks=pytest.mark.long)],
)
def test_the_covariance_of_the_others_follows_opencvs_jacobian(
    method: str, columns: list[int], distortion: str
) -> None:
    h, sd = 1e-6, 0.7
    J = np.array(
        [(opencv_centers(distortion, EXACT + d, DOTS) - opencv_centers(distortion, EXACT - d, DOTS)).ravel() / (2 * h)
         for d in h * np.eye(6)]
    ).T  # fmt: skip
    N_inverse = np.linalg.inv(J[:, columns].T @ J[:, columns])
    expected = sd**2 * N_inverse
    if method == "known_attitude":
        G = N_inverse @ J[:, :3].T @ J[:, 3:]
        expected += G @ covariance().reshape(15, 15)[3:6, 3:6] @ G.T
    cov = solve(method, distortion, opencv_centers(distortion, EXACT, DOTS), state(), DOTS, sd)[2]
    np.testing.assert_allclose(cov, expected[:3, :3], rtol=1e-5, atol=1e-6 * cov.max())


@pytest.mark.long
@each_lens
def test_a_ray_goes_where_opencvs_straightened_pixel_lies_and_its_derivative_is_a_difference(distortion: str) -> None:
    camera = camera_of(distortion)
    pixels = np.array([[12.0, 200.0], [160.0, 119.0], [270.5, 40.0]])
    K = np.array([[camera.f, 0.0, camera.c[0]], [0.0, 0.97 * camera.f, camera.c[1]], [0.0, 0.0, 1.0]])
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-13)
    undistort = cv2.fisheye.undistortPoints if distortion == "fisheye" else cv2.undistortPoints
    straight = undistort(pixels[:, None], K, np.array(LENSES[distortion]), criteria=until)[:, 0]
    b, db = rays(pixels, camera)
    np.testing.assert_allclose(np.linalg.norm(b, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(-b[:, 1:] / b[:, :1], straight, atol=1e-9)
    for axis, step in enumerate(1e-3 * np.eye(2)):
        change = rays(pixels + step, camera)[0] - rays(pixels - step, camera)[0]
        np.testing.assert_allclose(db[:, :, axis], change / 2e-3, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("method", [COSINES, PNP])
def test_a_pixel_without_a_ray_gives_no_fix(method: str) -> None:
    """Beyond the circle that a fisheye draws on the sensor."""
    z = opencv_centers("fisheye", EXACT, DOTS)
    z[0] = [3.0e5, 2.0e5]
    assert not solve(method, "fisheye", z, state(), DOTS)[0]
