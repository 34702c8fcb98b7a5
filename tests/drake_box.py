"""A box that Drake plays as one system, with inputs fixed by the test."""

from typing import Any

import numpy as np

from ortilo_drake.loop.diagram import system_of
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.loop.wiring import Wiring


class PlayedBox:
    """The output and the state of a box that Drake plays.

    Args:
        box: the box.
        h: tick [s].
        seed: seed of all noise.
        inputs: inputs of the box, by name, until `fix` changes them.

    Attributes:
        system: Drake system that plays the box.
        context: Context of the system.
    """

    def __init__(self, box: Box, h: float, seed: int = 0, **inputs: np.ndarray):
        own = box.with_inputs(**{name: name for name in inputs})
        self.system: Any = system_of(Wiring([own, *(outside(name, np.size(v)) for name, v in inputs.items())]), h)
        self._inputs, self._said, self._h = inputs, next(iter(box.parts), box.name), h
        self._begin(seed)

    def _begin(self, seed: int) -> None:
        self.context = self.system.CreateDefaultContext()
        self.system.set_seed_in(self.context, seed)
        self.fix(**self._inputs)

    def on_autodiff(self, seed: int = 0) -> "PlayedBox":
        """Return the same box with AutoDiffXd, in a new Context."""
        other = PlayedBox.__new__(PlayedBox)
        other.__dict__.update(self.__dict__)
        other.system = self.system.ToAutoDiffXd()
        other._begin(seed)
        return other

    def fix(self, **inputs: np.ndarray) -> None:
        """Fix inputs by name, from now on."""
        for name, values in inputs.items():
            self.system.GetInputPort(name).FixValue(self.context, values)

    def say(self, k: int = 0, **inputs: np.ndarray) -> np.ndarray:
        """Return the output in a tick, or its first part if the output has parts."""
        self.fix(**inputs)
        self.context.SetTime(k * self._h)
        return np.array(self.system.GetOutputPort(self._said).Eval(self.context))

    def step(self) -> np.ndarray:
        """Advance the state to the next tick, and return it."""
        state = self.system.EvalUniquePeriodicDiscreteUpdate(self.context).value().copy()
        self.context.SetDiscreteState(state)
        return state
