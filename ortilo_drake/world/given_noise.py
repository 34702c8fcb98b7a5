"""Noise that is given instead of drawn: standard normals of each tick, for studies that perturb them.

If a seed is negative, minus the seed is the address of a tick's record of three integers of eight bytes:

    address of a directory, address of the tick's row of float32 (0 for none), seed for numbers that the row lacks

The directory says where a stream's numbers stand in a row. Flights whose row address is 0 write it: they record what
they draw. Numbers that a later flight draws beyond the directory come from its record's seed, as any noise does.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, register_jitable

from ortilo_drake.compiled.addresses import array_at
from ortilo_drake.model.input_error import InputError

MOST = 4096  # most streams in a directory
_RECORD = 3
_STREAM, _FIRST, _NUMBERS, _TICKS, _RECORD_SEEN, _LEAST_TICK = range(6)  # entry's fields; last two: for learning
_ENTRY = 6
_HEAD = 2  # what a directory begins with: its number of streams, and 1 if there were more than MOST


def _pointer_to(kind: Any) -> Any:
    @intrinsic
    def pointer(typing_context: Any, address: Any) -> Any:
        def codegen(context: Any, builder: ir.IRBuilder, signature: Any, arguments: Any) -> ir.Value:
            return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

        return types.CPointer(kind)(types.int64), codegen

    return pointer


_wholes, _floats = _pointer_to(types.int64), _pointer_to(types.float32)


@register_jitable
def seed_beside(seed: int) -> int:
    """Return the seed for the numbers that a record's row lacks."""
    return array_at(_wholes(-seed), (_RECORD,))[2]


@register_jitable
def given_numbers(seed: int, stream: np.uint64, tick: int, n: int) -> tuple[int, int]:
    """Return the address of a stream's numbers in a tick's row, and how many of the first n are there.

    The seed is minus the address of the tick's record. `tick` is the stream's own count: for a sensor faster than the
    tick, several counts belong to one record.
    """
    record = array_at(_wholes(-seed), (_RECORD,))
    size = array_at(_wholes(record[0]), (_HEAD,))
    entries = array_at(_wholes(record[0] + 8 * _HEAD), (MOST, _ENTRY))
    its, i, first, most = np.int64(stream), 0, 0, 0
    while i < size[0] and entries[i, _STREAM] != its:
        i += 1
    if record[1] == 0:
        _note(size, entries, i, its, n, seed, tick)
    elif i < size[0]:
        most = entries[i, _NUMBERS]
        first = entries[i, _FIRST] + most * (tick % entries[i, _TICKS])
    return record[1] + 4 * first, min(n, most)


@register_jitable
def number_at(address: int, i: int) -> float:
    """Return the i-th number at an address."""
    return array_at(_floats(address), (i + 1,))[i]


@register_jitable
def _note(size: np.ndarray, entries: np.ndarray, i: int, stream: int, n: int, seed: int, tick: int) -> None:
    """Record in entry i that n numbers of a stream belong to a tick; i equal to the size makes a new entry."""
    if i == MOST:
        size[1] = 1
        return
    entry = entries[i]
    if i == size[0]:
        size[0] += 1
        entry[_STREAM], entry[_TICKS] = stream, 1
    entry[_NUMBERS] = max(entry[_NUMBERS], n)
    if entry[_RECORD_SEEN] != seed:
        entry[_RECORD_SEEN], entry[_LEAST_TICK] = seed, tick
    entry[_TICKS] = max(entry[_TICKS], tick - entry[_LEAST_TICK] + 1)


class GivenNoise:
    """The places of each stream's numbers in a tick's row, and the seeds that stand for rows.

    `fly` flies once, given a seed for each tick (ticks); `flights` flights, with the seeds 0, 1, ..., find the places.
    A row has `width` numbers. `streams` is a list of (number of the stream, first place in a row, numbers, own ticks in
    a row). InputError if there are more than MOST streams.
    """

    def __init__(self, ticks: int, fly: Callable[[np.ndarray], object], flights: int):
        self._directory = np.zeros(_HEAD + MOST * _ENTRY, dtype=np.int64)
        self._records = np.zeros((ticks, _RECORD), dtype=np.int64)
        self._records[:, 0] = self._directory.ctypes.data
        self._handles = -(self._records.ctypes.data + self._records.strides[0] * np.arange(ticks))
        for seed in range(flights):
            self._records[:, 2] = seed
            fly(self._handles)
        if self._directory[1]:
            raise InputError(
                f"room.landmarks: too many: all noise must have at most {MOST} streams, a landmark has four"
            )
        entries = self._directory[_HEAD:].reshape(MOST, _ENTRY)[: self._directory[0]]
        sizes = entries[:, _NUMBERS] * entries[:, _TICKS]
        entries[:, _FIRST] = np.cumsum(sizes) - sizes
        self.streams = [tuple(entry[: _TICKS + 1].tolist()) for entry in entries]
        self.width = max(int(sizes.sum()), 2)

    def seeds(self, rows: np.ndarray) -> np.ndarray:
        """Return seeds that stand for rows of standard normal numbers (ticks, width), until the next call.

        A row's first two numbers make the seed for the numbers that the row lacks.
        """
        if rows.shape != (len(self._records), self.width) or rows.dtype != np.float32 or not rows.flags.c_contiguous:
            raise ValueError(f"rows: {rows.shape} of {rows.dtype}: must be rows of {self.width} float32 a tick")
        self._rows = rows  # keeps the memory alive
        self._records[:, 1] = rows.ctypes.data + rows.strides[0] * np.arange(len(rows))
        self._records[:, 2] = np.ascontiguousarray(rows[:, :2]).view(np.int64)[:, 0] & (2**62 - 1)
        return self._handles
