"""The program's identity: a digest of its sources, which tells flights apart and checks workers."""

import hashlib
from functools import cache
from pathlib import Path

import ortilo_drake


@cache
def program_digest() -> str:
    """Return a digest of the package's sources, meshes and weights."""
    digest = hashlib.sha256()
    package = Path(ortilo_drake.__file__).parent
    for folder in (package, (package / "diagrams").resolve()):  # a link, which rglob does not follow
        for path in sorted(folder.rglob("*.*")):
            if path.is_file() and "__pycache__" not in path.parts:
                digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return digest.hexdigest()
