"""The steps of the law-of-cosines fix against geometry and finite differences; the whole is in test_landmark_fix.py."""

import numpy as np
import pytest
from seen_landmarks import CAMERA, POINTS

from ortilo_drake.onboard.landmarks.cosine_law import distances_from_cosines, rays, trilaterate

pytestmark = pytest.mark.long  # it is compiled for itself alone
P_WC = np.array([0.1, -0.2, 1.4])


def seen_from(p: np.ndarray, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors to the first landmarks (n, 3) and their distances (n)."""
    away = POINTS[:n] - p
    d = np.linalg.norm(away, axis=1)
    return away / d[:, None], d


def test_a_ray_is_the_unit_vector_to_its_pixel_and_its_derivative_a_difference() -> None:
    pixels = np.array([[12.0, 200.0], [160.0, 119.0], [300.5, 3.0]])
    b, db = rays(pixels, CAMERA)
    np.testing.assert_allclose(np.linalg.norm(b, axis=1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(CAMERA.c - CAMERA.f * b[:, 1:] / b[:, :1], pixels, rtol=1e-12)
    for axis, step in enumerate(1e-4 * np.eye(2)):
        change = rays(pixels + step, CAMERA)[0] - rays(pixels - step, CAMERA)[0]
        np.testing.assert_allclose(db[:, :, axis], change / 2e-4, rtol=1e-6, atol=1e-10)


@pytest.mark.parametrize("n", [3, 5])
@pytest.mark.parametrize("seed", range(4))
def test_distances_follow_from_the_angles_between_rays(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    b, expected = seen_from(P_WC, n)
    converged, d, A = distances_from_cosines(b, POINTS[:n], expected + rng.uniform(-0.3, 0.3, n))
    assert converged
    np.testing.assert_allclose(d, expected, rtol=1e-9)
    pairs = [(i, j) for i in range(n) for j in range(i)]
    assert A.shape == (len(pairs), n)
    # From angles that fit an eye a little aside follow the distances seen from there.
    aside, there = seen_from(P_WC + 1e-6 * rng.normal(size=3), n)
    change = np.array([aside[i] @ aside[j] - b[i] @ b[j] for i, j in pairs])
    np.testing.assert_allclose(np.linalg.pinv(A) @ change, there - expected, rtol=1e-4, atol=1e-10)


def test_distances_that_cannot_be_are_not_found() -> None:
    """Two rays that are one, of landmarks that are two."""
    b, d = seen_from(P_WC, 4)
    b[1] = b[0]
    assert not distances_from_cosines(b[:2], POINTS[:2], d[:2])[0]


@pytest.mark.parametrize("n", [3, 4, 7])
@pytest.mark.parametrize("seed", range(4))
def test_the_point_at_given_distances_is_found_on_the_starts_side(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    _, d = seen_from(P_WC, n)
    converged, p, M = trilaterate(d, POINTS[:n], P_WC + rng.uniform(-0.5, 0.5, 3))
    assert converged
    np.testing.assert_allclose(p, P_WC, atol=1e-9)
    aside = 1e-6 * rng.normal(size=3)
    np.testing.assert_allclose(M @ (seen_from(P_WC + aside, n)[1] - d), aside, rtol=1e-4, atol=1e-10)
    if n == 3:  # three landmarks span a plane; the mirror image has the same distances
        normal = np.cross(POINTS[1] - POINTS[0], POINTS[2] - POINTS[0])
        normal /= np.linalg.norm(normal)
        mirrored = P_WC - 2.0 * ((P_WC - POINTS[0]) @ normal) * normal
        converged, p, _ = trilaterate(d, POINTS[:3], mirrored + rng.uniform(-0.3, 0.3, 3))
        assert converged
        np.testing.assert_allclose(p, mirrored, atol=1e-9)


def test_landmarks_on_one_line_leave_the_point_open() -> None:
    line = np.array([[4.0, 0.0, 1.0], [5.0, 0.0, 1.0], [7.0, 0.0, 1.0]])
    start = np.array([0.0, 1.0, 1.0])
    converged, _, M = trilaterate(np.linalg.norm(line - start, axis=1), line, start)
    assert not converged
    np.testing.assert_array_equal(M, np.zeros((3, 3)))
