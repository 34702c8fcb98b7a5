"""What a function of an element raises while compiled code calls it.

numba's callers in C go on after it, and Python prints the error as one that nobody can hear. It is heard here, so that
the player can tell it.
"""

import sys
import threading
from collections.abc import Iterable
from inspect import isfunction
from pathlib import Path
from typing import Any, Final

from ortilo_drake.compiled.digest import plain
from ortilo_drake.loop.element import Box, Element

_OF_NUMBA: Final = "<numba.core.cpu.CPUContext>"  # what numba calls itself there
_first = threading.local()  # a flight is flown in one thread
_usual = sys.unraisablehook


class ElementError(ValueError):
    """A function of an element that cannot be compiled, or that raises in flight: a line that names its place."""


def places_in(elements: Iterable[Element]) -> str:
    """Return where the functions of elements begin; of one that is made of a user's function, where that does."""
    functions = [plain(function) for element in elements for function in element.functions.values()]
    inner = [[plain(cell.cell_contents) for cell in its.__closure__ or ()] for its in functions]
    named = [one for its, used in zip(functions, inner, strict=True) for one in [*filter(isfunction, used)] or [its]]
    codes = [its.__code__ for its in named]
    return " or ".join(f"{its.co_name} ({Path(its.co_filename).name}, line {its.co_firstlineno})" for its in codes)


def listen() -> None:
    """Hear from now on what elements raise."""
    global _usual
    if sys.unraisablehook is not _hear:
        _usual, sys.unraisablehook = sys.unraisablehook, _hear


def tell(boxes: Iterable[Box]) -> None:
    """Raise ElementError if one of these has raised anything in this thread since the last call."""
    error, _first.error = getattr(_first, "error", None), None
    if error is not None:
        where = places_in(box.element for box in boxes if box.element.checked)
        raise ElementError(f"{where}: {type(error).__name__}: {error}") from error


def _hear(unraisable: Any) -> None:
    if unraisable.object != _OF_NUMBA:
        _usual(unraisable)
    elif getattr(_first, "error", None) is None:
        _first.error = unraisable.exc_value
