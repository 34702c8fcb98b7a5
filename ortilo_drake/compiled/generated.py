"""Generated modules: written once, kept beside numba's cache, and deleted when they have not been used for long."""

import contextlib
import os
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType
from typing import Any, Final

MOST: Final = 4000  # largest number of files kept; the tests make about a thousand
LONGEST: Final = 30 * 86400.0  # longest time that an unused file is kept [s]


def generated_folder() -> Path:
    """Return the folder of generated files; it is beside numba's cache, so that numba keeps their compiled code too."""
    own = os.environ.get("NUMBA_CACHE_DIR")
    beside = Path(own) if own else Path(__file__).parent / "__pycache__"
    if not os.access(beside if beside.exists() else beside.parent, os.W_OK):
        beside = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ortilo"
    return beside / "generated"


def load(name: str, text: str, known: dict[str, Any]) -> ModuleType:
    """Write a generated module, unless its file exists, and run it with the names in `known` already defined.

    The file is needed because numba keeps compiled code beside the source file.
    """
    module = ModuleType(f"ortilo_generated.{name}")
    if module.__name__ in sys.modules:
        return sys.modules[module.__name__]
    folder = generated_folder()
    file = folder / f"{name}.py"
    if not is_there(file):
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=folder, suffix=".tmp", delete=False, encoding="utf-8") as written:
            written.write(text)
        os.replace(written.name, file)
        clear(folder)
    module.__file__ = str(file)
    vars(module).update(known)
    sys.modules[module.__name__] = module
    try:
        exec(compile(text, str(file), "exec"), vars(module))
    except BaseException:
        del sys.modules[module.__name__]
        raise
    return module


def is_there(file: Path) -> bool:
    """Return whether a file exists; set its access time to now, but not the modification time, which numba compares."""
    try:
        os.utime(file, ns=(time.time_ns(), file.stat().st_mtime_ns))
    except OSError:  # the file may also belong to another user, who marks it
        return file.exists()
    return True


def clear(folder: Path, most: int = MOST, longest: float = LONGEST) -> None:
    """Delete generated files that have not been used for long, with numba's compiled code of them.

    Other processes may delete at the same time. A process that has loaded a module no longer needs its file.

    Args:
        folder: folder of the generated files.
        most: number of files to keep; the most recently used ones stay.
        longest: longest time that an unused file stays [s].
    """
    asked, now = dict[str, float](), time.time()
    for file in folder.glob("*.py"):
        with contextlib.suppress(OSError):
            asked[file.stem] = file.stat().st_atime
    newest = sorted(asked, key=asked.__getitem__, reverse=True)
    old = {*newest[most:], *(stem for stem in newest if now - asked[stem] > longest)}
    places = (folder, folder / "__pycache__", *folder.parent.glob("generated_*")) if old else ()
    for file in (file for place in places for file in place.glob("*.*")):
        if file.name.partition(".")[0] in old:
            with contextlib.suppress(OSError):
                file.unlink()
