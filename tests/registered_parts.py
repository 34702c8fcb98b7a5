"""A file for --plugin that registers a servo, an estimator and a planner; all three fly."""

from typing import Literal

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.trajectories import PiecewisePolynomial

import ortilo_drake as od


class OwnServoSettings(od.Frozen):
    """Settings of the servo."""

    kind: Literal["own_servo"] = "own_servo"


class OwnServo(LeafSystem):
    """A cascade from position to torque about the reference, at heading 0."""

    def __init__(self, scenario: od.Belief):
        super().__init__()
        self._vehicle = scenario.vehicle
        self._estimate = self.DeclareVectorInputPort("estimate", 15)
        self._reference = self.DeclareVectorInputPort("reference", 9)
        self.DeclareVectorOutputPort("control", 4, self._calc_control)

    def _calc_control(self, context: Context, output: BasicVector) -> None:
        x, r = self._estimate.Eval(context), self._reference.Eval(context)
        a = 1.0 * (r[:3] - x[:3]) + 1.6 * (r[3:6] - x[6:9])
        angles = np.array([-a[1] / 9.81, a[0] / 9.81, 0.0])
        torque = np.array(self._vehicle.inertia) * (20.0 * (angles - x[3:6]) - 9.0 * x[9:12])
        output.SetFromVector([self._vehicle.hover_thrust + self._vehicle.mass * a[2], *torque])


class OwnEstimatorSettings(od.Frozen):
    """Settings of the estimator."""

    kind: Literal["own_estimator"] = "own_estimator"


class OwnEstimator(LeafSystem):
    """An estimator that always returns the initial state."""

    def __init__(self, scenario: od.Belief, xbar_0: np.ndarray):
        super().__init__()
        self.DeclareVectorInputPort("imu", scenario.samples("imu") and 11)
        self.DeclareVectorOutputPort(
            "estimate", 12, lambda context, output: output.SetFromVector(xbar_0[:12]), {self.nothing_ticket()}
        )
        self.DeclareVectorOutputPort(
            "covariance", 144, lambda context, output: output.SetFromVector(np.eye(12).ravel()), {self.nothing_ticket()}
        )


class OwnPlannerSettings(od.Frozen):
    """Settings of the planner, with the duration of the hover [s]."""

    kind: Literal["own_planner"] = "own_planner"
    duration: float = 1.0


def make_path(scenario: od.Belief) -> PiecewisePolynomial:
    """Return a path that stays at one point in the middle of the room."""
    return PiecewisePolynomial.FirstOrderHold([0.0, scenario.planner.duration], np.tile([[8.0], [1.0], [1.5]], 2))


od.register_servo("own_servo", OwnServoSettings, OwnServo)
od.register_estimator("own_estimator", OwnEstimatorSettings, OwnEstimator)
od.register_planner("own_planner", OwnPlannerSettings, make_path)
