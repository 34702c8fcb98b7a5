"""Drake's VTK renderer for a room, without a screen."""

import ctypes
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    FrameId,
    FramePoseVector,
    GeometryInstance,
    LightParameter,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import CameraInfo, RgbdSensor

from ortilo_drake.model.pinhole import R_BC
from ortilo_drake.model.room import CameraModel
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.world.scenery.scene import SceneItem

_EGL_PLATFORM_DEVICE = 0x313F  # EGL_PLATFORM_DEVICE_EXT
RENDERER = "vtk"
NEAREST, FARTHEST = 0.05, 40.0  # distances between which the camera draws [m]
BACKGROUND = (0.78, 0.80, 0.82)  # colour where there is nothing: above the walls

# Three weak lamps far away, so that no side of a wall is black; every lamp costs time.
LAMPS = ((0.85, (1.0, 0.55, -0.9)), (0.65, (-1.0, 0.35, -0.5)), (0.70, (0.2, -1.0, -0.6)))


def lamp(intensity: float, direction: Sequence[float], color: Sequence[float] = (1.0, 1.0, 1.0)) -> LightParameter:
    """Return a lamp far away that shines in the given direction (3, in W)."""
    return LightParameter(
        type="directional", frame="world", direction=np.array(direction), intensity=intensity, color=Rgba(*color)
    )


def check_egl() -> None:
    """Check that a picture can be drawn without a screen; without this check the renderer would crash.

    InputError saying what to install.
    """
    if not _egl_works():
        raise InputError(
            "camera: 'rendered' draws with EGL, which is missing here or has no driver: install it (Debian, Ubuntu: "
            "apt-get install libegl1 libgl1-mesa-dri) or fly with --camera projected"
        )


@cache
def _egl_works() -> bool:
    """Return whether EGL starts on the first device that it lists, as the renderer does."""
    try:
        egl = ctypes.CDLL("libEGL.so.1")
    except OSError:
        return False
    pointer = ctypes.c_void_p
    egl.eglGetProcAddress.restype = pointer

    def function(name: bytes, *types: type) -> Callable[..., Any] | None:
        address = egl.eglGetProcAddress(name)
        return ctypes.CFUNCTYPE(*types)(address) if address else None

    query = function(b"eglQueryDevicesEXT", ctypes.c_uint, ctypes.c_int, pointer, pointer)
    display_of = function(b"eglGetPlatformDisplayEXT", pointer, ctypes.c_uint, pointer, pointer)
    device, count = pointer(), ctypes.c_int(0)
    if query is None or display_of is None:
        return False
    if not query(1, ctypes.byref(device), ctypes.byref(count)) or count.value == 0:
        return False
    display = display_of(_EGL_PLATFORM_DEVICE, device, None)
    egl.eglInitialize.argtypes = (pointer, pointer, pointer)
    return bool(display) and bool(egl.eglInitialize(display, None, None))


def make_scene_graph(
    items: Iterable[SceneItem], lamps: Sequence[LightParameter] | None = None, background: Sequence[float] = BACKGROUND
) -> SceneGraph:
    """Return a SceneGraph with a renderer in which the items stand; a landmark's label is its number.

    The lamps are LAMPS by default, which light the room in every flight; the background is the colour where there is
    nothing. InputError if EGL is missing.
    """
    check_egl()
    scene_graph = SceneGraph()
    parameters = RenderEngineVtkParams(
        backend="EGL", lights=list(lamps or [lamp(*its) for its in LAMPS]), default_clear_color=np.array(background)
    )
    scene_graph.AddRenderer(RENDERER, MakeRenderEngineVtk(parameters))
    source = scene_graph.RegisterSource("room")
    for k, item in enumerate(items):
        instance = GeometryInstance(item.X_WG, item.shape, f"{item.kind}/{k}")
        properties = PerceptionProperties()
        label = RenderLabel(item.landmark) if item.landmark >= 0 else RenderLabel.kDontCare
        properties.AddProperty("label", "id", label)
        if not isinstance(item.shape, Mesh):  # a mesh has its own colours
            properties.AddProperty("phong", "diffuse", item.rgba)
        instance.set_perception_properties(properties)
        scene_graph.RegisterAnchoredGeometry(source, instance)
    return scene_graph


