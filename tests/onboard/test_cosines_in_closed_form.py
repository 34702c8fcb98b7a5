"""The law of cosines and the trilateration where the answer has a formula, uncompiled; test_cosine_law.py compiles."""

import numpy as np
import pytest

from ortilo_drake.onboard.landmarks.cosine_law import distances_from_cosines, trilaterate

SIDE = 3.0  # of a triangle of equal sides [m]
CORNERS = SIDE * np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, np.sqrt(0.75), 0.0]])  # p_W [m]


@pytest.mark.parametrize("height", [0.8, 2.5])
def test_an_eye_above_the_middle_is_as_far_from_each_corner_as_the_angle_says(height: float) -> None:
    """All three angles have one cosine c, and d = side / sqrt(2 - 2 c)."""
    away = CORNERS - [SIDE / 2.0, SIDE / np.sqrt(12.0), height]
    b = away / np.linalg.norm(away, axis=1)[:, np.newaxis]
    converged, d, _ = distances_from_cosines.py_func(b, CORNERS, np.array([2.2, 2.5, 2.8]))
    assert converged
    np.testing.assert_allclose(d, SIDE / np.sqrt(2.0 - 2.0 * (b[0] @ b[1])), rtol=1e-12)


@pytest.mark.parametrize("side_of_plane", [1.0, -1.0])
def test_the_point_at_three_distances_is_where_the_three_spheres_meet(side_of_plane: float) -> None:
    d = np.array([2.0, 2.5, 2.25])
    x = (d[0] ** 2 - d[1] ** 2 + SIDE**2) / (2.0 * SIDE)
    (i, j), far2 = CORNERS[2, :2], CORNERS[2] @ CORNERS[2]
    y = (d[0] ** 2 - d[2] ** 2 + far2 - 2.0 * i * x) / (2.0 * j)
    expected = np.array([x, y, side_of_plane * np.sqrt(d[0] ** 2 - x**2 - y**2)])
    start = np.array([1.5, 1.0, side_of_plane])
    converged, p, M = trilaterate.py_func(d, CORNERS, start)
    assert converged
    np.testing.assert_allclose(p, expected, rtol=1e-12)
    away = expected - CORNERS
    np.testing.assert_allclose(M @ (away / d[:, np.newaxis]), np.eye(3), atol=1e-9)  # of inverse derivatives
