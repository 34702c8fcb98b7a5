"""Code that counts no references gives no arrays to code that does: whoever counts them would free them too early.

numba has two ways into that. A function that says _nrt=False may itself return arrays. And an njit function that does
not say it is compiled as its first caller is, once for all callers and for the disk: without references where that
caller is an element that allocates nothing. register_jitable ones are compiled for both kinds of callers.
"""

import ast
import importlib
import pkgutil
import typing
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher

import ortilo_drake
from ortilo_drake.compiled.digest import _used, plain
from ortilo_drake.diagrams.wiring.whole import boxes_of
from ortilo_drake.loop.element import Element
from ortilo_drake.model.pinhole import Camera
from ortilo_drake.scenario import load_scenario

PACKAGE = Path(ortilo_drake.__file__).parent


def holds_arrays(kind: Any) -> bool:
    """Whether values of an annotated type are arrays or hold some."""
    if kind is np.ndarray or typing.get_origin(kind) is np.ndarray:
        return True
    fields = typing.get_type_hints(kind).values() if hasattr(kind, "_fields") else typing.get_args(kind)
    return any(holds_arrays(its) for its in fields)


def returns_arrays(function: FunctionType) -> bool:
    return holds_arrays(typing.get_type_hints(function)["return"])


def shared_and_uncounted(element: Element) -> Iterator[str]:
    """Names of the njit functions that an element without references calls and that return arrays."""
    seen, to_see = set[int](), list[Any](element.functions.values())
    while to_see:
        function = plain(to_see.pop())
        if isinstance(function, FunctionType) and id(function) not in seen and function.__module__[:5] != "numba":
            seen.add(id(function))
            used = [value for _, value in _used(function)]
            to_see += used
            yield from (f.__name__ for f in used if isinstance(f, Dispatcher) and returns_arrays(f.py_func))


def modules_with(text: str) -> Iterator[tuple[ModuleType, str]]:
    """The package's modules whose source has a text in it, imported, and that source."""
    for its in pkgutil.walk_packages([str(PACKAGE)], "ortilo_drake."):
        file = PACKAGE.joinpath(*its.name.split(".")[1:]).with_suffix(".py")
        if file.exists() and text in (source := file.read_text(encoding="utf-8")):
            yield importlib.import_module(its.name), source


def elements() -> list[Element]:
    """Return the elements that modules have by name, and those that the ready-made scenarios make."""
    modules = [vars(module).values() for module, _ in modules_with("Element(")]
    found = [value for values in modules for value in values if isinstance(value, Element)]
    for name in ("realistic", "tight_imu_uwb"):
        found += [box.element for box in boxes_of(load_scenario(name, ("camera.kind=projected",)), 10)]
    return found


def test_elements_without_references_call_no_njit_function_that_returns_arrays() -> None:
    uncounted = [element for element in elements() if not element.allocates]
    assert len({element.name for element in uncounted}) > 30
    found = {(element.name, name) for element in uncounted for name in shared_and_uncounted(element)}
    assert not found, "make these register_jitable, or have the element say that it allocates"


@njit
def halves(a: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return a[:1], a[1:]


def halves_out(message: np.ndarray, out: np.ndarray) -> None:
    out[0] = halves(message)[0][0]


def test_such_a_function_would_be_found() -> None:
    assert list(shared_and_uncounted(Element("own", out=halves_out))) == ["halves"]


def says_nrt_false(node: ast.expr) -> bool:
    return isinstance(node, ast.Call) and any(
        its.arg == "_nrt" and isinstance(its.value, ast.Constant) and its.value.value is False for its in node.keywords
    )


def said_nrt_false() -> Iterator[FunctionType]:
    """Functions of the package whose decorator says _nrt=False."""
    for module, source in modules_with("_nrt=False"):
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef) and any(says_nrt_false(its) for its in node.decorator_list):
                yield plain(getattr(module, node.name))


def test_functions_that_say_so_themselves_return_no_arrays() -> None:
    functions = list(said_nrt_false())
    assert len(functions) > 15
    assert [f"{f.__module__}.{f.__name__}" for f in functions if returns_arrays(f)] == []


def test_arrays_are_found_in_tuples_of_any_depth() -> None:
    assert holds_arrays(tuple[bool, Camera])
    assert holds_arrays(tuple[float, tuple[np.ndarray, ...]])
    assert not holds_arrays(tuple[float, tuple[int, bool]])
    assert not holds_arrays(type(None))
