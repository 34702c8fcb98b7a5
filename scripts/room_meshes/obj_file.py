"""Write a mesh: an OBJ with normals, its MTL and one texture in which each swatch has its own square."""

import math
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from room_meshes.paint import SIDE
from room_meshes.solids import Point, Solid

CREASE = math.cos(math.radians(50.0))  # faces that meet at a smaller angle are shaded as one round surface
MARGIN = 1.5  # [px] kept between a swatch's used part and its border, so that neighbours do not bleed in


class Recipe(NamedTuple):
    """What a mesh is made of: swatches by name (SIDE, SIDE, 3), and parts (swatch, solid)."""

    swatches: dict[str, np.ndarray]
    parts: list[tuple[str, Solid]]


def fitted(recipe: Recipe, size: Point, on_floor: bool = False) -> Recipe:
    """Return the recipe stretched to a bounding box centred on the origin, or standing on z = 0."""
    everything = np.vstack([solid.vertices[np.unique(solid.faces)] for _, solid in recipe.parts])
    low, high = everything.min(axis=0), everything.max(axis=0)
    scale, center = np.array(size) / (high - low), (low + high) / 2
    lift = np.array([0.0, 0.0, size[2] / 2 if on_floor else 0.0])
    parts = [(name, s._replace(vertices=(s.vertices - center) * scale + lift)) for name, s in recipe.parts]
    return Recipe(recipe.swatches, parts)


def corner_normals(solid: Solid) -> np.ndarray:
    """Return the unit normal of each corner of each triangle (m, 3, 3), smooth but over creases."""
    a, b, c = (solid.vertices[solid.faces[:, i]] for i in range(3))
    normals = np.cross(b - a, c - a)
    units = normals / np.linalg.norm(normals, axis=1)[:, None]
    _, place = np.unique(np.round(solid.vertices, 6), axis=0, return_inverse=True)
    corners = place.reshape(-1)[solid.faces]
    at: dict[int, list[int]] = {}
    for face, triple in enumerate(corners):
        for corner in triple:
            at.setdefault(int(corner), []).append(face)
    out = np.empty((*corners.shape, 3))
    for face, triple in enumerate(corners):
        for i, corner in enumerate(triple):
            near = np.array(at[int(corner)])
            total = normals[near[units[near] @ units[face] > CREASE]].sum(axis=0)
            out[face, i] = total / np.linalg.norm(total)
    return out


def texture(swatches: dict[str, np.ndarray]) -> tuple[np.ndarray, dict[str, tuple[float, float]], int]:
    """Return the texture (n, n, 3) uint8 RGB, each swatch's lower left corner in it [0, 1], and swatches per row."""
    row = 1
    while row * row < len(swatches):
        row *= 2
    image = np.zeros((row * SIDE, row * SIDE, 3))
    corners = {}
    for k, (name, swatch) in enumerate(swatches.items()):
        i, j = divmod(k, row)
        image[i * SIDE : (i + 1) * SIDE, j * SIDE : (j + 1) * SIDE] = swatch
        corners[name] = (j / row, 1.0 - (i + 1) / row)
    return np.clip(np.round(image), 0, 255).astype(np.uint8), corners, row


def write_png(path: Path, rgb: np.ndarray) -> None:
    """Write an image (h, w, 3) uint8 RGB."""
    path.write_bytes(cv2.imencode(".png", rgb[:, :, ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes())


def write_mtl(path: Path, png: str) -> None:
    """Write a material library with the one material ``painted``, coloured by a texture alone."""
    text = f"newmtl painted\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nd 1\nillum 1\nmap_Kd {png}\n"
    path.write_text(text, encoding="utf-8", newline="\n")


class _Table:
    """Numbered lines without repeats."""

    def __init__(self, key: str, digits: int):
        self.key, self.digits, self.lines = key, digits, {}

    def number(self, values: np.ndarray) -> int:
        text = " ".join(f"{value + 0.0:.{self.digits}f}" for value in np.round(values, self.digits) + 0.0)
        return self.lines.setdefault(f"{self.key} {text}", len(self.lines) + 1)


def write_obj(path: Path, parts: list[Solid], mtl: str) -> None:
    """Write solids whose uv are those of the texture as one OBJ."""
    v, vt, vn = _Table("v", 5), _Table("vt", 4), _Table("vn", 3)
    faces = []
    for solid in parts:
        for triangle, normals in zip(solid.faces, corner_normals(solid), strict=True):
            corners = [
                (v.number(solid.vertices[i]), vt.number(solid.uv[i]), vn.number(n))
                for i, n in zip(triangle, normals, strict=True)
            ]
            if len({corner[0] for corner in corners}) == 3:
                faces.append("f " + " ".join(f"{a}/{b}/{c}" for a, b, c in corners))
    head = [
        "# Made by scripts/make_room_meshes.py; x forward, y left, z up, metres.",
        f"mtllib {mtl}",
        "usemtl painted",
    ]
    text = "\n".join([*head, *v.lines, *vt.lines, *vn.lines, *faces]) + "\n"
    path.write_text(text, encoding="utf-8", newline="\n")


def write_mesh(folder: Path, name: str, recipe: Recipe) -> None:
    """Write NAME.obj, NAME.mtl and NAME.png."""
    image, corners, row = texture(recipe.swatches)
    share = MARGIN / SIDE
    parts = [
        s._replace(uv=(np.array(corners[swatch]) + (share + s.uv * (1.0 - 2.0 * share)) / row))
        for swatch, s in recipe.parts
    ]
    write_png(folder / f"{name}.png", image)
    write_mtl(folder / f"{name}.mtl", f"{name}.png")
    write_obj(folder / f"{name}.obj", parts, f"{name}.mtl")
