"""Lenses that bend, against OpenCV; what turns back, and what is straightened again."""

from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ortilo_drake.model import pinhole
from ortilo_drake.model.lens import bent, make_lens, straightened, turning_point
from ortilo_drake.model.room import CameraModel
from ortilo_drake.model.typed_yaml import InputError, validate

SIZE = {"width": 752, "height": 480}
F_U, F_V, C = 458.654, 457.296, (367.215, 248.375)
RADTAN = (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05)  # of a camera of the EuRoC recordings
LENSES: dict[str, tuple[str, tuple[float, ...]]] = {
    "4": ("brown_conrady", RADTAN),
    "5": ("brown_conrady", (-0.31, 0.12, -0.001, 0.0007, -0.02)),
    "8": ("brown_conrady", (0.42, -0.11, 0.001, -0.0008, 0.012, 0.71, -0.13, 0.01)),
    "pincushion": ("brown_conrady", (0.11, 0.02, 0.003, -0.002)),
    "fisheye": ("fisheye", (-0.012, 0.031, -0.034, 0.011)),
}
each_lens = pytest.mark.parametrize("name", LENSES)


def model(name: str, **changes: Any) -> CameraModel:
    distortion, coefficients = LENSES[name]
    data = SIZE | {"focal_length": F_U, "aspect": F_V / F_U, "center": C, "position": (0.05, -0.01, 0.04)}
    return validate(CameraModel, data | {"distortion": distortion, "coefficients": coefficients} | changes, "camera")


K = np.array([[F_U, 0.0, C[0]], [0.0, F_V, C[1]], [0.0, 0.0, 1.0]])


def opencv_pixels(name: str, points_C: np.ndarray) -> np.ndarray:
    """Pixels of points in C (n, 3), by OpenCV."""
    distortion, k = LENSES[name]
    if distortion == "fisheye":
        return cv2.fisheye.projectPoints(points_C[:, None], np.zeros(3), np.zeros(3), K, np.array(k))[0][:, 0]
    return cv2.projectPoints(points_C, np.zeros(3), np.zeros(3), K, np.array(k))[0][:, 0]


def poses(n: int, seed: int = 0) -> Any:
    """Yield positions, attitudes (rpy, R_WB) and points in W that are in or near the picture."""
    rng = np.random.default_rng(seed)
    for _ in range(n):
        rpy, p_WB = rng.uniform(-0.4, 0.4, 3), rng.uniform(-3.0, 3.0, 3)
        R_WB = Rotation.from_euler("ZYX", rpy[::-1]).as_matrix()
        q = rng.uniform(0.5, 8.0) * np.array([1.0, *rng.uniform([-0.8, -0.5], [0.8, 0.5])])
        yield p_WB, rpy, R_WB, q


@each_lens
def test_projection_is_opencvs(name: str) -> None:
    camera, worst = model(name).constants, 0.0
    for p_WB, _, R_WB, q in poses(300):
        u, v, depth = pinhole.project(p_WB + R_WB @ (q + camera.p_BC), p_WB, R_WB, camera)
        expected = opencv_pixels(name, (pinhole.R_BC.T @ q)[None])[0]
        worst = max(worst, float(np.abs(expected - [u, v]).max()))
        assert depth == pytest.approx(q[0], rel=1e-9)
    assert worst < 1e-9


