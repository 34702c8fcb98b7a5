"""OBJ meshes with and without their normals: the renderer needs them, a page is smaller without them."""

import re
from pathlib import Path

import numpy as np
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh


def _mesh(text: str, path: Path) -> InMemoryMesh:
    """Return the mesh of an OBJ text, with the material library and pictures that lie beside the file at path."""
    library = path.with_suffix(".mtl")
    pictures = re.findall(r"^map_Kd (\S+)$", library.read_text(encoding="utf-8"), re.M)
    return InMemoryMesh(
        mesh_file=MemoryFile(text, ".obj", path.name),
        supporting_files={library.name: library} | {name: path.with_name(name) for name in pictures},
    )


def without_normals(path: Path) -> InMemoryMesh:
    """Return an OBJ mesh without its normals, half the size; a viewer then shades each face evenly."""
    text = path.read_text(encoding="utf-8")
    text = re.sub(r"^vn .*\n", "", text, flags=re.M)
    return _mesh(re.sub(r"(\d+/\d*)/\d+", r"\1", text), path)


def triangles_of(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices (n, 3) and triangles (m, 3), counted from 0, of an OBJ mesh without normals or texture."""
    lines = text.splitlines()
    vertices = np.array([line.split()[1:] for line in lines if line.startswith("v ")], dtype=float)
    faces = np.array([line.split()[1:] for line in lines if line.startswith("f ")], dtype=np.int32)
    return vertices, faces - 1


def with_face_normals(text: str, path: Path) -> InMemoryMesh:
    """Return an OBJ mesh, which has neither normals nor texture, with a normal for each face.

    Its faces are triangles of positive vertex numbers; it uses the material library of the file at path.
    """
    lines = text.splitlines()
    vertices, faces = triangles_of(text)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    made, k = [], 0
    for line in lines:
        if line.startswith("f "):
            made.append("vn {:.3f} {:.3f} {:.3f}".format(*normals[k]))
            k += 1
            made.append("f " + " ".join(f"{vertex}//{k}" for vertex in line.split()[1:]))
        else:
            made.append(line)
    return _mesh("\n".join(made) + "\n", path)
