"""Make the room's textured meshes in world/scenery/meshes/ and the landmarks' outlines in ortilo_room.yaml.

Landmarks are centred on the origin, with the extents ``landmark_size`` of the room file along their own axes
(x forward, y left, z up); clutter stands on z = 0. All shapes and pictures are our own. Seeded: the same script
writes the same bytes.

    python scripts/make_room_meshes.py [folder [room file]]
"""

import sys
from pathlib import Path

import numpy as np
import yaml
from room_meshes import clutter, creatures, objects
from room_meshes.obj_file import Recipe, fitted, write_mesh
from room_meshes.outline import drawn_in, outline, section, write_section
from room_meshes.surfaces import write_surfaces

PACKAGE = Path(__file__).resolve().parents[1] / "ortilo_drake"
FOLDER = PACKAGE / "world" / "scenery" / "meshes"
ROOM = PACKAGE / "model" / "ortilo_room.yaml"

LANDMARKS = {
    "person": creatures.person,
    "fire hydrant": objects.fire_hydrant,
    "dog": creatures.dog,
    "potted plant": objects.potted_plant,
    "chair": objects.chair,
    "bicycle": objects.bicycle,
    "bird": creatures.bird,
    "cat": creatures.cat,
    "clock": objects.clock,
}


def within_outline(recipe: Recipe) -> tuple[Recipe, np.ndarray]:
    """Return the recipe drawn in to its outline, and the outline (POINTS, 3) [m]."""
    solids = [solid for _, solid in recipe.parts]
    chosen = outline(np.vstack([solid.vertices[np.unique(solid.faces)] for solid in solids]))
    vertices = drawn_in(np.vstack([solid.vertices for solid in solids]), chosen)
    each = np.split(vertices, np.cumsum([len(solid.vertices) for solid in solids])[:-1])
    parts = [(name, s._replace(vertices=v)) for (name, s), v in zip(recipe.parts, each, strict=True)]
    return Recipe(recipe.swatches, parts), chosen


def main(folder: Path, room_file: Path) -> None:
    """Write every mesh into the folder and the outlines into the room file."""
    folder.mkdir(parents=True, exist_ok=True)
    room = yaml.safe_load(room_file.read_text(encoding="utf-8"))
    outlines = {}
    for seed, (label, recipe_of) in enumerate(LANDMARKS.items()):
        size = room["landmark_size"][label]
        recipe, points = within_outline(fitted(recipe_of(np.random.default_rng(seed)), size))
        write_mesh(folder, label.replace(" ", "_"), recipe)
        outlines[label] = points / (np.array(size) / 2)
    for seed, (name, size) in enumerate(clutter.SIZE.items()):
        recipe = getattr(clutter, name)(np.random.default_rng(50 + seed))
        write_mesh(folder, name, fitted(recipe, size, on_floor=True))
    write_surfaces(folder, room["wall_size"], room["stand_radius"], room["stand_height"])
    write_section(room_file, section(outlines))


if __name__ == "__main__":
    main(
        Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER,
        Path(sys.argv[2]) if len(sys.argv) > 2 else ROOM,
    )