@pytest.mark.family
@each_lens
def test_a_boxs_centre_and_its_jacobian_are_opencvs(name: str) -> None:
    """An outline's box by OpenCV's pixels, and its centre's derivative by their central differences."""
    camera, worst = model(name).constants, 0.0
    corner = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.15, 0.15) for z in (-0.2, 0.2)])
    box, z, J = np.empty(4), np.empty(2), np.empty((2, 6))

    def center(pose: np.ndarray, p_WL: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        R = Rotation.from_euler("ZYX", pose[[5, 4, 3]]).as_matrix()
        uv = opencv_pixels(name, ((p_WL + corner - pose[:3]) @ R - camera.p_BC) @ pinhole.R_BC)
        order = np.sort(uv, axis=0)
        gap = min((order[1] - order[0]).min(), (order[-1] - order[-2]).min())
        return 0.5 * (uv.min(axis=0) + uv.max(axis=0)), gap

    for p_WB, rpy, R_WB, q in poses(60, 1):
        p_WL, pose = p_WB + R_WB @ (q * 2.0 + camera.p_BC), np.concatenate([p_WB, rpy])
        expected, gap = center(pose, p_WL)
        assert pinhole.extent_box(p_WL, corner, p_WB, R_WB, camera, box)
        assert pinhole.box_center(p_WL, corner, p_WB, rpy, R_WB, camera, z, J)
        np.testing.assert_allclose(0.5 * (box[:2] + box[2:]), expected, atol=1e-9)
        np.testing.assert_allclose(z, expected, atol=1e-9)
        if gap < 1e-2:  # another point is about to become the outermost
            continue
        h = 1e-6
        slope = np.array([(center(pose + d, p_WL)[0] - center(pose - d, p_WL)[0]) / (2 * h) for d in h * np.eye(6)]).T
        worst = max(worst, float(np.abs(J - slope).max() / np.abs(J).max()))
    assert 0.0 < worst < 1e-6


@each_lens
def test_a_straightened_pixel_is_opencvs(name: str) -> None:
    """OpenCV's own iteration, let run until it stands still."""
    camera = model(name).constants
    u, v = np.meshgrid(np.linspace(0.0, 751.0, 24), np.linspace(0.0, 479.0, 16))
    pixels = np.column_stack([u.ravel(), v.ravel()])
    distortion, k = LENSES[name]
    until = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 500, 1e-13)
    if distortion == "fisheye":
        expected = cv2.fisheye.undistortPoints(pixels[:, None], K, np.array(k), criteria=until)[:, 0]
    else:
        expected = cv2.undistortPoints(pixels[:, None], K, np.array(k), criteria=until)[:, 0]
    found = (pinhole.straight_pixels(pixels, camera) - camera.c) / camera.f
    np.testing.assert_allclose(found, expected, atol=2e-9)
    # And it is what the lens moves to that pixel.
    again = np.array([bent(x, y, camera.lens.bend)[:2] for x, y in found])
    np.testing.assert_allclose(again * [F_U, F_V] + C, pixels, atol=1e-9)


@each_lens
def test_the_image_reaches_as_far_as_its_border(name: str) -> None:
    lens = model(name).constants.lens
    x, y = (np.abs([straightened(*(np.array(p) - C) / [F_U, F_V], lens)[i] for p in
                    [(-0.5, 240.0), (751.5, 240.0), (376.0, -0.5), (376.0, 479.5), (-0.5, -0.5), (751.5, 479.5)]]).max()
            for i in (0, 1))  # fmt: skip
    assert lens.reach[0] >= x
    assert lens.reach[1] >= y
    assert np.all(lens.reach < 1.3 * np.array([x, y]))


def test_what_lies_beyond_where_the_lens_turns_back_has_no_pixel() -> None:
    """With k1 < 0 alone r (1 + k1 r^2) is largest at r^2 = -1 / (3 k1): what is farther would come back."""
    camera = model("4", coefficients=(-0.3, 0.0, 0.0, 0.0)).constants
    assert camera.lens.farthest == pytest.approx(1.0 / 0.9)
    edge = np.sqrt(1.0 / 0.9)
    for share, seen in ((0.999, True), (1.001, False), (1.8, False)):
        q = np.array([2.0, 2.0 * share * edge, 0.0])
        pixel = pinhole.project(q + camera.p_BC, np.zeros(3), np.eye(3), camera)
        assert np.isfinite(pixel).all() == seen
        point = np.zeros((1, 3))
        assert pinhole.extent_box(q + camera.p_BC, point, np.zeros(3), np.eye(3), camera, np.empty(4)) == seen
    assert np.isnan(straightened(10.0, 0.0, camera.lens)).all()


