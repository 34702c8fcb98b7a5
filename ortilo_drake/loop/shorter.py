"""What numba does at length while it compiles, in shorter ways that come to the same.

Each took between a fiftieth and a fifth of the time. They are lent to numba while elements compile.
"""

import gc
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, partial
from types import SimpleNamespace
from typing import Any, Final

from numba.core import errors, ir, types
from numba.core.compiler import Flags
from numba.core.runtime.context import NRTContext
from numba.core.typing.npydecl import NumpyRulesArrayOperator
from numba.extending import overload
from numba.np import arrayobj

DEFAULTS = {name: option.default for name, option in Flags.options.items()}
OF_ARRAYS, HOLDERS = NumpyRulesArrayOperator.generic, NRTContext.get_meminfos


def values_of(flags: Flags) -> dict[str, Any]:
    """Return what Flags.values does, at a tenth of its time: numba compares all its options for each call it types."""
    return DEFAULTS | flags._values


def variables_in(code: ir.Inst, value: Any) -> list[ir.Var]:
    """Return the variables in a part of numba's code, as Inst._rec_list_vars does, without a call for each."""
    if type(value) is ir.Var:
        return [value]
    if isinstance(value, ir.Inst):
        return list(value.list_vars())
    if not isinstance(value, list | tuple | Mapping):
        return []
    found = list[ir.Var]()
    for its in value.values() if isinstance(value, Mapping) else value:
        if type(its) is ir.Var:
            found.append(its)
        elif type(its) is not ir.Loc and type(its) is not str:
            found += variables_in(code, its)
    return found


def of_arrays(operator: NumpyRulesArrayOperator, args: tuple[types.Type, ...], kws: dict[str, types.Type]) -> Any:
    """Return the signature of an operator of arrays, None for numbers: numba looks for NumPy's function first."""
    return (
        None if all(isinstance(its, types.Number | types.Boolean) for its in args) else OF_ARRAYS(operator, args, kws)
    )


@cache
def _is_held(models: Any, of: types.Type) -> bool:
    return bool(models[of].contains_nrt_meminfo())


def holders_in(counting: NRTContext, builder: Any, of: types.Type, value: Any) -> Any:
    """Return the holders in a value as numba does; where its type has none, the value is not taken to pieces first."""
    return HOLDERS(counting, builder, of, value) if _is_held(counting._context.data_model_manager, of) else []


def shapes_differ(source: Any, target: Any) -> None:
    """Raise for a slice to which an array of another shape is assigned.

    numba's own writes both shapes out: string code of a thousand instructions at each such assignment.
    """


@overload(shapes_differ, strict=False)
def _compiled_shapes_differ(source: Any, target: Any) -> Callable[[Any, Any], None]:
    def raised(source: Any, target: Any) -> None:
        raise ValueError("cannot assign slice from input of different size")

    return raised


LENT: Final = (
    (Flags, "values", values_of),
    (ir.Inst, "_rec_list_vars", variables_in),
    (NumpyRulesArrayOperator, "generic", of_arrays),
    (NRTContext, "get_meminfos", holders_in),
    (arrayobj, "raise_with_shape_context", shapes_differ),
    (errors, "termcolor", partial(SimpleNamespace, errmsg=str, filename=str)),  # of errors by which it tries types
)


@contextmanager
def shorter_ways() -> Iterator[None]:
    """Lend numba these ways, and look for no unused cycles meanwhile."""
    usual = [(owner, name, getattr(owner, name)) for owner, name, _ in LENT]
    collects = gc.isenabled()
    gc.disable()
    for owner, name, shorter in LENT:
        setattr(owner, name, shorter)
    try:
        yield
    finally:
        for owner, name, its in usual:
            setattr(owner, name, its)
        if collects:
            gc.enable()
