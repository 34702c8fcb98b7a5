"""Bricks, floor tiles and stands: the room itself."""

from pathlib import Path

import numpy as np
from room_meshes.obj_file import Recipe, write_mesh, write_mtl, write_obj, write_png
from room_meshes.paint import clouds, grid, plain, wood
from room_meshes.solids import Solid, turned

TEXTURE = 256  # [px] for one metre
COURSES, BRICKS = 12, 4  # rows in a metre, bricks in a row


def brick(rng: np.random.Generator) -> np.ndarray:
    """Return one square metre of brick wall, which fits itself on all sides."""
    u, v = grid(TEXTURE)
    row = np.floor(v * COURSES).astype(int)
    along = (u * BRICKS + 0.5 * (row % 2)) % BRICKS
    column = np.floor(along).astype(int)
    tint = rng.normal(size=(COURSES, BRICKS))[row, column]
    rough = 5.0 * clouds(rng, 64, TEXTURE)
    image = np.array([158.0, 78.0, 58.0]) + (tint[:, :, None] * np.array([14.0, 9.0, 7.0])) + rough[:, :, None]
    joint = ((v * COURSES) % 1.0 < 0.14) | (along % 1.0 < 0.045)
    mortar = np.array([186.0, 180.0, 170.0]) + rough[:, :, None]
    return np.clip(np.round(np.where(joint[:, :, None], mortar, image)), 0, 255).astype(np.uint8)


def floor_tile(rng: np.random.Generator) -> np.ndarray:
    """Return one square metre of floor: four stone tiles with joints."""
    u, v = grid(TEXTURE)
    tint = rng.normal(size=(2, 2))[np.floor(v * 2).astype(int), np.floor(u * 2).astype(int)]
    grey = 150.0 + 7.0 * tint + 6.0 * clouds(rng, 8, TEXTURE) + 4.0 * clouds(rng, 32, TEXTURE)
    image = grey[:, :, None] * np.array([1.0, 0.98, 0.94])
    joint = ((u * 2) % 1.0 < 0.02) | ((v * 2) % 1.0 < 0.02)
    return np.clip(np.round(np.where(joint[:, :, None], 95.0, image)), 0, 255).astype(np.uint8)


def metres(origin: np.ndarray, along: np.ndarray, up: np.ndarray, columns: int, rows: int) -> Solid:
    """Return a rectangle of one square per metre, each of which shows the whole texture.

    Texture coordinates stay in [0, 1], because beyond it Drake's renderer draws out the texture's border.
    """
    vertices, uv, faces = [], [], []
    for i in range(columns):
        for j in range(rows):
            n = len(vertices)
            square = [(0, 0), (1, 0), (1, 1), (0, 1)]
            vertices += [origin + (i + a) * along + (j + b) * up for a, b in square]
            uv += [(float(a), float(b)) for a, b in square]
            faces += [(n, n + 1, n + 2), (n, n + 2, n + 3)]
    return Solid(np.array(vertices), np.array(uv), np.array(faces))


def wall(size: tuple[float, float, float]) -> list[Solid]:
    """Return the six faces of a wall about its centre, a brick texture to each metre."""
    faces = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            normal = np.eye(3)[axis] * sign
            up = np.eye(3)[2 if axis < 2 else 1]
            along = np.cross(up, normal)
            a, b = float(np.abs(along) @ size), float(np.abs(up) @ size)
            origin = (normal * size - along * a - up * b) / 2
            faces.append(metres(origin, along, up, round(a), round(b)))
    return faces


def stand(rng: np.random.Generator, radius: float, height: float) -> Recipe:
    """Return a round stand with a wooden top, z = 0 at its foot."""
    swatches = {"side": plain(rng, (148, 146, 142), 6.0), "top": wood(rng, (170, 128, 84), 4)}
    edge = height - 0.03
    parts = [
        ("side", turned([(radius, 0.0), (radius, edge)], 32)),
        ("top", turned([(radius, edge), (radius, height)], 32)),
    ]
    return Recipe(swatches, parts)


def write_surfaces(folder: Path, wall_size: tuple[float, float, float], radius: float, height: float) -> None:
    """Write brick.png, floor_tile.png, wall, floor, floor32x10 and stand."""
    x, y = np.eye(3)[0], np.eye(3)[1]
    write_png(folder / "brick.png", brick(np.random.default_rng(101)))
    write_png(folder / "floor_tile.png", floor_tile(np.random.default_rng(102)))
    write_mtl(folder / "wall.mtl", "brick.png")
    write_mtl(folder / "floor.mtl", "floor_tile.png")
    write_obj(folder / "wall.obj", wall(wall_size), "wall.mtl")
    write_obj(folder / "floor.obj", [metres(-0.5 * (x + y), x, y, 1, 1)], "floor.mtl")
    write_obj(folder / "floor32x10.obj", [metres(-16 * x - 5 * y, x, y, 32, 10)], "floor.mtl")
    write_mesh(folder, "stand", stand(np.random.default_rng(103), radius, height))
