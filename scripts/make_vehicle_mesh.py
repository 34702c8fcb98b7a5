"""Make the vehicle's mesh: ortilo_drake/world/scenery/meshes/m100.obj and m100.mtl.

A quadrotor in X configuration with the M100's main dimensions, our own shapes, in the body frame B
(x forward, y left, z up) about the centre of mass [m]. Every part is a closed solid with outward faces and a
plain colour. Nothing is random: the same script writes the same bytes.

    python scripts/make_vehicle_mesh.py [folder]
"""

import math
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

Solid = tuple[np.ndarray, np.ndarray]  # vertices (n, 3) [m], triangles (m, 3), counted from 0
FOLDER = Path(__file__).resolve().parents[1] / "ortilo_drake" / "world" / "scenery" / "meshes"

MOTOR_RADIUS = 0.65 / 2  # half the diagonal wheelbase
PROPELLER_RADIUS = 13 * 0.0254 / 2
X_ARMS = {"front_left": 45, "rear_left": 135, "rear_right": 225, "front_right": 315}  # azimuth [deg]

# Diffuse colour and opacity.
MATERIALS = {
    "frame": ((0.16, 0.17, 0.19), 1.0),
    "shell": ((0.80, 0.81, 0.83), 1.0),
    "battery": ((0.30, 0.32, 0.36), 1.0),
    "motor": ((0.45, 0.47, 0.50), 1.0),
    "nose": ((0.90, 0.25, 0.10), 1.0),  # what points forward
    "lens": ((0.05, 0.10, 0.25), 1.0),
    "propeller": ((0.35, 0.40, 0.48), 0.45),
}


def revolve(profile: list[tuple[float, float]], sides: int) -> Solid:
    """Return the solid of revolution about z of a profile (r, z) from axis to axis, z rising."""
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


def moved(solid: Solid, x: float, y: float, z: float, R: np.ndarray | None = None) -> Solid:
    """Return the solid rotated by R, then moved."""
    vertices = solid[0] if R is None else solid[0] @ R.T
    return vertices + np.array([x, y, z]), solid[1]


def parts() -> Iterator[tuple[str, str, Solid]]:
    """Yield (name, material, solid) of every part."""
    z_to_x = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    yield "body", "frame", box((0.20, 0.13, 0.05))
    yield "shell", "shell", moved(box((0.16, 0.11, 0.025)), 0.0, 0.0, 0.0375)
    yield "battery", "battery", moved(box((0.12, 0.07, 0.04)), -0.03, 0.0, 0.07)
    yield "nose", "nose", moved(box((0.025, 0.10, 0.035)), 0.1125, 0.0, 0.0)
    yield "camera", "lens", moved(dome(0.03, 20, 5), 0.125, 0.0, 0.0, z_to_x)
    for name, azimuth in X_ARMS.items():
        c, s = math.cos(math.radians(azimuth)), math.sin(math.radians(azimuth))
        along = np.array([[0.0, -s, c], [0.0, c, s], [-1.0, 0.0, 0.0]])  # z to the arm's direction
        x, y, x_leg, y_leg = MOTOR_RADIUS * c, MOTOR_RADIUS * s, 0.24 * c, 0.24 * s
        ahead = "nose" if c > 0 else "motor"
        yield f"arm_{name}", "frame", moved(cylinder(0.012, 0.05, MOTOR_RADIUS, 12), 0.0, 0.0, 0.0, along)
        yield f"motor_{name}", ahead, moved(cylinder(0.024, -0.018, 0.034, 16), x, y, 0.0)
        yield f"propeller_{name}", "propeller", moved(cylinder(PROPELLER_RADIUS, 0.036, 0.040, 32), x, y, 0.0)
        yield f"hub_{name}", "frame", moved(cylinder(0.012, 0.034, 0.048, 12), x, y, 0.0)
        yield f"leg_{name}", "shell", moved(cylinder(0.010, -0.20, -0.005, 10), x_leg, y_leg, 0.0)
        yield f"foot_{name}", "frame", moved(cylinder(0.022, -0.215, -0.195, 12), x_leg, y_leg, 0.0)


def mtl_text() -> str:
    """Return the material library."""
    blocks = []
    for name, (rgb, opacity) in MATERIALS.items():
        kd = " ".join(f"{value:.2f}" for value in rgb)
        blocks.append(f"newmtl {name}\nKa 0 0 0\nKd {kd}\nKs 0.1 0.1 0.1\nNs 20\nd {opacity:.2f}\nillum 2\n")
    return "\n".join(blocks)


def obj_text() -> str:
    """Return the mesh."""
    lines, count = (
        ["# Made by scripts/make_vehicle_mesh.py; x forward, y left, z up, metres.", "mtllib m100.mtl"],
        1,
    )
    for name, material, (vertices, faces) in parts():
        lines += [f"o {name}", f"usemtl {material}"]
        lines += [f"v {x:.5f} {y:.5f} {z:.5f}" for x, y, z in vertices]
        lines += [f"f {a} {b} {c}" for a, b, c in faces + count]
        count += len(vertices)
    return "\n".join(lines) + "\n"


def main(folder: Path) -> None:
    """Write m100.obj and m100.mtl into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "m100.obj").write_text(obj_text(), encoding="utf-8", newline="\n")
    (folder / "m100.mtl").write_text(mtl_text(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
