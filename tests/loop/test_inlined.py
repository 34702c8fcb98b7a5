"""Helpers that are compiled for their callers alone: they compute the same, and numba's own way comes back."""

import gc
from typing import Any

import numpy as np
import pytest
from numba import njit
from numba.core import errors
from numba.core.compiler import Flags
from numba.core.target_extension import jit_registry, target_registry
from numba.extending import register_jitable
from numba.np import arrayobj

from ortilo_drake.loop.inlined import Inlined, OnlyLinked, helpers_only_linked, values_of


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


def lent() -> tuple[Any, ...]:
    processor = jit_registry[target_registry["cpu"]]
    return processor, errors.termcolor, gc.isenabled(), Flags.values, arrayobj.raise_with_shape_context


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
    flags = Flags()
    flags.nrt = flags.forceinline = True
    assert values_of(flags) == {name: getattr(flags, name) for name in Flags.options}
    with helpers_only_linked():
        assert flags == flags.copy()
        assert flags != Flags()
