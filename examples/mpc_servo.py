"""Fly a servo of your own: model-predictive control, a quadratic program in every tick.

    python examples/mpc_servo.py

A servo is any System with inputs `estimate` (15) and `reference` (9) and an output `control` (4). This one minimises
a cost like the LQ servo's over 20 ticks ahead, under limits of thrust and torque that the LQ servo does not know.
"""

import numpy as np
from pydrake.solvers import MathematicalProgram, OsqpSolver
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator
from pydrake.systems.framework import BasicVector, Context, LeafSystem

import ortilo_drake as od
from ortilo_drake.model.hover import discretize, hover_A, hover_B

AHEAD = 20  # ticks
LIMITS = np.array([8.0, 1.0, 1.0, 0.5])  # of the control, about hover [N, N m]
Q = np.diag(np.repeat([6.0, 1.0, 1.0, 0.1], 3))
R = np.diag([0.02, 1.0, 1.0, 1.0])


class MpcServo(LeafSystem):
    """u_0 of  min sum_k e_k^T Q e_k + u_k^T R u_k + e_N^T S e_N,  e_{k+1} = Phi e_k + Gamma u_k,  |u_k| <= LIMITS."""

    def __init__(self, scenario: od.Belief):
        super().__init__()
        self._hover = np.array([scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0])
        self._mass = scenario.vehicle.mass
        Phi, Gamma = discretize(hover_A(), hover_B(scenario.vehicle), scenario.h)
        _, S = DiscreteTimeLinearQuadraticRegulator(Phi, Gamma, Q, R)
        self._program = program = MathematicalProgram()
        e, self._u = program.NewContinuousVariables(12, AHEAD + 1), program.NewContinuousVariables(4, AHEAD)
        self._start = program.AddLinearEqualityConstraint(np.eye(12), np.zeros(12), e[:, 0])
        for k in range(AHEAD):
            dynamics = np.hstack([Phi, Gamma, -np.eye(12)])
            program.AddLinearEqualityConstraint(dynamics, np.zeros(12), [*e[:, k], *self._u[:, k], *e[:, k + 1]])
            program.AddBoundingBoxConstraint(-LIMITS, LIMITS, self._u[:, k])
            program.AddQuadraticCost(2.0 * Q, np.zeros(12), e[:, k])
            program.AddQuadraticCost(2.0 * R, np.zeros(4), self._u[:, k])
        program.AddQuadraticCost(2.0 * S, np.zeros(12), e[:, AHEAD])
        self._solver = OsqpSolver()
        self._estimate = self.DeclareVectorInputPort("estimate", 15)
        self._reference = self.DeclareVectorInputPort("reference", 9)
        self.DeclareVectorOutputPort("control", 4, self._calc_control)

    def _calc_control(self, context: Context, output: BasicVector) -> None:
        x, (r, r_dot, a) = self._estimate.Eval(context)[:12], np.split(self._reference.Eval(context), 3)
        x_ref = np.concatenate([r, [-a[1] / 9.81, a[0] / 9.81, 0.0], r_dot, np.zeros(3)])
        self._start.evaluator().UpdateCoefficients(np.eye(12), x - x_ref)
        result = self._solver.Solve(self._program)
        feed_forward = self._hover + [self._mass * a[2], 0.0, 0.0, 0.0]
        output.SetFromVector(feed_forward + np.clip(result.GetSolution(self._u[:, 0]), -LIMITS, LIMITS))


def main(**settings: object) -> od.Flight:
    """Fly it with the projected camera, and print the verdict beside the LQ servo."""
    settings = {"camera__kind": "projected"} | settings
    flight = od.fly("imu_uwb_yolo", servo=MpcServo, **settings)
    print("MPC:     ", flight)
    print("LQ servo:", od.fly("imu_uwb_yolo", **settings))
    return flight


if __name__ == "__main__":
    main()
