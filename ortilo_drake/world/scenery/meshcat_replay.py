"""A flight drawn in Meshcat with zones on the floor, and a logged flight as a self-contained page that plays it."""

from html import escape
from typing import NamedTuple

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import Box, InMemoryMesh, Mesh, Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.trajectories import Trajectory
from scipy.spatial.transform import Rotation

from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X, N_XBAR
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100, Vehicle
from ortilo_drake.world.scenery.meshcat_room import ANCHOR, aim_camera, class_color, draw_room, make_meshcat
from ortilo_drake.world.scenery.obj_normals import triangles_of
from ortilo_drake.world.scenery.vehicle_mesh import M100_MESH, vehicle_obj

VEHICLE = "/flight/vehicle"
ESTIMATE = "/flight/estimate"
ELLIPSOID = "/flight/ellipsoid"
PLANNED_PATH = "/flight/planned_path"
TRUE_PATH = "/flight/true_path"
ESTIMATED_PATH = "/flight/estimated_path"

PLANNED = Rgba(0.10, 0.55, 1.00, 0.45)
TRUE = Rgba(0.05, 0.05, 0.05, 1.0)
ESTIMATED = Rgba(0.95, 0.05, 0.60, 1.0)
GHOST = Rgba(0.95, 0.05, 0.60, 0.25)
UNCERTAINTY = Rgba(0.60, 0.10, 0.95, 0.22)

SIGMAS = 3.0
SMALLEST_AXIS = 1e-3  # [m]; the viewer cannot show a body of size 0


def pose(x: np.ndarray) -> RigidTransform:
    """Return X_WB from a state [p_WB, rpy, ...]."""
    return RigidTransform(RollPitchYaw(x[3:6]), x[0:3])


_AXES = np.round(Rotation.create_group("O").as_matrix())  # the 24 rotations that carry the axes into each other


