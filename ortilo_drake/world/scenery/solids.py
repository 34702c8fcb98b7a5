"""Closed solids of triangles with outward faces."""

import math

import numpy as np

Solid = tuple[np.ndarray, np.ndarray]  # vertices (n, 3) [m], triangles (m, 3), counted from 0


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


def placed(solid: Solid, x: float, y: float, z: float, R: np.ndarray | None = None) -> Solid:
    """Return the solid rotated by R, then moved."""
    vertices = solid[0] if R is None else solid[0] @ R.T
    return vertices + np.array([x, y, z]), solid[1]
