"""The true velocities as a message, for the scenarios that lend them to the servo as the authors did."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from ortilo_drake.model.signals import N_X, VELOCITY_SIZE


class TrueVelocity(LeafSystem):
    """Sends v_WB and the Euler rates, without noise or loss.

    Ports:
        state (12): x of the vehicle.
        velocity (8, output): the velocity message, see model/signals.py.
    """

    def __init__(self) -> None:
        super().__init__()
        self.set_name("true_velocity")
        self._state = self.DeclareVectorInputPort("state", N_X)
        self.DeclareVectorOutputPort(
            "velocity",
            VELOCITY_SIZE,
            self._calc_velocity,
            prerequisites_of_calc={self._state.ticket(), self.time_ticket()},
        )

    def _calc_velocity(self, context: Context, output: BasicVector) -> None:
        x = self._state.Eval(context)
        output.SetFromVector(np.concatenate(([1.0, context.get_time()], x[6:12])))
