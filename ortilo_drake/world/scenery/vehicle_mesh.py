"""The mesh of a multirotor: a body, and a motor, a propeller and a leg at the end of every arm.

The shapes are our own, in the body frame B (x forward, y left, z up) about the centre of mass [m]. Every part is a
closed solid with outward faces and a plain colour. The M100's mesh is shipped as meshes/m100.obj
(scripts/make_vehicle_mesh.py); other vehicles' meshes are made from their arms.
"""

import math
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.model.vehicle import Vehicle

Solid = tuple[np.ndarray, np.ndarray]  # vertices (n, 3) [m], triangles (m, 3), counted from 0


def revolve(profile: list[tuple[float, float]], sides: int) -> Solid:
    """Return the solid of revolution about z of a profile (r, z), which goes from axis to axis with z rising."""
    angles = 2 * math.pi * np.arange(sides) / sides
    circle = np.stack([np.cos(angles), np.sin(angles), np.zeros(sides)], axis=1)
    rings = [r * circle + np.array([0.0, 0.0, z]) for r, z in profile[1:-1]]
    vertices = np.vstack([[[0.0, 0.0, profile[0][1]]], *rings, [[0.0, 0.0, profile[-1][1]]]])
    last, faces = len(vertices) - 1, []
    for i in range(sides):
        j = (i + 1) % sides
        faces.append((0, 1 + j, 1 + i))
        for ring in range(len(rings) - 1):
            a, b = 1 + ring * sides, 1 + (ring + 1) * sides
            faces += [(a + i, a + j, b + j), (a + i, b + j, b + i)]
        faces.append((last, last - sides + i, last - sides + j))
    return vertices, np.array(faces)


def cylinder(radius: float, z_low: float, z_high: float, sides: int) -> Solid:
    """Return a cylinder about z."""
    return revolve([(0.0, z_low), (radius, z_low), (radius, z_high), (0.0, z_high)], sides)


def dome(radius: float, sides: int, rings: int) -> Solid:
    """Return the half ball z >= 0."""
    angles = np.linspace(0.0, math.pi / 2, rings + 1)
    arc = [(radius * math.cos(a), radius * math.sin(a)) for a in angles[:-1]]
    return revolve([(0.0, 0.0), *arc, (0.0, radius)], sides)


