"""The LQ servo of a plant whose commands act late."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from ortilo_drake.model.signals import N_I, N_U, N_XBAR, REFERENCE_SIZE
from ortilo_drake.model.vehicle import Vehicle
from ortilo_drake.onboard.servo.augmented_gain import delayed_gain
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.scenario import LqServo


class AugmentedServo(LeafSystem):
    """u_k from the estimate, the reference and the commands on the way, see augmented_gain.py.

        u_k = servo_control(xhat, r; L_x) - sum_j L_j (u_{k-j} - u_r),   u_r what holds the reference

    Ports:
        estimate (15), reference (9), force (3; only where an estimator finds one), control (4, output): as LqServo_'s.

    State (discrete, updated each tick): u_{k-1}, ..., u_{k-d}, at first those of hover.

    Args:
        settings: form, yaw and weights.
        vehicle: mass and inertia of the model.
        h: tick [s].
        delay: from the tick of a command to when it acts [s].
        takes_force: whether it is told the force.
    """

    def __init__(self, settings: LqServo, vehicle: Vehicle, h: float, delay: float, takes_force: bool):
        super().__init__()
        self.set_name("augmented_servo")
        L = delayed_gain(vehicle, settings.weights, h, delay, settings.yaw)
        self._L_x, self._L_u = np.ascontiguousarray(L[:, :N_XBAR]), L[:, N_XBAR:]
        self._law = self._L_x, vehicle.mass, settings.yaw, settings.form == "error"
        d = self._L_u.shape[1] // N_U
        self._estimate = self.DeclareVectorInputPort("estimate", N_XBAR)
        self._reference = self.DeclareVectorInputPort("reference", REFERENCE_SIZE)
        self._force = self.DeclareVectorInputPort("force", N_I) if takes_force else None
        self.DeclareDiscreteState(np.tile([vehicle.hover_thrust, 0.0, 0.0, 0.0], d))
        self.DeclarePeriodicDiscreteUpdateEvent(h, 0.0, self._update)
        needs = {self._estimate.ticket(), self._reference.ticket(), self.xd_ticket()}
        needs |= {self._force.ticket()} if self._force is not None else set()
        self._control = self.DeclareVectorOutputPort("control", N_U, self._calc_control, prerequisites_of_calc=needs)

    def _calc_control(self, context: Context, output: BasicVector) -> None:
        reference = self._reference.Eval(context)
        known = () if self._force is None else (self._force.Eval(context),)
        resting = servo_control(np.zeros(N_XBAR), reference, np.zeros_like(self._L_x), *self._law[1:], *known)
        on_the_way = context.get_discrete_state_vector().value().reshape(-1, N_U) - resting
        u = servo_control(self._estimate.Eval(context), reference, *self._law, *known)
        output.set_value(u - self._L_u @ on_the_way.ravel())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        before = context.get_discrete_state_vector().value()
        values.set_value(np.concatenate((self._control.Eval(context), before))[: before.size])
