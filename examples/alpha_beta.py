"""Fly an estimator of your own: an alpha-beta filter on UWB ranges, carried by the IMU between them.

    python examples/alpha_beta.py

An estimator is any System with inputs named after the messages that it wants (layouts: ortilo_drake/model/signals.py)
and outputs `estimate` (p_WB, rpy, v_WB, Euler rates: 12) and `covariance` (144). This one flies scenario 1 without its
blackouts, in which it could only keep its velocity.
"""

import numpy as np
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

import ortilo_drake as od

ALPHA, BETA = 0.3, 0.05  # shares of a position error that correct position and velocity
SD = np.repeat([0.1, 0.01, 0.1, 0.05], 3)  # what it says of its error: it computes none
G_W = np.array([0.0, 0.0, -9.81])


class AlphaBeta(LeafSystem):
    """Position and velocity by an alpha-beta filter; attitude and rates straight from the IMU."""

    def __init__(self, scenario: od.Belief, xbar_0: np.ndarray):
        super().__init__()
        self._h, self._period = scenario.h, scenario.every("uwb") * scenario.h
        self._anchors = scenario.load_room().anchor_positions
        self._uwb = self.DeclareVectorInputPort("uwb", 2 + 2 * len(self._anchors))
        self._imu = self.DeclareVectorInputPort("imu", 11)
        self.DeclareStateOutputPort("estimate", self.DeclareDiscreteState(xbar_0[:12]))
        self.DeclareVectorOutputPort("covariance", 144, self._calc_covariance, {self.nothing_ticket()})
        self.DeclarePeriodicDiscreteUpdateEvent(self._h, 0.0, self._update)

    def _calc_covariance(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(np.diag(SD**2).ravel())

    def _update(self, context: Context, values: DiscreteValues) -> None:
        x = np.array(context.get_discrete_state_vector().value())
        p, v = x[0:3], x[6:9]
        imu, uwb = self._imu.Eval(context), self._uwb.Eval(context)
        rpy, w_WB_B, f_B = imu[2:5], imu[5:8], imu[8:11]
        if uwb[0]:
            error = self._position_error(p, *np.split(uwb[2:], 2))
            p, v = p + ALPHA * error, v + BETA / self._period * error
        attitude = RollPitchYaw(rpy)
        a = attitude.ToRotationMatrix() @ f_B + G_W
        rates = attitude.CalcRpyDtFromAngularVelocityInChild(w_WB_B)
        values.set_value(0, np.concatenate([p + self._h * v + self._h**2 / 2 * a, rpy, v + self._h * a, rates]))

    def _position_error(self, p: np.ndarray, ranges: np.ndarray, there: np.ndarray) -> np.ndarray:
        """Return the position that the ranges give minus p: one Gauss-Newton step."""
        from_anchor = p - self._anchors[there > 0]
        distance = np.linalg.norm(from_anchor, axis=1)
        gradients = from_anchor / distance[:, np.newaxis]
        return np.linalg.lstsq(gradients, ranges[there > 0] - distance, rcond=None)[0]


def main(**settings: object) -> od.Flight:
    """Fly it, and print the verdict beside the paper's filter."""
    settings = {"uwb__link__blackouts": []} | settings
    flight = od.fly("imu_uwb", estimator=AlphaBeta, **settings)
    print("alpha-beta:    ", flight)
    print("Kalman filter: ", od.fly("imu_uwb", **settings))
    return flight


if __name__ == "__main__":
    main()