def box(size: tuple[float, float, float]) -> Solid:
    """Return a box about the origin."""
    corners = [(x, y, z) for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return np.array(corners) * size, np.array(faces)


def placed(solid: Solid, x: float, y: float, z: float, R: np.ndarray | None = None) -> Solid:
    """Return the solid rotated by R, then moved by (x, y, z) [m]."""
    vertices = solid[0] if R is None else solid[0] @ R.T
    return vertices + np.array([x, y, z]), solid[1]


M100_MESH: Final = Path(__file__).with_name("meshes") / "m100.obj"
M100_ARM: Final = 0.65 / 2  # half the diagonal wheelbase
M100_PROPELLER: Final = 13 * 0.0254 / 2
CLEAR: Final = 0.48  # largest radius of a propeller over the distance of two rotor axes

# Diffuse colour and opacity.
MATERIALS = {
    "frame": ((0.16, 0.17, 0.19), 1.0),
    "shell": ((0.80, 0.81, 0.83), 1.0),
    "battery": ((0.30, 0.32, 0.36), 1.0),
    "motor": ((0.45, 0.47, 0.50), 1.0),
    "nose": ((0.90, 0.25, 0.10), 1.0),  # parts that show which way is forward
    "lens": ((0.05, 0.10, 0.25), 1.0),
    "propeller": ((0.35, 0.40, 0.48), 0.45),
}


class ArmPlace(NamedTuple):
    """An arm: its name, its azimuth [rad] and its length [m]."""

    name: str
    azimuth: float
    length: float


M100_ARMS: Final = tuple(
    ArmPlace(name, math.radians(azimuth), M100_ARM)
    for name, azimuth in {"front_left": 45, "rear_left": 135, "rear_right": 225, "front_right": 315}.items()
)


def propeller_radius(vehicle: Vehicle) -> float:
    """Return the propellers' radius [m]: within the vehicle's radius, and clear of their neighbours."""
    arms = vehicle.arms or ()
    axes = np.array([[arm.length * math.cos(arm.angle), arm.length * math.sin(arm.angle)] for arm in arms])
    room = CLEAR * min(float(np.linalg.norm(a - b)) for a, b in combinations(axes, 2))
    left = vehicle.radius - max(arm.length for arm in arms)
    return min(left, room) if left > 0.0 else room


def parts(arms: tuple[ArmPlace, ...], propeller: float) -> Iterator[tuple[str, str, Solid]]:
    """Yield (name, material, solid) of every part; all but the propellers scale with the arms, relative to the M100's.

    There is at least one arm; `propeller` is the propellers' radius [m].
    """
    k = max(arm.length for arm in arms) / M100_ARM
    z_to_x = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    yield "body", "frame", box((0.20 * k, 0.13 * k, 0.05 * k))
    yield "shell", "shell", placed(box((0.16 * k, 0.11 * k, 0.025 * k)), 0.0, 0.0, 0.0375 * k)
    yield "battery", "battery", placed(box((0.12 * k, 0.07 * k, 0.04 * k)), -0.03 * k, 0.0, 0.07 * k)
    yield "nose", "nose", placed(box((0.025 * k, 0.10 * k, 0.035 * k)), 0.1125 * k, 0.0, 0.0)
    yield "lens", "lens", placed(dome(0.03 * k, 20, 5), 0.125 * k, 0.0, 0.0, z_to_x)
    for name, azimuth, length in arms:
        c, s = math.cos(azimuth), math.sin(azimuth)
        along = np.array([[0.0, -s, c], [0.0, c, s], [-1.0, 0.0, 0.0]])  # z to the arm's direction
        leg = 0.24 * (length / M100_ARM)
        x, y, x_leg, y_leg = length * c, length * s, leg * c, leg * s
        ahead = "nose" if c > 1e-9 else "motor"
        yield f"arm_{name}", "frame", placed(cylinder(0.012 * k, 0.05 * k, length, 12), 0.0, 0.0, 0.0, along)
        yield f"motor_{name}", ahead, placed(cylinder(0.024 * k, -0.018 * k, 0.034 * k, 16), x, y, 0.0)
        yield f"propeller_{name}", "propeller", placed(cylinder(propeller, 0.036 * k, 0.040 * k, 32), x, y, 0.0)
        yield f"hub_{name}", "frame", placed(cylinder(0.012 * k, 0.034 * k, 0.048 * k, 12), x, y, 0.0)
        yield f"leg_{name}", "shell", placed(cylinder(0.010 * k, -0.20 * k, -0.005 * k, 10), x_leg, y_leg, 0.0)
        yield f"foot_{name}", "frame", placed(cylinder(0.022 * k, -0.215 * k, -0.195 * k, 12), x_leg, y_leg, 0.0)


def mtl_text() -> str:
    """Return the material library."""
    blocks = []
    for name, (rgb, opacity) in MATERIALS.items():
        kd = " ".join(f"{value:.2f}" for value in rgb)
        blocks.append(f"newmtl {name}\nKa 0 0 0\nKd {kd}\nKs 0.1 0.1 0.1\nNs 20\nd {opacity:.2f}\nillum 2\n")
    return "\n".join(blocks)


def obj_text(arms: tuple[ArmPlace, ...], propeller: float, made_by: str) -> str:
    """Return the mesh of parts(arms, propeller), with a first line that names what made it."""
    lines, count = [f"# Made by {made_by}; x forward, y left, z up, metres.", "mtllib m100.mtl"], 1
    for name, material, (vertices, faces) in parts(arms, propeller):
        lines += [f"o {name}", f"usemtl {material}"]
        lines += [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in faces + count]
        count += len(vertices)
    return "\n".join(lines) + "\n"


def vehicle_obj(vehicle: Vehicle) -> str:
    """Return a vehicle's OBJ mesh: made from its arms, or the M100's if it has none."""
    if vehicle.arms is None:
        return M100_MESH.read_text(encoding="utf-8")
    arms = tuple(ArmPlace(str(i), arm.angle, arm.length) for i, arm in enumerate(vehicle.arms))
    return obj_text(arms, propeller_radius(vehicle), "vehicle_mesh.py")
