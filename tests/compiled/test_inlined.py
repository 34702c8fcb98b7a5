"""Helpers that are compiled for their callers alone: they compute the same, and numba's own way comes back."""

import gc
import math
import re
import sys
from dataclasses import replace
from operator import add
from typing import Any

import llvmlite.binding as llvm
import numpy as np
import pytest
from llvmlite import ir
from numba import njit, types
from numba.core.compiler import Flags, run_frontend
from numba.core.errors import TypingError
from numba.core.event import install_recorder
from numba.core.registry import cpu_target
from numba.core.target_extension import jit_registry, target_registry
from numba.extending import overload, register_jitable

from ortilo_drake.compiled.inlined import OPTIONS, Inlined, OnlyLinked, helpers_only_linked
from ortilo_drake.compiled.shorter import LENT, shorter_ways
from ortilo_drake.loop.element import Box, Element, constant
from ortilo_drake.loop.native import known_to
from ortilo_drake.loop.player import Player
from ortilo_drake.loop.raised import ElementError
from ortilo_drake.loop.wiring import Wiring


@register_jitable
def helper(x: float) -> float:
    return x / 3.0 + 0.1


def caller(x: float) -> float:
    return helper(helper(x)) - x


def linked_only(compiled: object) -> bool:
    """Whether some code that is linked into a compiled function has no addresses of its own."""
    (result,) = compiled.overloads.values()  # type: ignore[attr-defined]
    return any(isinstance(its, OnlyLinked) for its in result.library._linking_libraries)


def test_a_helper_is_only_linked_there_and_gives_the_bits_of_python() -> None:
    with helpers_only_linked():
        there = njit("float64(float64)")(caller)
    assert linked_only(there)
    assert there(0.7) == caller(0.7)


@njit
def shared(x: float) -> float:
    return x / 3.0 + 0.1


def caller_of_shared(x: float) -> float:
    return shared(shared(x)) - x


def test_an_njit_function_is_compiled_apart_for_elements_and_python_can_call_it_after() -> None:
    there = njit("float64(float64)", pipeline_class=Inlined)(caller_of_shared)
    assert linked_only(there)
    assert not shared.signatures
    assert shared(0.7) == shared.py_func(0.7)


def failing() -> None:
    with helpers_only_linked():
        raise ZeroDivisionError


def lent() -> list[object]:
    return [jit_registry[target_registry["cpu"]], gc.isenabled(), *(getattr(owner, name) for owner, name, _ in LENT)]


def test_numbas_own_way_comes_back_also_after_an_error() -> None:
    usual = lent()
    with pytest.raises(ZeroDivisionError):
        failing()
    assert usual == lent()


def put_slice(source: np.ndarray, target: np.ndarray) -> None:
    target[1:] = source


def test_a_slice_is_assigned_without_text_and_one_of_another_shape_is_refused_as_in_numpy() -> None:
    with helpers_only_linked():
        there = njit("void(float64[::1], float64[::1])")(put_slice)
    target = np.zeros(3)
    there(np.array([1.0, 2.0]), target)
    assert target.tolist() == [0.0, 1.0, 2.0]
    for function in (there, put_slice):
        with pytest.raises(ValueError, match="input"):
            function(np.zeros(3), target)
    (ir,) = there.inspect_llvm().values()
    assert "PyUnicode_FromKindAndData" not in ir  # made for a text of the shapes


def test_numbas_options_are_what_its_own_properties_say() -> None:
    flags, default = Flags(), Flags()
    flags.nrt = flags.forceinline = True
    default.nrt = Flags().nrt
    own = {name: getattr(flags, name) for name in Flags.options}, hash(flags)
    with shorter_ways():
        assert (flags.values(), hash(flags)) == own
        assert flags == flags.copy()
        assert flags != Flags()
        assert default == Flags()


def sum_of_scaled(a: np.ndarray, pairs: tuple[tuple[float, np.ndarray], ...], k: int) -> float:
    total = 0.5 * k
    for factor, b in pairs:
        total += (a[k:] + factor * b[k:] - True).sum() ** 2
    return total


def test_variables_are_those_that_numba_finds_itself() -> None:
    code = [its for block in run_frontend(sum_of_scaled).blocks.values() for its in block.body]
    own = [[its.name for its in statement.list_vars()] for statement in code]
    assert max(len(names) for names in own) > 2
    with shorter_ways():
        assert own == [[its.name for its in statement.list_vars()] for statement in code]


def test_numbers_and_arrays_are_typed_and_counted_the_same_in_shorter_ways() -> None:
    a, b = np.array([0.1, 0.7, 1.3]), np.array([0.3, -0.2, 0.9])
    pairs = ((0.3, b), (1.7, a))
    shorter = njit(sum_of_scaled)
    with shorter_ways():
        shorter(a, pairs, 1)
    assert shorter(a, pairs, 1) == pytest.approx(sum_of_scaled(a, pairs, 1), rel=1e-14)
    (result,) = shorter.overloads.values()
    assert result.signature.return_type == types.float64
    held = b.copy()
    for _ in range(100):
        shorter(a, ((0.3, held), (1.7, a)), 1)
    assert sys.getrefcount(held) == 2


