"""Errors that the functions of elements raise while compiled code calls them.

C code cannot receive a Python error: it calls the next function, and Python prints the error as ignored. The hook here
keeps the first error of each thread instead, and the player raises it after the flight.
"""

import sys
import threading
from collections.abc import Iterable
from inspect import isfunction
from pathlib import Path
from typing import Any, Final

from ortilo_drake.compiled.digest import plain
from ortilo_drake.loop.element import Box, Element

_OF_NUMBA: Final = "<numba.core.cpu.CPUContext>"  # the name that numba gives in such errors
_first = threading.local()  # a flight is flown in one thread
_usual = sys.unraisablehook


class ElementError(ValueError):
    """One line that names the function of an element that numba cannot compile, or that raises in flight."""


def places_in(elements: Iterable[Element]) -> str:
    """Return the names, files and first lines of elements' functions, or of the user's functions that they call."""
    functions = [plain(function) for element in elements for function in element.functions.values()]
    inner = [[plain(cell.cell_contents) for cell in its.__closure__ or ()] for its in functions]
    named = [one for its, used in zip(functions, inner, strict=True) for one in [*filter(isfunction, used)] or [its]]
    codes = [its.__code__ for its in named]
    return " or ".join(f"{its.co_name} ({Path(its.co_filename).name}, line {its.co_firstlineno})" for its in codes)


def listen() -> None:
    """Install the hook that keeps the errors of elements."""
    global _usual
    if sys.unraisablehook is not _hear:
        _usual, sys.unraisablehook = sys.unraisablehook, _hear


def tell(boxes: Iterable[Box]) -> None:
    """Raise ElementError if a function of these boxes has raised an error in this thread since the last call."""
    error, _first.error = getattr(_first, "error", None), None
    if error is not None:
        where = places_in(box.element for box in boxes if box.element.checked)
        raise ElementError(f"{where}: {type(error).__name__}: {error}") from error


def _hear(unraisable: Any) -> None:
    if unraisable.object != _OF_NUMBA:
        _usual(unraisable)
    elif getattr(_first, "error", None) is None:
        _first.error = unraisable.exc_value
