"""A box that Drake plays as one system, with inputs given in each call."""

from typing import Any

import numpy as np

from ortilo_drake.loop.diagram import system_of
from ortilo_drake.loop.element import Box, Values, outside
from ortilo_drake.loop.wiring import Wiring


class PlayedBox:
    """The outputs and the state of a box that Drake plays; with AutoDiffXd if an input is AutoDiffXd.

    Every call gives all inputs of the box, with the same sizes as in the first call.

    Args:
        box: the box.
        h: tick [s].
        seed: seed of all noise.
        **start: first states that replace the box's own.
    """

    def __init__(self, box: Box, h: float = 1.0 / 30.0, seed: int = 0, **start: np.ndarray):
        self._box, self._h, self._seed, self._start, self._system = box, h, seed, start, None

    def say(self, k: int = 0, **inputs: np.ndarray) -> np.ndarray:
        """Return the values of all output ports in a tick, one after the other."""
        self._fix(k, inputs)
        return np.concatenate([self._system.GetOutputPort(name).Eval(self._context) for name in self._ports])

    def parts(self, k: int = 0, **inputs: np.ndarray) -> dict[str, np.ndarray]:
        """Return the value of each output port in a tick, by the port's name."""
        self._fix(k, inputs)
        return {name: self._system.GetOutputPort(name).Eval(self._context).copy() for name in self._ports}

    def step(self, k: int = 0, **inputs: np.ndarray) -> None:
        """Advance the state to the next tick."""
        self._fix(k, inputs)
        self._context.SetDiscreteState(self._system.EvalUniquePeriodicDiscreteUpdate(self._context))

    def state(self, name: str) -> np.ndarray:
        """Return the state of this name."""
        return np.array(self._system.state_of(self._context, self._box.name, name))

    def _fix(self, k: int, inputs: dict[str, np.ndarray]) -> None:
        if self._system is None:
            self._make(inputs)
        self._context.SetTime(k * self._h)
        for name, values in inputs.items():
            self._system.GetInputPort(name).FixValue(self._context, np.asarray(values))

    def _make(self, inputs: dict[str, np.ndarray]) -> None:
        around = [outside(name, len(values)) for name, values in inputs.items()]
        wiring = Wiring([self._box.with_inputs(**{name: name for name in inputs}), *around])
        system: Any = system_of(wiring, self._h)
        differentiates = any(np.asarray(values).dtype == object for values in inputs.values())
        self._system = system.ToAutoDiffXd() if differentiates else system
        self._context, self._ports = self._system.CreateDefaultContext(), list(self._box.parts) or [self._box.name]
        self._system.set_seed_in(self._context, self._seed)
        for name, values in self._start.items():
            self._system.give(self._context, {self._box.name: Values(start={name: values})})
