"""A digest of a function and of everything that the function calls.

numba's cache does not notice a change in a called function. So the name of a generated module contains the digest of
everything that its functions call.
"""

import hashlib
import platform
from collections.abc import Callable, Iterator
from pathlib import Path
from types import CodeType, FunctionType, ModuleType
from typing import Any

import numba
import numpy as np

LIBRARIES = ("numpy", "math", "numba", "builtins")
_VERSIONS = f"{platform.python_version()} {numba.__version__} {np.__version__}"


def digest_of(*made_of: Any) -> str:
    """Return a digest of functions, of all that they call and read, and of plain values."""
    parts: list[str] = [_VERSIONS]
    seen: set[int] = set()
    for one in made_of:
        parts += _parts(one, seen)
    return hashlib.blake2b("\n".join(parts).encode(), digest_size=10).hexdigest()


def modules_of(*functions: Any) -> set[str]:
    """Return the names of the modules of functions and of all that they call."""
    modules: dict[int, str] = {}
    to_see = [plain(function) for function in functions]
    while to_see:
        function = to_see.pop()
        if not isinstance(function, FunctionType) or id(function) in modules:
            continue
        if not function.__module__.startswith(LIBRARIES):
            modules[id(function)] = function.__module__
            to_see += [plain(value) for _, value in _used(function)]
    return {*modules.values()}


def _parts(value: Any, seen: set[int]) -> Iterator[str]:
    function = plain(value)
    if isinstance(function, FunctionType):
        if id(function) not in seen and not function.__module__.startswith(LIBRARIES):
            seen.add(id(function))
            yield f"{function.__module__}.{function.__qualname__}"  # numba's cache holds the module's name too
            yield from _of_code(function.__code__, function.__doc__)
            for default in (*(function.__defaults__ or ()), *(function.__kwdefaults__ or {}).values()):
                yield from _parts(default, seen)
            for name, used in _used(function):
                yield name
                yield from _parts(used, seen)
    elif isinstance(value, ModuleType):
        if not value.__name__.startswith(LIBRARIES) and value.__file__:
            yield Path(value.__file__).read_text(encoding="utf-8")
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype} {value.shape} {value.tobytes().hex()}"
    elif isinstance(value, type):
        yield f"{value.__qualname__} {getattr(value, '_fields', '')}"
    else:
        is_plain = isinstance(value, (list, tuple, dict, int, float, str, np.generic, np.dtype, type(None)))
        yield repr(value) if is_plain else ""


def _of_code(code: CodeType, docstring: str | None = None) -> Iterator[str]:
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _of_code(constant)
        elif docstring is None or constant is not docstring:
            yield repr(sorted(constant, key=repr) if isinstance(constant, frozenset) else constant)


def names_in(code: CodeType) -> dict[str, None]:
    """Return the names that a code object and the code objects inside it read, as keys in their order."""
    codes, names = [code], dict[str, None]()
    while codes:
        code = codes.pop()
        names |= dict.fromkeys(code.co_names)
        codes += [constant for constant in code.co_consts if isinstance(constant, CodeType)]
    return names


def _used(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Yield the name and value of each global and closure variable that a function reads."""
    for name in names_in(function.__code__):
        if name in function.__globals__:
            yield name, function.__globals__[name]
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        yield name, cell.cell_contents


def plain(function: Callable[..., Any] | Any) -> Any:
    """Return the plain Python function of a function that numba compiles; any other value as it is."""
    return getattr(function, "py_func", function)
