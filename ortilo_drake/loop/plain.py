"""The plain source of compiled functions, for scalars that numba does not know: Drake's AutoDiffXd and Expression.

A function's plain source calls the plain source of all that it calls. Some functions have another form for such
scalars: an iteration is not differentiated, only its last step; noise is drawn by compiled code.

    @generic_twin_of(filter_step)
    def differentiable_step(...): ...
"""

from collections.abc import Callable
from types import CellType, FunctionType
from typing import Any

from ortilo_drake.compiled.digest import LIBRARIES, names_in, plain

_INSTEAD: dict[int, Any] = {}
_PLAIN: dict[int, tuple[Any, Any]] = {}  # with the function, so that its id stays its own


def generic_twin_of(function: Callable[..., Any]) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Let a function run in the place of another one, plain or compiled, where scalars are no floats."""

    def mark(other: Callable[..., Any]) -> Callable[..., Any]:
        _INSTEAD[id(function)] = _INSTEAD[id(getattr(function, "py_func", function))] = other
        return other

    return mark


def plain_source(function: Any) -> Any:
    """Return a function that does the same to any scalar; what is no function of Python stays as it is."""
    if id(function) in _INSTEAD:
        return _INSTEAD[id(function)]
    source = plain(function)
    if not isinstance(source, FunctionType) or source.__module__.startswith(LIBRARIES):
        return function
    if id(function) not in _PLAIN:
        _PLAIN[id(function)] = function, source  # of a function that calls itself
        _PLAIN[id(function)] = function, _with_plain_callees(source)
    return _PLAIN[id(function)][1]


def _with_plain_callees(source: FunctionType) -> FunctionType:
    globals_, changed = source.__globals__, dict[str, Any]()
    for name in names_in(source.__code__):
        if name in globals_ and plain_source(globals_[name]) is not globals_[name]:
            changed[name] = plain_source(globals_[name])
    cells = source.__closure__ or ()
    plain_cells = tuple(CellType(plain_source(cell.cell_contents)) for cell in cells)
    if not changed and all(a.cell_contents is b.cell_contents for a, b in zip(cells, plain_cells, strict=True)):
        return source
    made = FunctionType(source.__code__, globals_ | changed, source.__name__, source.__defaults__, plain_cells)
    made.__kwdefaults__ = source.__kwdefaults__
    return made
