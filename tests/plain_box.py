"""A box computed by the plain source of its functions, with inputs given by the test."""

from typing import Any

import numpy as np

from ortilo_drake.loop.element import Box, takes
from ortilo_drake.loop.plain import plain_source
from ortilo_drake.loop.wiring import check_values


class PlainBox:
    """The output and the state of a box whose functions are called in plain Python.

    Args:
        box: the box.
        helpers: whether compiled functions that the box's functions call also run as plain source.
    """

    def __init__(self, box: Box, helpers: bool = False):
        check_values(box)
        element, given = box.element, box.given
        self.n = np.zeros(1, element.dtype).view(np.recarray)[0]
        for name, value in given.numbers.items():
            self.n[name] = value
        self.state = {name: np.array(value, dtype=float) for name, value in given.start.items()}
        self.tables = {its.name: np.array(given.tables[its.name], its.kind, order="C") for its in element.arrays}
        self._own = self.state | self.tables | {name: np.zeros(shape) for name, shape in box.work.items()}
        self._own |= {group.name: group.filled(self.n, self.tables.__getitem__) for group in element.groups}
        self._functions, self.out = element.functions, np.zeros(box.size)
        if helpers:
            self._functions = {what: plain_source(function) for what, function in element.functions.items()}

    def say(self, k: int = 0, seed: int = 0, **inputs: np.ndarray) -> np.ndarray:
        """Return the output in a tick."""
        self._call("out", k, seed, inputs)
        return self.out.copy()

    def step(self, k: int = 0, seed: int = 0, **inputs: np.ndarray) -> None:
        """Advance the state to the next tick."""
        self._call("step", k, seed, inputs)

    def _call(self, what: str, k: int, seed: int, inputs: dict[str, np.ndarray]) -> None:
        known: dict[str, Any] = {"n": self.n, "k": k, "seed": seed, "seeds": np.full(k + 1, seed), "out": self.out}
        known |= self._own | inputs
        self._functions[what](**{name: known[name] for name in takes(self._functions[what])})
