"""A picture through a lens that bends: what is drawn lies where OpenCV projects it."""

import cv2
import numpy as np
import pytest
from pydrake.geometry import Box, Rgba, SceneGraph
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import ImageRgba8U

from ortilo_drake.model.room import CameraModel, load_room
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.world.scenery.bent_picture import BentPicture, straight_model, straight_places
from ortilo_drake.world.scenery.rendering import camera_in_body, make_scene_graph, render_cameras
from ortilo_drake.world.scenery.scene import NO_LANDMARK, SceneItem

LENSES = {"brown_conrady": (-0.2, 0.04, 0.002, -0.001), "fisheye": (-0.012, 0.031, -0.034, 0.011)}
ASPECT = 0.97


def camera_of(distortion: str, **changes: object) -> CameraModel:
    its = {"aspect": ASPECT, "distortion": distortion, "coefficients": LENSES[distortion]}
    return validate(CameraModel, load_room().camera.scaled_to(320).model_dump() | its | changes, "camera")


@pytest.mark.long
@pytest.mark.egl
@pytest.mark.parametrize("distortion", LENSES)
def test_a_block_is_seen_where_opencv_projects_its_edges(distortion: str) -> None:
    camera = camera_of(distortion)
    size, X_WG = np.array([0.9, 1.2, 0.8]), RigidTransform(RollPitchYaw(0.1, 0.2, 0.6), [2.4, 0.9, 1.9])
    red = SceneItem("furniture", "block", Box(*size), X_WG, NO_LANDMARK, Rgba(0.9, 0.0, 0.0, 1.0))
    graph = make_scene_graph([red], background=(0.0, 0.0, 1.0))
    query = graph.get_query_output_port().Eval(graph.CreateDefaultContext())
    X_WC = RigidTransform(RollPitchYaw(0.05, 0.04, -0.03), [0.2, -0.1, 1.5]) @ camera_in_body(camera)
    straight = query.RenderColorImage(render_cameras(straight_model(camera))[0], SceneGraph.world_frame_id(), X_WC)
    bends = BentPicture(camera, ImageRgba8U, 0)
    context = bends.CreateDefaultContext()
    bends.get_input_port().FixValue(context, straight)
    shown = bends.get_output_port().Eval(context).data[..., 2].astype(int) < 128
    corners = size / 2 * np.array([[a, b, c] for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)])
    seen = (X_WC.inverse() @ X_WG) @ corners.T
    hull = cv2.convexHull((seen[:2] / seen[2]).T.astype(np.float32))[:, 0].astype(float)
    edges = np.vstack(
        [a + np.linspace(0.0, 1.0, 60)[:, None] * (b - a) for a, b in zip(hull, np.roll(hull, -1, 0), strict=True)]
    )
    rays, k, zero = np.column_stack([edges, np.ones(len(edges))]), np.array(LENSES[distortion]), np.zeros(3)
    f, c = camera.focal_length, camera.center
    K = np.array([[f, 0.0, c[0]], [0.0, ASPECT * f, c[1]], [0.0, 0.0, 1.0]])
    if distortion == "fisheye":
        pixels = cv2.fisheye.projectPoints(rays[:, None], zero, zero, K, k)[0]
    else:
        pixels = cv2.projectPoints(rays, zero, zero, K, k)[0]
    outline = pixels.reshape(-1, 1, 2).astype(np.float32)
    inside = np.array(
        [[cv2.pointPolygonTest(outline, (u, v), True) for u in range(camera.width)] for v in range(camera.height)]
    )
    clear = (np.abs(inside) > 0.75) & (straight_places(camera)[0] > 0.0)  # between pixels colours blend
    np.testing.assert_array_equal(shown[clear], inside[clear] > 0)
    assert 1000 < shown[clear].sum() < 0.6 * shown.size


def test_a_lens_that_looks_too_far_aside_is_not_drawn() -> None:
    straight_model(camera_of("fisheye"))
    with pytest.raises(InputError, match=r"^coefficients: .*look so far aside.* camera\.kind projected"):
        straight_model(camera_of("fisheye", focal_length=80.0, coefficients=(0.0, 0.0, 0.0, 0.0)))
