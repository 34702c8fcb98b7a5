"""Draw a vehicle, its estimate with the 3-sigma ellipsoid, and planned and flown paths in Meshcat."""

import itertools

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh, Meshcat, Rgba, Sphere
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix
from pydrake.trajectories import Trajectory

from ortilo_drake.model.vehicle import M100, Vehicle
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
SMALLEST_AXIS = 1e-3  # [m]; the viewer cannot show a body of no extent


def pose(x: np.ndarray) -> RigidTransform:
    """Return X_WB from a state [p_WB, rpy, ...]."""
    return RigidTransform(RollPitchYaw(x[3:6]), x[0:3])


def _axis_rotations() -> np.ndarray:
    """Return the 24 rotations that carry the coordinate axes into one another (24, 3, 3)."""
    signed = (
        np.eye(3)[list(order)] * np.array(signs)
        for order in itertools.permutations(range(3))
        for signs in itertools.product((-1.0, 1.0), repeat=3)
    )
    return np.array([S for S in signed if np.linalg.det(S) > 0])


_AXES = _axis_rotations()


def sigma_ellipsoid(P: np.ndarray, R_near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the 3-sigma ellipsoid of a covariance P = R diag(s / 3)^2 R^T of p_W [m^2] as (R, s).

    Principal axes, the columns of R in W, come in any order and sign. Of the 24 rotations that describe the same
    ellipsoid this is the one nearest to R_near, so that a viewer that turns from one to the next does not tumble. The
    semi-axes are s (3) [m].
    """
    variances, R = np.linalg.eigh((P + P.T) / 2)
    R[:, 2] *= np.sign(np.linalg.det(R))
    candidates = R @ _AXES
    best = int(np.argmax(np.einsum("ij,nij->n", R_near, candidates)))  # trace(R_near^T R)
    s = SIGMAS * np.sqrt(np.maximum(variances, 0.0)) @ np.abs(_AXES[best])
    return candidates[best], np.maximum(s, SMALLEST_AXIS)


def tube(points: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Return m square prisms along the m segments of a path, as vertices (3, 8 m) and triangles (3, 8 m).

    Browsers draw every line one pixel wide, whatever width is asked for; a tube is seen from afar. Segments of no
    length are left out. The path goes through p_W (n, 3), the edges are at that radius from it [m].
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
    """Draw the path through points p_W (n, 3); nothing where they are all the same."""
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
    # Without its materials: Meshcat's property "color" leaves those of a mesh file as they are.
    vertices, faces = triangles_of(text)
    meshcat.SetTriangleMesh(ESTIMATE, vertices.T, faces.T, GHOST)
    meshcat.SetObject(ELLIPSOID, Sphere(1.0), UNCERTAINTY)


def show_pose(
    meshcat: Meshcat, x: np.ndarray, xhat: np.ndarray, P: np.ndarray, R_near: np.ndarray, time: float
) -> np.ndarray:
    """Move vehicle, estimate and ellipsoid where draw_vehicle has been, and return the ellipsoid's R.

    The ellipsoid is a unit ball under a pose and the property ``scale``: a RigidTransform has none, and of
    SetTransform's two forms only that one is recorded. x is the state (12), xhat the estimate, at least [p_WB, rpy], P
    its position's covariance (3, 3) [m^2], R_near that of sigma_ellipsoid, and the time that in the recording [s], if
    one is being made.
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
