"""Make the M100's mesh: ortilo_drake/world/scenery/meshes/m100.obj and m100.mtl.

A quadrotor in X configuration with the M100's main dimensions, see ortilo_drake/world/scenery/vehicle_mesh.py. Nothing
is random: the same script writes the same bytes.

    python scripts/make_vehicle_mesh.py [folder]
"""

import sys
from pathlib import Path

from ortilo_drake.world.scenery.vehicle_mesh import M100_ARMS, M100_MESH, M100_PROPELLER, mtl_text, obj_text


def main(folder: Path) -> None:
    """Write m100.obj and m100.mtl into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    text = obj_text(M100_ARMS, M100_PROPELLER, "scripts/make_vehicle_mesh.py")
    (folder / "m100.obj").write_text(text, encoding="utf-8", newline="\n")
    (folder / "m100.mtl").write_text(mtl_text(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else M100_MESH.parent)
