"""Elements that make arrays: the same numbers as plain source, nothing atomic, and every array given back."""

import resource

import numpy as np
import pytest
from numba.extending import register_jitable

from ortilo_drake.loop.calls import compiled_calls
from ortilo_drake.loop.element import Array, Box, Element, Values
from ortilo_drake.loop.native import known_to, native_text
from ortilo_drake.loop.player import Memory
from ortilo_drake.loop.source import places_of
from ortilo_drake.loop.wiring import Wiring

N, CALLS = 65_536, 1_500  # 2 GiB in all if nothing were given back


@register_jitable
def halves(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    made = x[x > 0.0]
    return made[: made.size // 2], np.concatenate((made, x))


def made_out(x: np.ndarray, out: np.ndarray) -> None:
    first, both = halves(x)
    rows = [first, both]  # a list has numba's own memory
    for i in range(2):
        rows.append(rows[i] + 1.0)
    out[0] = 0.0
    for row in rows:
        out[0] += np.sum(row)


MADE = Element("made", out=made_out, tables=(Array("x"),), allocates=True)
VALUES = np.cos(np.arange(float(N)))


def test_every_array_is_given_back_and_the_numbers_are_those_of_plain_source() -> None:
    wiring = Wiring([Box("made", MADE, 1, Values(tables={"x": VALUES}))])
    memory = Memory(wiring, places_of(wiring))
    call = compiled_calls(wiring, {"say": [(wiring.boxes["made"], "out")]})["say"]
    expected = np.zeros(1)
    made_out(VALUES, expected)
    call(memory, memory.S, memory.Y, 0)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(CALLS):
        call(memory, memory.S, memory.Y, 0)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 65_536  # [KiB]
    assert memory.Y[0] == pytest.approx(expected[0], rel=1e-12)


def test_no_holder_is_counted_by_an_atomic_operation() -> None:
    known = known_to(MADE)
    exec(native_text(MADE).replace("cache=True", "cache=False"), known)
    assert "atomicrmw" not in known["out_c"]._library.get_llvm_str()
