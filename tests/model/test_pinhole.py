"""Where the pinhole camera sees nothing; tests/world/test_projected_camera.py has what it sees, against OpenCV."""

import numpy as np
import pytest

from ortilo_drake.model.pinhole import NEAR, box_center, extent_box, point_pixels, project
from ortilo_drake.model.room import load_room

CAMERA = load_room().camera.constants
OUTLINE = np.array([[0.0, 0.0, 0.0], [-0.5, 0.2, 0.1]])  # its second point is half a metre nearer


@pytest.mark.parametrize(
    ("depth", "seen"), [(1.001 * NEAR, True), (0.999 * NEAR, False), (-1.0, False), (np.nan, False)]
)
def test_an_outline_has_a_box_if_its_nearest_point_has_a_projection(depth: float, seen: bool) -> None:
    p_WL = CAMERA.p_BC + [depth + 0.5, 0.3, -0.2]
    box, z, J = np.empty(4), np.empty(2), np.empty((2, 6))
    assert extent_box(p_WL, OUTLINE, np.zeros(3), np.eye(3), CAMERA, box) == seen
    assert box_center(p_WL, OUTLINE, np.zeros(3), np.zeros(3), np.eye(3), CAMERA, z, J) == seen
    pixels = point_pixels(np.array([[10.0, 20.0]]), p_WL[None], OUTLINE[None], np.zeros(3), np.eye(3), CAMERA)
    assert np.isfinite(pixels).all() == seen
    u, v, _ = project(p_WL + OUTLINE[1], np.zeros(3), np.eye(3), CAMERA)
    assert (np.isfinite(u) and np.isfinite(v)) == seen
