"""A sensor that is a function of the true state and of noise; most registered sensors need no System."""

from collections.abc import Callable

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.clock import tick_of
from ortilo_drake.model.signals import ARRIVED, N_X, PAYLOAD, STAMP
from ortilo_drake.world.noise import normals, stream_id

Measure = Callable[[np.ndarray, np.ndarray, float], np.ndarray | list[float] | None]


class StateSensor(LeafSystem):
    """A memoryless sensor of the state, of scalar type float, whose noise is a function of the seed in its Context.

    Ports:
        state (12): x of the vehicle.
        <name> (2 + n, output): [1, t_k, payload]; zeros where the sensor gives nothing.

    Parameters of the Context:
        seed (abstract, int): any seed that a scenario allows; a numeric parameter could hold no more than 2^53.

    Args:
        name: the sensor's name; its noise stream has that name too.
        payload: n.
        noises: number of standard normal numbers that a message takes.
        measure: (true x (12), standard normal numbers, t_k [s]) -> payload (n), or None where the sensor gives nothing.
        seed: seed of all noise in a default Context.
        h: tick [s].
    """

    def __init__(self, name: str, payload: int, noises: int, measure: Measure, seed: int, h: float):
        super().__init__()
        self.set_name(name)
        self._seed = self.DeclareAbstractParameter(Value[object](seed))
        self._measure, self._noises, self._h, self._stream = measure, noises, h, stream_id(name)
        self._state = self.DeclareVectorInputPort("state", N_X)
        needs = {self._state.ticket(), self.time_ticket(), self.all_parameters_ticket()}
        self.DeclareVectorOutputPort(name, PAYLOAD + payload, self._calc, prerequisites_of_calc=needs)

    def seed_in(self, context: Context) -> int:
        """Return the seed in a context of this system."""
        seed: int = context.get_abstract_parameter(self._seed).get_value()
        return seed

    def set_seed_in(self, context: Context, seed: int) -> None:
        """Set the seed in a context of this system."""
        context.get_mutable_abstract_parameter(self._seed).set_value(seed)

    def _calc(self, context: Context, output: BasicVector) -> None:
        time = context.get_time()
        v = normals(self.seed_in(context), self._stream, tick_of(time, self._h), self._noises)
        payload = self._measure(self._state.Eval(context), v, time)
        message = np.zeros(output.size())
        if payload is not None:
            message[ARRIVED], message[STAMP], message[PAYLOAD:] = 1.0, time, payload
        output.set_value(message)
