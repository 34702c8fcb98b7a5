"""An element's functions as compiled code with a C interface.

Each is compiled on its own, from a few lines of generated source that make arrays of addresses, and is kept on the disk
by numba: one compiled form serves every wiring, room and size. Whoever calls it hands over

    n                      the address of the record
    k, seed                whole numbers
    <array>, its shape     the address, then one whole number for each dimension; in the order of the parameters

Addresses are not checked: wiring.py and player.py see to it that what is made of them has its size. Whether an element
looks beyond its arrays only an element of one's own checks (Element.checked); for those of the package
tests/flight/test_checked_flights.py flies every ready-made scenario with it.
"""

import re
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import llvmlite.binding as llvm
from numba import njit
from numba.core.errors import NumbaError

from ortilo_drake.compiled.digest import digest_of, modules_of, plain
from ortilo_drake.compiled.generated import load
from ortilo_drake.compiled.inlined import OPTIONS, Inlined, helpers_only_linked
from ortilo_drake.loop.element import Array, Element, Group, Number, takes
from ortilo_drake.loop.raised import ElementError, places_in

_KINDS = {"f8": "types.float64", "i8": "types.int64", "u8": "types.uint64", "b1": "types.boolean"}
_WHOLE = {"k": "types.int64", "seed": "types.int64"}


@dataclass(frozen=True)
class Native:
    """A compiled function with a C interface.

    Attributes:
        symbol: its name for the linker.
        arguments: how many it takes.
        address: where it is.
    """

    symbol: str
    arguments: int
    address: int


def parameters(element: Element, function: Callable[..., None]) -> list[tuple[str, int, str]]:
    """Return the parameters of a function in C, in order: name, number of dimensions (-1 of what is no array), kind.

    A group's arrays stand where the group does, and n where the group has numbers and n is not there.
    """
    names, found = dict[str, None](), []
    for name in takes(function):
        leaves = element.grouped[name].leaves if name in element.grouped else [None]
        names |= {its.name if isinstance(its, Array) else "n" if its else name: None for its in leaves}
    for name in names:
        if name == "n" or name in _WHOLE:
            found.append((name, -1, ""))
        elif name in element.own:
            found.append((name, element.own[name].dimensions, element.own[name].kind))
        else:
            found.append((name, 1, "i8" if name == "seeds" else "f8"))
    return found


def is_kept(element: Element) -> bool:
    """Return whether compiled code is kept on the disk: numba asks for the module of each function when it is read."""
    return modules_of(*element.functions.values()) <= {*sys.modules}


def native_text(element: Element) -> str:
    """Return the source of an element's functions with a C interface."""
    text = f'"""{element.name}, made by ortilo_drake/loop/native.py."""\n\n'
    text += "import numpy as np\nfrom numba import cfunc, from_dtype, types\n"
    text += "from ortilo_drake.compiled.addresses import array_at, record_at\n\n"
    fields = [(number.name, number.kind, number.shape) for number in element.constants] or [("nothing", "f8", ())]
    text += f"record = types.CPointer(from_dtype(np.dtype({fields!r}, align=True)))\n"
    without = "" if element.allocates else ", _nrt=False"
    for what, function in element.functions.items():
        types_of, names = [], []
        for name, dimensions, kind in parameters(element, function):
            names.append(name)
            if dimensions < 0:
                types_of.append(_WHOLE.get(name, "record"))
                continue
            shape = [f"{name}_{i}" for i in range(dimensions)]
            types_of += [f"types.CPointer({_KINDS[kind]})"] + ["types.int64"] * dimensions
            names += shape
        grouped = [element.grouped[name] for name in takes(function) if name in element.grouped]
        put = "".join(f"    {group.name} = {_argument(element, group)}\n" for group in grouped)
        made = ", ".join(name if name in element.grouped else _argument(element, name) for name in takes(function))
        text += f"""

@cfunc(types.void({", ".join(types_of)}), cache={is_kept(element)}, error_model="numpy"{without})
def {what}_c({", ".join(names)}):
{put}    its_{what}({made})
"""
    return text


def _argument(element: Element, of: str | Number | Array | Group) -> str:
    """Return the expression that makes a parameter of the function from the arguments in C."""
    if isinstance(of, str):
        of = element.own.get(of) or (of if of == "n" or of in _WHOLE else Array(of))
    if isinstance(of, Group):
        return f"its_{of.name}({', '.join(_argument(element, its) for its in of.fields)})"
    if isinstance(of, Array):
        return f"array_at({of.name}, ({''.join(f'{of.name}_{i}, ' for i in range(of.dimensions)).rstrip()}))"
    return f"record_at(n).{of.name}" if isinstance(of, Number) else "record_at(n)" if of == "n" else of


def _classes(groups: Iterable[Number | Array | Group]) -> dict[str, type]:
    """Return the classes of groups by the names that _argument has for them."""
    found = dict[str, type]()
    for group in groups:
        if isinstance(group, Group):
            found |= {f"its_{group.name}": group.of} | _classes(group.fields)
    return found


def known_to(element: Element) -> dict[str, Any]:
    """Return the globals of native_text's source, by name: the element's functions and the classes of its tuples."""
    options = OPTIONS | ({} if element.allocates else {"_nrt": False})
    options |= {"boundscheck": True} if element.checked else {}
    # Inlined, descriptors of arrays stay in registers.
    compiled = njit(error_model="numpy", pipeline_class=Inlined, **options)
    jitted = {f"its_{what}": compiled(plain(f)) for what, f in element.functions.items()}
    return jitted | _classes(element.groups)


def _why(element: Element, error: NumbaError) -> str:
    """Return why numba cannot compile an element: the first of its reasons, and the line that it names."""
    said = [line.strip() for line in f"{error}".splitlines() if line.strip() and not line.startswith("Failed in")]
    reason = f"{said[0]} {said[1].lstrip('> ')}" if said[0].endswith(":") else said[0]
    line = re.search(r" at \S+ \((\d+)\)", f"{error}")
    return f"{places_in([element])}: numba cannot compile it: {reason}{f', in line {line[1]}' if line else ''}"


@lru_cache(maxsize=256)
def native_of(element: Element) -> dict[str, Native]:
    """Return an element's functions, compiled, by name: `out` and `step`, those that it has."""
    text = native_text(element)
    name = f"{element.name}_{digest_of(text, *element.functions.values())}{'_checked' * element.checked}"
    try:
        with helpers_only_linked(element.checked):
            module = load(name, text, known_to(element))
    except NumbaError as error:
        raise ElementError(_why(element, error)) from error
    found = {}
    for what, function in element.functions.items():
        its = getattr(module, f"{what}_c")
        count = sum(1 + max(dimensions, 0) for _, dimensions, _ in parameters(element, function))
        found[what] = Native(f"ortilo_{name}_{what}", count, its.address)
        llvm.add_symbol(found[what].symbol, its.address)
    return found