def sigma_ellipsoid(P: np.ndarray, R_near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the 3-sigma ellipsoid of a covariance P = R diag(s / 3)^2 R^T of p_W [m^2] as (R, s).

    The principal axes, the columns of R in W, come in any order and sign. 24 rotations describe the same ellipsoid; R
    is the one nearest to R_near, so that an animation from one ellipsoid to the next does not tumble. s (3) are the
    semi-axes [m].
    """
    variances, R = np.linalg.eigh((P + P.T) / 2)
    R[:, 2] *= np.sign(np.linalg.det(R))
    candidates = R @ _AXES
    best = int(np.argmax(np.einsum("ij,nij->n", R_near, candidates)))  # trace(R_near^T R)
    s = SIGMAS * np.sqrt(np.maximum(variances, 0.0)) @ np.abs(_AXES[best])
    return candidates[best], np.maximum(s, SMALLEST_AXIS)


def tube(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return m square prisms along the m segments of a path, as vertices (3, 8 m) and triangles (3, 8 m).

    Browsers draw every line one pixel wide, whatever width is asked for; a tube is visible from afar. Segments of
    length 0 are left out. The path goes through p_W (n, 3); the prisms' edges are `radius` from it [m].
    """
    d = np.diff(points, axis=0)
    length = np.linalg.norm(d, axis=1)
    start, end, d = (a[length > 1e-9] for a in (points[:-1], points[1:], d))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    n_1 = np.cross(d, np.eye(3)[np.argmin(np.abs(d), axis=1)])
    n_1 *= radius / np.linalg.norm(n_1, axis=1, keepdims=True)
    n_2 = np.cross(d, n_1)
    corners = [p + n for p in (start, end) for n in (n_1, n_2, -n_1, -n_2)]
    vertices = np.stack(corners, axis=1).reshape(-1, 3)
    sides = [face for i in range(4) for face in ((i, (i + 1) % 4, i + 4), ((i + 1) % 4, (i + 1) % 4 + 4, i + 4))]
    faces = (8 * np.arange(len(start))[:, None, None] + np.array(sides)).reshape(-1, 3)
    return vertices.T, faces.T.astype(np.int32)


def draw_path(meshcat: Meshcat, path: str, points: np.ndarray, radius: float, rgba: Rgba) -> None:
    """Draw the path through points p_W (n, 3); draw nothing if they are all the same."""
    vertices, faces = tube(points, radius)
    if faces.size:
        meshcat.SetTriangleMesh(path, vertices, faces, rgba)
    else:
        meshcat.Delete(path)


def draw_plan(meshcat: Meshcat, trajectory: Trajectory, samples: int = 400) -> None:
    """Draw the planned path: a trajectory whose first three values are p_W."""
    times = np.linspace(trajectory.start_time(), trajectory.end_time(), samples)
    points = np.array([np.ravel(trajectory.value(t))[:3] for t in times])
    draw_path(meshcat, PLANNED_PATH, points, 0.045, PLANNED)


def draw_vehicle(meshcat: Meshcat, vehicle: Vehicle = M100) -> None:
    """Put vehicle, estimate (a ghost of the vehicle) and ellipsoid under /flight, and delete flown paths."""
    for path in (TRUE_PATH, ESTIMATED_PATH):
        meshcat.Delete(path)
    text = vehicle_obj(vehicle)
    library = {"m100.mtl": M100_MESH.with_suffix(".mtl")}
    meshcat.SetObject(
        VEHICLE, Mesh(InMemoryMesh(mesh_file=MemoryFile(text, ".obj", "vehicle.obj"), supporting_files=library))
    )
    # The ghost has no materials, because Meshcat's property "color" does not change a mesh file's materials.
    vertices, faces = triangles_of(text)
    meshcat.SetTriangleMesh(ESTIMATE, vertices.T, faces.T, GHOST)
    meshcat.SetObject(ELLIPSOID, Sphere(1.0), UNCERTAINTY)


def show_pose(
    meshcat: Meshcat, x: np.ndarray, xhat: np.ndarray, P: np.ndarray, R_near: np.ndarray, time: float
) -> np.ndarray:
    """Move the vehicle, estimate and ellipsoid that draw_vehicle made, and return the ellipsoid's R.

    The ellipsoid is a unit ball with a pose and the property ``scale``: a RigidTransform has no scale, and only that
    form of SetTransform is recorded. x is the state (12), xhat the estimate, at least [p_WB, rpy], and P the position's
    covariance (3, 3) [m^2]. R_near is as for sigma_ellipsoid. The time [s] is that of the recording, if one is being
    made.
    """
    R, s = sigma_ellipsoid(P, R_near)
    meshcat.SetTransform(VEHICLE, pose(x), time)
    meshcat.SetTransform(ESTIMATE, pose(xhat), time)
    meshcat.SetTransform(ELLIPSOID, RigidTransform(RotationMatrix(R), xhat[0:3]), time)
    meshcat.SetProperty(ELLIPSOID, "scale", s.tolist(), time)
    return R


def draw_flown(meshcat: Meshcat, points: np.ndarray, chunk: str = "") -> None:
    """Draw flown paths from rows [p_WB, estimate of p_WB] (n, 6)."""
    draw_path(meshcat, TRUE_PATH + chunk, points[:, 0:3], 0.02, TRUE)
    draw_path(meshcat, ESTIMATED_PATH + chunk, points[:, 3:6], 0.02, ESTIMATED)


ABOVE_FLOOR = 0.012  # [m]; above the grid of the floor
OPACITY = 0.22


class Zone(NamedTuple):
    """A strip of the floor."""

    low: tuple[float, float]
    """its south-western corner (x, y) [m]."""
    high: tuple[float, float]
    """its north-eastern corner (x, y) [m]."""
    color: tuple[float, float, float]
    """red, green and blue, each 0 to 1."""


def draw_zones(meshcat: Meshcat, room: Room, zones: list[Zone]) -> None:
    """Draw zones on a room's floor as /room/zones/NN, each a little above the one before."""
    for i, zone in enumerate(zones):
        low, high = np.array(zone.low), np.array(zone.high)
        path = f"/room/zones/{i:02d}"
        meshcat.SetObject(path, Box(*(high - low), 0.004), Rgba(*zone.color, OPACITY))
        middle = (low + high) / 2
        height = room.interior.min[2] + ABOVE_FLOOR + 0.006 * i
        meshcat.SetTransform(path, RigidTransform([*middle, height]))


FRAME_RATE = 15.0  # frame rate of a replay [Hz]
LEGEND_STYLE = """
#legend { position: fixed; left: 0; top: 0; right: 250px; padding: 6px 10px; display: flex; flex-wrap: wrap;
  gap: 0 14px; background: rgba(255, 255, 255, 0.8); font: 13px/1.5 sans-serif }
#legend span { display: inline-block; width: 12px; height: 12px; margin-right: 6px }
"""
AROUND = np.array([1.5, 3.5, 1.5])  # margin of the room to show around a replayed flight [m]


def legend(room: Room) -> str:
    """Return an HTML legend of the colours of paths, ellipsoid, anchors and landmark classes."""
    colors = {"planned path": PLANNED, "true path": TRUE, "estimate": ESTIMATED, "3 sigma": UNCERTAINTY}
    colors |= {"anchor": ANCHOR} | {label: class_color(room, label) for label in room.classes}
    rows = "".join(
        f'<div><span style="background:rgb({255 * c.r():.0f},{255 * c.g():.0f},{255 * c.b():.0f})"></span>'
        f"{escape(name)}</div>"
        for name, c in colors.items()
    )
    return f'<style>{LEGEND_STYLE}</style>\n<div id="legend">{rows}</div>\n'


def _check_log(times: np.ndarray, **arrays: np.ndarray) -> None:
    """Raise InputError unless times rise and every array is finite and has a row for each time."""
    if times.ndim != 1 or len(times) < 2 or not np.all(np.diff(times) > 0):
        raise InputError(f"times: shape {times.shape}: must be two or more rising times")
    shapes = {"states": (N_X,), "estimates": (N_XBAR,), "covariances": (N_XBAR, N_XBAR)}
    for name, array in arrays.items():
        if array.shape != (len(times), *shapes[name]):
            raise InputError(f"{name}: shape {array.shape}: must be {(len(times), *shapes[name])}")
        if not np.all(np.isfinite(array)):
            raise InputError(f"{name}: must be finite numbers")


def html_replay(
    room: Room,
    trajectory: Trajectory | None,
    times: np.ndarray,
    states: np.ndarray,
    estimates: np.ndarray,
    covariances: np.ndarray,
    meshcat: Meshcat | None = None,
    vehicle: Vehicle = M100,
    zones: list[Zone] | None = None,
) -> str:
    """Return a logged flight as one HTML page that plays without a network.

    The trajectory, the planned path, has p_W as its first three values. The log has equally spaced times (n) [s],
    states x (n, 12), estimates (n, 15) and covariances (n, 15, 15). It is drawn in a new Meshcat if none is given, with
    the vehicle's own arms, and with zones on the floor. InputError naming an array that does not fit.
    """
    _check_log(times, states=states, estimates=estimates, covariances=covariances)
    meshcat = make_meshcat() if meshcat is None else meshcat
    draw_room(meshcat, room)
    draw_zones(meshcat, room, zones or [])
    if trajectory is not None:
        draw_plan(meshcat, trajectory)
    draw_vehicle(meshcat, vehicle)
    h = (times[-1] - times[0]) / (len(times) - 1)
    stride = max(1, round(1.0 / (FRAME_RATE * h)))
    shown = slice(0, len(times), stride)
    draw_flown(meshcat, np.hstack([states[shown, :3], estimates[shown, :3]]))
    inside = np.clip(states[:, :3], room.interior.min, room.interior.max)  # a lost flight may end anywhere
    aim_camera(meshcat, inside.min(axis=0) - AROUND, inside.max(axis=0) + AROUND)
    frames_per_second = 1.0 / (stride * h)
    R = np.eye(3)
    meshcat.DeleteRecording()
    meshcat.StartRecording(frames_per_second, set_visualizations_while_recording=False)
    log = zip(states[shown], estimates[shown], covariances[shown, :3, :3], strict=True)
    for frame, (x, xhat, P) in enumerate(log):
        # Meshcat rounds a time down to a frame: half a frame keeps it clear of rounding.
        R = show_pose(meshcat, x, xhat, P, R, (frame + 0.5) / frames_per_second)
    meshcat.StopRecording()
    meshcat.PublishRecording()
    return meshcat.StaticHtml().replace("</body>", legend(room) + "</body>")