@pytest.mark.parametrize(
    ("k", "reached", "beyond"),
    [((-0.2, 0.0, 0.0, 0.0), 0.8606, (0.8608, 1.0, 3.0)), ((-0.1, 0.0, 0.0, 0.0), 1.18, (1.184, 1.4))],
)
def test_a_pixel_beyond_what_a_fisheye_reaches_has_no_ray(k: tuple[float, ...], reached: float, beyond: Any) -> None:
    """With k1 < 0 alone theta (1 + k1 theta^2) is largest at theta^2 = -1 / (3 k1), or at the quarter turn."""
    most = min(np.sqrt(-1.0 / (3.0 * k[0])), 0.5 * np.pi)
    assert reached < most * (1.0 + k[0] * most**2) < beyond[0]
    lens, _ = make_lens(k, 1.0, 100.0, (159.5, 119.5), (320.0, 240.0))
    x, y = straightened(0.6 * reached, 0.8 * reached, lens)
    np.testing.assert_allclose(bent(x, y, lens.bend)[:2], (0.6 * reached, 0.8 * reached), atol=1e-9)
    for r in beyond:
        assert np.isnan(straightened(r, 0.0, lens)).all(), r


def test_a_fisheye_that_turns_back_within_half_of_the_way_to_a_side_is_no_good() -> None:
    """Of k1 = -0.35 the greatest radius is 0.651; half of the way to the picture's side is 0.8, a quarter 0.4."""
    for f, good in ((100.0, False), (200.0, True)):
        assert make_lens((-0.35, 0.0, 0.0, 0.0), 1.0, f, (159.5, 119.5), (320.0, 240.0))[1] == good


def test_the_turning_point_is_where_the_bent_radius_is_largest() -> None:
    for name in ("4", "5", "8", "fisheye"):
        bend = model(name).constants.lens.bend
        s = turning_point(bend)
        r = np.sqrt(s) if np.isfinite(s) else 50.0
        radial = bend.copy()
        if len(radial) == 8:
            radial[2:4] = 0.0
        radii = np.linspace(1e-3, 0.9999 * r, 2000)
        assert np.all(np.diff([bent(x, 0.0, radial)[0] for x in radii]) > 0.0)
        if np.isfinite(s):
            beyond = [bent(r * (1.0 + d), 0.0, radial)[0] for d in (0.0, 1e-3)]
            assert beyond[1] < beyond[0]


def test_a_straight_lens_has_no_bend_and_square_pixels_the_same_bits() -> None:
    """As before there were lenses: u = c_u - f q_y / q_x, and no more."""
    straight = model("4", aspect=1.0, distortion="none", coefficients=()).constants
    for p_WB, _, R_WB, q in poses(50, 2):
        p_WL = p_WB + R_WB @ (q + straight.p_BC)
        p_BL = np.array(pinhole.in_body_frame(*p_WL, p_WB, R_WB)) - straight.p_BC
        u, v, _ = pinhole.project(p_WL, p_WB, R_WB, straight)
        assert (u, v) == (C[0] - F_U * p_BL[1] / p_BL[0], C[1] - F_U * p_BL[2] / p_BL[0])
    pixels = np.array([[3.0, 4.0]])
    assert pinhole.straight_pixels(pixels, straight).tolist() == pixels.tolist()


@each_lens
def test_a_smaller_picture_is_the_same_lens(name: str) -> None:
    camera, half = model(name).constants, model(name).scaled_to(376).constants
    for p_WB, _, R_WB, q in poses(20, 3):
        p_WL = p_WB + R_WB @ (q + camera.p_BC)
        pixel, small = (np.array(pinhole.project(p_WL, p_WB, R_WB, its)[:2]) for its in (camera, half))
        np.testing.assert_allclose((pixel + 0.5) / 2.0, small + 0.5, atol=1e-9)


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"coefficients": (0.1,)}, r"coefficients: 1 of them: brown_conrady has 4 or 5 or 8"),
        ({"distortion": "fisheye", "coefficients": (0.1,) * 5}, r"coefficients: 5 of them: fisheye has 4"),
        ({"distortion": "none"}, r"coefficients: 4 of them: none has 0"),
        ({"coefficients": (-9.0, 0.0, 0.0, 0.0)}, r"coefficients: \[-9.0, 0.0, 0.0, 0.0\]: must not fold the picture"),
        ({"distortion": "barrel"}, r"distortion: 'barrel'"),
    ],
)
def test_a_lens_that_cannot_be_is_refused(changes: dict[str, Any], why: str) -> None:
    with pytest.raises(InputError, match=why):
        model("4", **changes)
