"""Textured solids: swept tubes, boxes, prisms and discs, from which every mesh is put together [m].

Faces turn anticlockwise seen from outside. Texture coordinates (u, v) run over [0, 1] of the part's own swatch,
v upwards.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

Point = Sequence[float]


class Solid(NamedTuple):
    """A closed surface (or a disc): vertices (n, 3) [m], uv (n, 2), triangles (m, 3) counted from 0."""

    vertices: np.ndarray
    uv: np.ndarray
    faces: np.ndarray


def loft(
    points: Sequence[Point],
    radii: Sequence[float | Point],
    sides: int = 8,
    up: Point | None = None,
    axis: Point | None = None,
) -> Solid:
    """Return the solid through elliptical rings about the points, closed at both ends.

    The ring's first half axis lies as near to ``up`` as it can (default: x for an upright solid, else z); u = 1/2
    there. v runs from the first point to the last.

    Args:
        points: centres (k, 3).
        radii: a radius or two half axes for each centre (k).
        sides: corners of a ring.
        up: direction of the first half axis (3).
        axis: normal of all rings (3), else each lies across the way from point to point.
    """
    c = np.array(points, dtype=float)
    ab = np.array([(r, r) if isinstance(r, int | float) else tuple(r) for r in radii], dtype=float)
    tangents = np.gradient(c, axis=0) if axis is None else np.tile(np.array(axis, dtype=float), (len(c), 1))
    if up is None:
        whole = np.abs(c[-1] - c[0])
        up = (1.0, 0.0, 0.0) if whole[2] > whole[:2].max() else (0.0, 0.0, 1.0)
    tangents /= np.linalg.norm(tangents, axis=1)[:, None]
    e1 = np.array(up) - (tangents @ np.array(up))[:, None] * tangents
    e1 /= np.linalg.norm(e1, axis=1)[:, None]
    e2 = np.cross(tangents, e1)
    angles = np.linspace(-math.pi, math.pi, sides + 1)
    cos, sin = np.cos(angles)[None, :, None], np.sin(angles)[None, :, None]
    rings = c[:, None] + ab[:, :1, None] * cos * e1[:, None] + ab[:, 1:, None] * sin * e2[:, None]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(c, axis=0), axis=1) + 1e-9)])
    u, v = np.meshgrid(np.linspace(0.0, 1.0, sides + 1), along / along[-1])
    return _closed(rings, np.stack([u, v], axis=2), c[0], c[-1])


def _closed(rings: np.ndarray, uv: np.ndarray, first: np.ndarray, last: np.ndarray) -> Solid:
    k, n = rings.shape[:2]
    vertices = np.vstack([rings.reshape(-1, 3), first, last])
    texture = np.vstack([uv.reshape(-1, 2), [[0.5, 0.0], [0.5, 1.0]]])
    faces = []
    for j in range(n - 1):
        for i in range(k - 1):
            a, b = i * n + j, (i + 1) * n + j
            faces += [(a, a + 1, b + 1), (a, b + 1, b)]
        faces += [(k * n, j + 1, j), (k * n + 1, (k - 1) * n + j, (k - 1) * n + j + 1)]
    return _without_slivers(Solid(vertices, texture, np.array(faces)))


def _without_slivers(solid: Solid) -> Solid:
    a, b, c = (solid.vertices[solid.faces[:, i]] for i in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    return solid._replace(faces=solid.faces[area > 1e-9])


def turned(profile: Sequence[tuple[float, float]], sides: int = 16) -> Solid:
    """Return the solid of revolution about z of a profile (r, z)."""
    points = [(0.0, 0.0, z) for _, z in profile]
    return loft(points, [r for r, _ in profile], sides, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def ellipsoid(center: Point, half: Point, sides: int = 10, rings: int = 7) -> Solid:
    """Return an ellipsoid with its poles along z, u = 1/2 in front (+x)."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, rings)
    points = [(center[0], center[1], center[2] + half[2] * math.sin(a)) for a in angles]
    return loft(points, [(half[0] * math.cos(a), half[1] * math.cos(a)) for a in angles], sides)