def growing(a: np.ndarray, k: int) -> float:
    total = scale = 1.0
    while total < 5.0:
        unused = total
        for i in range(k):
            scale = a[i] if a[i] > scale else unused
            total += scale
    return total + scale


@pytest.mark.parametrize("dels", [False, True])
def test_code_is_prepared_as_numba_prepares_it(dels: bool) -> None:
    own = run_frontend(growing, emit_dels=dels)
    with shorter_ways():
        its = run_frontend(growing, emit_dels=dels)
    assert its.dump_to_string() == own.dump_to_string()
    assert its.variable_lifetime.livemap == own.variable_lifetime.livemap


@pytest.mark.parametrize("function", [add, pow, math.sqrt, abs, np.zeros])
def test_a_call_has_the_type_that_numba_finds_also_when_it_is_typed_again(function: object) -> None:
    vector, two, context = types.float64[::1], types.literal(2), cpu_target.typing_context
    asked = [(types.float64,), (two,), (types.float64, two), (two, types.int32), (vector, two), (vector, vector)]
    context.refresh()
    its = context.resolve_value_type(function)

    def found(args: tuple[types.Type, ...]) -> object:
        try:
            return its.get_call_type(context, args, {})
        except TypingError:
            return None

    own = [found(args) for args in asked]
    assert any(own)
    assert not all(own)
    with shorter_ways():
        assert [found(args) for args in asked * 2] == own * 2


def test_listeners_hear_that_passes_run_but_not_each_call_of_llvm() -> None:
    with shorter_ways(), install_recorder("numba:run_pass") as passes, install_recorder("numba:llvm_lock") as calls:
        njit("float64(float64)")(shared.py_func)
    assert passes.buffer
    assert not calls.buffer


def test_what_is_declared_after_a_compilation_is_known_to_the_next() -> None:
    def declared_later(x: float) -> float:
        raise NotImplementedError

    with shorter_ways():
        njit("float64(float64)")(shared.py_func)
        overload(declared_later)(lambda x: lambda x: x + 2.0)
        assert njit(lambda x: declared_later(x))(1.0) == 3.0


def test_an_error_says_the_same_in_shorter_ways() -> None:
    def wrong(x: Any) -> Any:
        y = x + 1.0
        return y.nothing

    def said() -> str:
        with pytest.raises(TypingError) as raised:
            njit("float64(float64)")(wrong)
        return re.sub(r"\x1b\[\d*m", "", str(raised.value))  # without colours

    own = said()
    assert "typing of get attribute at" in own
    with shorter_ways():
        assert said() == own


def test_a_block_written_in_shorter_ways_is_the_same_code() -> None:
    module, number = ir.Module("module"), ir.DoubleType()
    function = ir.Function(module, ir.FunctionType(number, [number.as_pointer(), ir.IntType(64)]), "name with spaces")
    first, second, last = (function.append_basic_block(name) for name in ("first", "the second", "last"))
    builder = ir.IRBuilder(first)
    builder.comment("a comment")
    x = builder.load(function.args[0], typ=number)
    builder.store(builder.fmul(x, number(2.0)), function.args[0])
    builder.switch(function.args[1], second).add_case(3, last)
    builder.position_at_end(second)
    builder.cbranch(builder.fcmp_ordered("<", x, number(0.0)), last, second)
    builder.position_at_end(last)
    found = builder.phi(number)
    found.add_incoming(x, first)
    found.add_incoming(number(1.0), second)
    builder.ret(builder.select(builder.fcmp_ordered(">", found, x), found, x))
    own = str(llvm.parse_assembly(str(module)))
    with shorter_ways():
        text = str(module)
    assert str(llvm.parse_assembly(text)) == own
    assert own.count("br ") == 1


@register_jitable
def fourth(x: np.ndarray) -> float:
    return x[3]


@register_jitable
def fourth_of_all(x: np.ndarray) -> float:
    return fourth(x)


@njit
def compiled_fourth(x: np.ndarray) -> float:
    return x[3]


@njit
def compiled_fourth_of_all(x: np.ndarray) -> float:
    return compiled_fourth(x)


@pytest.mark.parametrize("allocates", [False, True])
@pytest.mark.parametrize("helper", [fourth_of_all, compiled_fourth_of_all])
def test_helpers_of_a_checked_element_check_their_indices(helper: Any, allocates: bool) -> None:
    def read(x: np.ndarray, out: np.ndarray) -> None:
        out[0] = helper(x)

    reader = Box("reader", Element("reader", out=read, allocates=allocates), 1)
    boxes = [constant("x", [1.0, 2.0]), constant("end", -1.0), reader]
    player = Player(Wiring(boxes, checked=True), ("reader",), "end")
    with pytest.raises(ElementError, match=r"\(test_inlined.py, line \d+\): IndexError: index is out of bounds$"):
        player.fly(np.zeros(1, np.int64), player.rows(1))


def test_an_element_is_compiled_in_the_same_way_after_a_checked_one() -> None:
    """The options of a checked element were those of all that came after it."""
    element = Element("reader", out=lambda out: None, allocates=True)
    options = dict(OPTIONS)
    for checked in (True, False):
        (function,) = known_to(replace(element, checked=checked)).values()
        assert bool(function.targetoptions["boundscheck"]) == checked
    assert options == OPTIONS
