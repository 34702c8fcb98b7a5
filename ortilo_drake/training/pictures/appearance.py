"""Random looks of a scene: recoloured textures and other light."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, LightParameter, Mesh

from ortilo_drake.model.optional import later
from ortilo_drake.world.scenery.rendering import lamp
from ortilo_drake.world.scenery.scene import SceneItem

cv2 = later("cv2")


@lru_cache(maxsize=64)
def _files(path: Path) -> tuple[str, str, str, str, bytes]:
    """Return a mesh's OBJ text, its material's name and text, and its texture's name and bytes."""

    def named(text: str, key: str) -> str:
        return next(line.split()[1] for line in text.splitlines() if line.strip().startswith(key))

    obj = path.read_text()
    mtl = (path.parent / (material := named(obj, "mtllib"))).read_text()
    return obj, material, mtl, (texture := named(mtl, "map_Kd")), (path.parent / texture).read_bytes()


def _recolor(png: bytes, hue: float, saturation: float, value: float, gamma: float) -> bytes:
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    hsv = cv2.cvtColor(image.astype(np.float32) / 255.0, cv2.COLOR_BGR2HSV)
    hsv[..., 0] = (hsv[..., 0] + hue) % 360.0
    hsv[..., 1] = np.clip(hsv[..., 1] * saturation, 0.0, 1.0)
    hsv[..., 2] = np.clip(value * hsv[..., 2] ** gamma, 0.0, 1.0)
    return bytes(cv2.imencode(".png", np.round(255.0 * cv2.cvtColor(hsv, cv2.COLOR_HSV2BGR)).astype(np.uint8))[1])


class Recolored:
    """Gives each kind of thing in one scene one random look."""

    def __init__(self, rng: np.random.Generator):
        self._rng, self._made = rng, dict[str, InMemoryMesh]()

    def mesh(self, shape: Mesh, group: str) -> Mesh:
        """Return the mesh with its texture recoloured: surfaces in any colour, things still recognisable."""
        path = Path(shape.source().path())
        if path.name not in self._made:
            rng = self._rng
            obj, material, mtl, texture, png = _files(path)
            if group == "landmarks":
                look = (rng.normal(0.0, 10.0), rng.uniform(0.75, 1.2), rng.uniform(0.8, 1.15), rng.uniform(0.85, 1.2))
            else:
                look = (rng.uniform(-180, 180), rng.uniform(0.2, 1.3), rng.uniform(0.6, 1.2), rng.uniform(0.5, 1.3))
            self._made[path.name] = InMemoryMesh(
                mesh_file=MemoryFile(obj.encode(), ".obj", path.name),
                supporting_files={
                    material: MemoryFile(mtl.encode(), ".mtl", "material"),
                    texture: MemoryFile(_recolor(png, *look), ".png", texture),
                },
            )
        return Mesh(self._made[path.name], shape.scale3())

    def item(self, item: SceneItem) -> SceneItem:
        """Return the item with a random look."""
        if isinstance(item.shape, Mesh):
            return replace(item, shape=self.mesh(item.shape, item.group))
        return item


def random_lamps(rng: np.random.Generator) -> list[LightParameter]:
    """Return three or four distant lamps above, of random direction, strength and tint, that leave no side black."""
    lamps = []
    turn = rng.uniform(-np.pi, np.pi)
    count = rng.integers(3, 5)
    total = rng.uniform(1.5, 2.8)
    shares = rng.dirichlet([4.0] * count)
    for k in range(count):
        azimuth = turn + 2.0 * np.pi * k / count + rng.normal(0.0, 0.4)
        tint = np.clip(rng.normal([1.0, 0.97, 0.94], 0.05), 0.7, 1.0)
        direction = (np.cos(azimuth), np.sin(azimuth), -rng.uniform(0.3, 1.1))
        lamps.append(lamp(float(total * shares[k]), direction, tuple(tint)))
    return lamps


def random_background(rng: np.random.Generator) -> tuple[float, float, float]:
    """Return the colour seen above the walls, some light grey."""
    red, green, blue = np.clip(rng.uniform(0.35, 1.0) + rng.normal(0.0, 0.05, 3), 0.0, 1.0)
    return float(red), float(green), float(blue)