def ring(center: Point, radius: float, thickness: float, sides: int = 28, tube: int = 6) -> Solid:
    """Return a torus about the y axis through a centre: a tyre."""
    a = np.linspace(0.0, 2 * math.pi, sides + 1)[:, None]
    b = np.linspace(0.0, 2 * math.pi, tube + 1)[None, :]
    r = radius + thickness * np.cos(b)
    rings = np.array(center) + np.stack([r * np.cos(a), thickness * np.sin(b) + 0.0 * a, r * np.sin(a)], axis=2)
    uv = np.stack(np.meshgrid(np.linspace(0.0, 1.0, tube + 1), np.linspace(0.0, 8.0, sides + 1) % 1.0), axis=2)
    k, n = rings.shape[:2]
    faces = []
    for i in range(k - 1):
        for j in range(n - 1):
            p, q = i * n + j, (i + 1) * n + j
            faces += [(p, p + 1, q + 1), (p, q + 1, q)]
    return Solid(rings.reshape(-1, 3), uv.reshape(-1, 2), np.array(faces))


def box(center: Point, size: Point) -> Solid:
    """Return a box, the whole swatch on each face, upright on the four that stand."""
    vertices, uv, faces = [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = np.eye(3)[axis] * sign
            v_axis = np.array([0.0, 0.0, 1.0]) if axis < 2 else np.array([0.0, 1.0, 0.0])
            u_axis = np.cross(v_axis, normal)
            corners = [(-1, -1), (1, -1), (1, 1), (-1, 1)]
            vertices += [(normal + a * u_axis + b * v_axis) / 2 for a, b in corners]
            uv += [((a + 1) / 2, (b + 1) / 2) for a, b in corners]
            n = len(vertices) - 4
            faces += [(n, n + 1, n + 2), (n, n + 2, n + 3)]
    return Solid(np.array(vertices) * size + center, np.array(uv), np.array(faces))


def prism(outline: Sequence[tuple[float, float]], thickness: float) -> Solid:
    """Return the plate |x| <= thickness / 2 over an anticlockwise outline (y, z), seen whole from its centre.

    Both faces show the swatch upright and unmirrored, over the outline's bounding box.
    """
    flat = np.array(outline, dtype=float)
    flat = np.vstack([flat, flat.mean(axis=0)])
    share = (flat - flat.min(axis=0)) / np.ptp(flat, axis=0)
    n = len(flat)
    i = np.arange(n - 1)
    j = (i + 1) % (n - 1)
    front = np.column_stack([np.full(n, thickness / 2), flat])
    back = np.column_stack([np.full(n, -thickness / 2), flat])
    mirrored = np.column_stack([1.0 - share[:, 0], share[:, 1]])
    caps = [np.column_stack([i, j, np.full(n - 1, n - 1)]), np.column_stack([j, i, np.full(n - 1, n - 1)]) + n]
    rim = [np.column_stack([i, i + n, j + n]) + 2 * n, np.column_stack([i, j + n, j]) + 2 * n]
    return Solid(
        np.vstack([front, back, front, back]), np.vstack([share, mirrored, share, share]), np.vstack([*caps, *rim])
    )


def moved(solid: Solid, p: Point = (0.0, 0.0, 0.0), roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0) -> Solid:
    """Return the solid turned by roll, pitch, yaw [deg] about x, y, z in this order, then moved by p."""
    a, b, c = np.radians([roll, pitch, yaw])
    R_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    R_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    R_z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    return solid._replace(vertices=solid.vertices @ (R_z @ R_y @ R_x).T + np.array(p))


def mirrored(solid: Solid) -> Solid:
    """Return the solid's mirror image, left for right (y for -y)."""
    return Solid(solid.vertices * np.array([1.0, -1.0, 1.0]), solid.uv, solid.faces[:, ::-1])