def move_landmarks(scene_graph: SceneGraph, context: Context, positions: np.ndarray) -> None:
    """Move the landmarks of a scene to p_W (n, 3) [m] without turning them, in a context of the SceneGraph."""
    inspector = scene_graph.model_inspector()
    for geometry in inspector.GetAllGeometryIds():
        landmark = int(inspector.GetPerceptionProperties(geometry).GetProperty("label", "id"))
        if landmark < len(positions):
            source = next(s for s in inspector.GetAllSourceIds() if inspector.BelongsToSource(geometry, s))
            X_WG = RigidTransform(inspector.GetPoseInFrame(geometry).rotation(), positions[landmark])
            # SceneGraph.ChangeShape moves a geometry for queries but not in the picture.
            instance = GeometryInstance(X_WG, inspector.GetShape(geometry), f"landmark/{landmark}")
            instance.set_perception_properties(PerceptionProperties(inspector.GetPerceptionProperties(geometry)))
            scene_graph.RemoveGeometry(context, source, geometry)
            scene_graph.RegisterGeometry(context, source, inspector.world_frame_id(), instance)


def render_cameras(camera: CameraModel) -> tuple[ColorRenderCamera, DepthRenderCamera]:
    """Return Drake's colour (and label) and depth cameras of a camera model, with the same pixels in both."""
    # VTK counts from a pixel's edge, we from its centre: half a pixel, as a test against OpenCV shows.
    center = [c + 0.5 for c in camera.center]
    f_u, f_v = camera.focal_length, camera.focal_length * camera.aspect
    info = CameraInfo(camera.width, camera.height, f_u, f_v, *center)
    core = RenderCameraCore(RENDERER, info, ClippingRange(NEAREST, FARTHEST), RigidTransform())
    return ColorRenderCamera(core), DepthRenderCamera(core, DepthRange(NEAREST, FARTHEST))


def camera_in_body(camera: CameraModel) -> RigidTransform:
    """Return X_BC, the camera's pose on the vehicle."""
    return RigidTransform(RotationMatrix(R_BC), camera.position)


def mount_camera(
    sensor: RgbdSensor, context: Context, p_BC: np.ndarray, rpy: np.ndarray, focal_factor: float = 1.0
) -> None:
    """Set a camera's mounting and lens, in a context of its RgbdSensor.

    The camera is at p_BC on the vehicle (3) [m], turned from looking ahead by rpy (3) [rad]; focal_factor [1]
    multiplies its default focal length.
    """
    turned = RotationMatrix(RollPitchYaw(rpy)) @ RotationMatrix(R_BC) if np.any(rpy) else RotationMatrix(R_BC)
    sensor.SetX_PB(context, RigidTransform(turned, p_BC))
    if focal_factor == 1.0:
        return
    color, depth = sensor.default_color_render_camera(), sensor.default_depth_render_camera()
    i = color.core().intrinsics()
    f_u, f_v = focal_factor * i.focal_x(), focal_factor * i.focal_y()
    info = CameraInfo(i.width(), i.height(), f_u, f_v, i.center_x(), i.center_y())
    core = RenderCameraCore(RENDERER, info, ClippingRange(NEAREST, FARTHEST), RigidTransform())
    sensor.SetColorRenderCamera(context, ColorRenderCamera(core))
    sensor.SetDepthRenderCamera(context, DepthRenderCamera(core, depth.depth_range()))


class VehiclePose(LeafSystem):
    """The pose X_WB of the state; memoryless.

    Ports:
        state (12): x of the vehicle.
        geometry_pose (FramePoseVector, output): X_WB of the vehicle's frame.

    Args:
        frame: id of the vehicle's frame in the SceneGraph.
    """

    def __init__(self, frame: FrameId):
        super().__init__()
        self.set_name("vehicle_pose")
        self._frame = frame
        self._state = self.DeclareVectorInputPort("state", N_X)
        self.DeclareAbstractOutputPort(
            "geometry_pose",
            lambda: Value(FramePoseVector()),
            self._calc_pose,
            prerequisites_of_calc={self._state.ticket()},
        )

    def _calc_pose(self, context: Context, output: Value) -> None:
        x = self._state.Eval(context)
        poses = FramePoseVector()
        poses.set_value(id=self._frame, value=RigidTransform(RollPitchYaw(x[3:6]), x[0:3]))
        output.set_value(poses)
