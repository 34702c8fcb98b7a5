"""Generated modules: written once, kept beside numba's cache, and cleared where no code has asked for them for long."""

import contextlib
import os
import sys
import tempfile
import time
from pathlib import Path
from types import ModuleType
from typing import Any, Final

MOST: Final = 4000  # files that are kept; the tests make about a thousand
LONGEST: Final = 30 * 86400.0  # that a file is kept unasked for [s]


def generated_folder() -> Path:
    """Return the folder of generated files, beside numba's cache, so that their compiled code is kept too."""
    own = os.environ.get("NUMBA_CACHE_DIR")
    beside = Path(own) if own else Path(__file__).parent / "__pycache__"
    if not os.access(beside if beside.exists() else beside.parent, os.W_OK):
        beside = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ortilo"
    return beside / "generated"


def load(name: str, text: str, known: dict[str, Any]) -> ModuleType:
    """Write a generated module, unless it is there, and run it with names that it need not import.

    numba looks for the file of what it compiles, to keep the result beside it.
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
    """Return whether a file is there, and mark it as asked for now; numba goes by when it was changed, which stays."""
    try:
        os.utime(file, ns=(time.time_ns(), file.stat().st_mtime_ns))
    except OSError:  # it may also belong to someone else, who keeps it
        return file.exists()
    return True


def clear(folder: Path, most: int = MOST, longest: float = LONGEST) -> None:
    """Delete generated files that nobody has asked for, with what numba keeps of them.

    Other processes may do the same at the same time, or have loaded what is deleted: they no longer need the file.

    Args:
        folder: where they are.
        most: how many stay, those that were asked for last.
        longest: how long one stays that is not asked for [s].
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
