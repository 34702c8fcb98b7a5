"""Faster replacements, with the same results, for slow functions of numba's compiler.

Each of these functions took between 2 and 20 % of the compile time. They are replaced only while elements compile.
"""

import gc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, lru_cache, partial
from types import SimpleNamespace
from typing import Any, Final

from llvmlite.ir import Block, VoidType
from numba.core import (
    base,
    errors,
    event,
    ir,
    lowering,
    postproc,
    target_extension,
    transforms,
    typeinfer,
    types,
    utils,
)
from numba.core.compiler import Flags
from numba.core.runtime.context import NRTContext
from numba.core.types import functions
from numba.core.typing.context import BaseContext
from numba.core.typing.npydecl import NumpyRulesArrayOperator
from numba.extending import overload
from numba.np import arrayobj

DEFAULTS = {name: option.default for name, option in Flags.options.items()}
HASH = hash(Flags())  # the same for all: numba hashes the options' names alone
TYPED, PREPARED = functions.BaseFunction.get_call_type, postproc.PostProcessor.run
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
    if not isinstance(value, (list, tuple, dict)):
        return []
    found = list[ir.Var]()
    for its in value.values() if isinstance(value, dict) else value:
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


def prepared(code: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """Prepare a function's code as PostProcessor.run does; where its variables live is found when it is asked for."""
    its = code.func_ir
    if its.is_generator:
        PREPARED(code, emit_dels, extend_lifetimes)
        return
    its.blocks = transforms.canonicalize_cfg(its.blocks)
    its.variable_lifetime, its.generator_info = postproc.VariableLifetime(its.blocks), None
    if emit_dels:
        code._insert_var_dels(extend_lifetimes=extend_lifetimes)


def equal(flags: Flags, other: Any) -> bool:
    """Return whether options are the same, at once where the same ones are set."""
    return isinstance(other, Flags) and (flags._values == other._values or flags.values() == other.values())


def heard(tell: Callable[..., None], kind: str, *of: Any, **more: Any) -> None:
    """Tell an event to its listeners, except that LLVM is called: numba sends thousands of these to its timers."""
    if kind != "numba:llvm_lock":
        tell(kind, *of, **more)


def type_of_call(function: functions.BaseFunction, context: Any, args: Any, kws: dict[str, types.Type]) -> Any:
    """Return the signature of a call; the template that took these types before is tried at once, not all in order."""
    if not kws:
        taken, key = vars(function).setdefault("_taken", {}), tuple(args)
        tried = [taken[key]] if key in taken else []
        if not tried:
            target = target_extension.get_local_target(context)
            order = utils.order_by_target_specificity(target, function.templates, fnkey=function.key[0])
            tried = [(its, its.prefer_literal is prefers) for its in order for prefers in (True, False)]
        for template, literal in tried:
            its = template(context)
            try:
                found = its.apply(key if literal else tuple(map(functions._unlit_non_poison, key)), kws)
            except errors.NumbaError:
                continue
            if found is not None:
                function._impl_keys[found.args] = its.get_impl_key(found)
                taken[key] = template, literal
                return found
    return TYPED(function, context, args, kws)  # raises an error, which tells all that it tried


def refreshed(usual: Callable[[Any], None]) -> Callable[[Any], None]:
    """Return what takes a context's new declarations in, as `usual` does, but looks first whether there are any."""
    taken = dict[Any, int]()

    def refresh(context: Any) -> None:
        if taken.get(context) != _declared(context):
            usual(context)
            taken[context] = _declared(context)

    return refresh


def _declared(context: Any) -> int:
    """Return the number of declarations in the registries that a context knows."""
    registries = (*context._registries, *getattr(context, "typing_context", context)._registries)
    return sum(len(its) for registry in registries for its in vars(registry).values() if isinstance(its, list))


class ErrorContext:
    """A context manager that does what new_error_context does, which is a generator; one is made per instruction."""

    def __init__(self, text: str, *of: Any, **more: Any):
        self._said, loc = (text, of, more), more.get("loc")
        if loc is not None and not loc.filename.startswith(errors._numba_path):
            errors.loc_info.update(more)

    def __enter__(self) -> None:
        """Do nothing."""

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        """Add what was compiled to an error of numba's."""
        if isinstance(error, errors.NumbaError):
            error.add_context(errors._format_msg(*self._said))


def put_lines(block: Block, text: list[str]) -> None:
    """Add the text of a block's instructions as Block.descr does, without a text of each in between."""
    text.append(f"{block._format_name()}:\n")
    for its in block.instructions:
        text.append("  " if isinstance(its.type, VoidType) else f"  {its.get_reference()} = ")
        its.descr(text)
        text.append("\n")


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
    (Flags, "__eq__", equal),
    (Flags, "__hash__", lambda flags: HASH),
    (event, "start_event", partial(heard, event.start_event)),
    (event, "end_event", partial(heard, event.end_event)),
    (functions.BaseFunction, "get_call_type", type_of_call),
    (base.BaseContext, "refresh", refreshed(base.BaseContext.refresh)),
    (BaseContext, "refresh", refreshed(BaseContext.refresh)),
    (lowering, "new_error_context", ErrorContext),
    (typeinfer, "new_error_context", ErrorContext),
    (Block, "descr", put_lines),
    (postproc.PostProcessor, "run", prepared),
    (base, "_has_loc", lru_cache(1000)(base._has_loc)),
    (ir.Inst, "_rec_list_vars", variables_in),
    (NumpyRulesArrayOperator, "generic", of_arrays),
    (NRTContext, "get_meminfos", holders_in),
    (arrayobj, "raise_with_shape_context", shapes_differ),
    (errors, "termcolor", partial(SimpleNamespace, errmsg=str, filename=str)),  # of errors by which it tries types
)


@contextmanager
def shorter_ways() -> Iterator[None]:
    """Replace these functions of numba, and turn Python's garbage collection off, within the block."""
    lent = [its for its in LENT if hasattr(its[0], its[1])]  # numba's versions differ
    usual = [(owner, name, getattr(owner, name)) for owner, name, _ in lent]
    collects = gc.isenabled()
    gc.disable()
    for owner, name, shorter in lent:
        setattr(owner, name, shorter)
    try:
        yield
    finally:
        for owner, name, its in usual:
            setattr(owner, name, its)
        if collects:
            gc.enable()
