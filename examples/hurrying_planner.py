"""Fly a planner of your own: it flies faster along the planned path while the position is uncertain.

    python examples/hurrying_planner.py

A planner is a function from the scenario to a Trajectory, or to any System with an output `reference`: r, r_dot, r_ddot
in W (9 numbers). Such a System may have as inputs `estimate` (15), `covariance` (225), `control` (4) and any message.
In a UWB blackout the position error grows faster than the time spent there, so this one spends less time.
"""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

import ortilo_drake as od

UNSURE = 0.15  # [m] standard deviation of the position from which it hurries
FASTEST, CHANGE = 1.8, 0.4  # times the planned speed, and by how much that changes in a second


class HurryingPlanner(LeafSystem):
    """Follows the scenario's own path r(s) at ds/dt = rate, which the covariance decides.

    State (discrete): s [s], rate.
    """

    def __init__(self, scenario: od.Scenario):
        super().__init__()
        self._h, self._path = scenario.h, od.path_of(scenario)
        self._covariance = self.DeclareVectorInputPort("covariance", 225)
        self._progress = self.DeclareDiscreteState([self._path.start_time(), 1.0])
        needs = {self._covariance.ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort("reference", 9, self._calc_reference, needs)
        self.DeclarePeriodicDiscreteUpdateEvent(self._h, 0.0, self._update)

    def _rate_change(self, context: Context, rate: float) -> float:
        P = self._covariance.Eval(context).reshape(15, 15)
        wanted = FASTEST if np.sqrt(np.trace(P[:3, :3])) > UNSURE else 1.0
        return float(np.clip((wanted - rate) / self._h, -CHANGE, CHANGE))

    def _calc_reference(self, context: Context, output: BasicVector) -> None:
        s, rate = context.get_discrete_state(self._progress).value()
        r, rates = self._path.value(min(s, self._path.end_time()))[:, 0], np.zeros(6)
        if s < self._path.end_time():
            slope, curve = (self._path.EvalDerivative(s, order)[:, 0] for order in (1, 2))
            rates[:3] = slope * rate
            rates[3:] = curve * rate**2 + slope * self._rate_change(context, rate)
        output.SetFromVector(np.concatenate([r, rates]))

    def _update(self, context: Context, values: DiscreteValues) -> None:
        s, rate = context.get_discrete_state(self._progress).value()
        change = self._rate_change(context, rate)
        values.set_value(self._progress, [s + self._h * rate + self._h**2 / 2 * change, rate + self._h * change])


def main(**settings: object) -> od.Flight:
    """Fly it, and print the verdict beside that of the scenario's own planner."""
    flight, plain = od.fly("imu_uwb", planner=HurryingPlanner, **settings), od.fly("imu_uwb", **settings)
    for name, flown in (("hurrying:     ", flight), ("as it planned:", plain)):
        P = flown.data["covariance"].values[:, :3, :3]
        print(name, flown, f"least sure by {np.sqrt(np.trace(P, axis1=1, axis2=2)).max():.2f} m")
    return flight


if __name__ == "__main__":
    main()
