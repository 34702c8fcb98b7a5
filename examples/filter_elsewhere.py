"""The intermittent Kalman filter on another vehicle: Drake's QuadrotorPlant, its position fixes lost in bursts.

    python examples/filter_elsewhere.py

Only the filter is the laboratory's: Drake linearises its plant, makes the gain and flies. The regulator reads the
estimate alone. The attitude arrives in every tick; of ten position fixes a second 60 % are lost, a second at a time.
"""

from functools import partial

import numpy as np
from pydrake.examples import QuadrotorPlant
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import Linearize, LogVectorOutput, MatrixGain
from scipy.signal import cont2discrete

import ortilo_drake as od

H, SECONDS, EVERY, LOSS, BURST = 0.02, 60.0, 5, 0.6, 1.0  # s, s, ticks of a fix, lost share, its mean length [s]
SD = {"position": 0.05, "attitude": 0.01, "thrust": 0.01}  # m, rad, and N of each rotor in each tick
SEES = {"position": slice(0, 3), "attitude": slice(3, 6)}


class World(LeafSystem):
    """Rotors that hold the control for a tick, with noise, and two sensors with messages [arrived, y]."""

    def __init__(self, hover: np.ndarray, seed: int):
        super().__init__()
        rng, lost, leave = np.random.default_rng(seed), False, EVERY * H / BURST
        ticks = round(SECONDS / H) + 1
        self.hover, self.noise, self.arrives = hover, rng.standard_normal((ticks, 10)), np.zeros(ticks)
        for k in range(0, ticks, EVERY):
            lost = rng.random() >= leave if lost else rng.random() < leave * LOSS / (1.0 - LOSS)
            self.arrives[k] = not lost
        self.DeclareVectorInputPort("state", 12)
        self.DeclareVectorInputPort("u", 4)
        self.DeclareStateOutputPort("thrust", self.DeclareDiscreteState(4))
        self.DeclarePeriodicDiscreteUpdateEvent(H, 0.0, self._hold)
        for name in SEES:
            self.DeclareVectorOutputPort(name, 4, partial(self._measure, name))

    def _hold(self, context, discrete_state) -> None:
        push = SD["thrust"] * self.noise[round(context.get_time() / H), 6:]
        discrete_state.set_value(self.hover + self.GetInputPort("u").Eval(context) + push)

    def _measure(self, name: str, context, output) -> None:
        k, x = round(context.get_time() / H), self.GetInputPort("state").Eval(context)
        y = x[SEES[name]] + SD[name] * self.noise[k, SEES[name]]
        output.SetFromVector([1.0 if name == "attitude" else self.arrives[k], *y])


def main(seed: int = 0) -> dict[str, float]:
    """Hover, print the errors and return them."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(QuadrotorPlant())
    hover, context = np.full(4, plant.m() * plant.g() / 4.0), plant.CreateDefaultContext()
    plant.get_input_port().FixValue(context, hover)
    at_hover = Linearize(plant, context)
    Phi, Gamma, *_ = cont2discrete((at_hover.A(), at_hover.B(), np.eye(12), np.zeros((12, 4))), H)
    L, _ = DiscreteTimeLinearQuadraticRegulator(Phi, Gamma, np.diag([10.0] * 6 + [1.0] * 6), np.eye(4))
    W, C, P_0 = SD["thrust"] ** 2 * Gamma @ Gamma.T, np.eye(6, 12), 0.01 * np.eye(12)
    sensors = {name: (C[rows], SD[name] ** 2 * np.eye(3)) for name, rows in SEES.items()}
    kalman = builder.AddSystem(od.IntermittentKalmanFilter(Phi, Gamma, W, sensors, H, P_0))
    servo, world = builder.AddSystem(MatrixGain(-L)), builder.AddSystem(World(hover, seed))
    for said, reader in (
        (kalman.GetOutputPort("estimate"), servo.get_input_port()),
        (servo.get_output_port(), kalman.GetInputPort("u")),
        (servo.get_output_port(), world.GetInputPort("u")),
        (world.GetOutputPort("thrust"), plant.get_input_port()),
        (plant.get_output_port(), world.GetInputPort("state")),
        *((world.GetOutputPort(name), kalman.GetInputPort(name)) for name in sensors),
    ):
        builder.Connect(said, reader)
    ports = (plant.get_output_port(), kalman.GetOutputPort("estimate"), kalman.GetOutputPort("covariance"))
    logs = [LogVectorOutput(port, builder, publish_period=H) for port in ports]
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(SECONDS)
    x, xhat, P = (log.FindLog(simulator.get_context()).data().T for log in logs)
    error = (x - xhat)[:, :3]
    nees = np.mean([e @ np.linalg.solve(p.reshape(12, 12)[:3, :3], e) for e, p in zip(error, P, strict=True)])
    rms, hover_rms = (float(np.sqrt(np.mean(np.sum(its**2, axis=1)))) for its in (error, x[:, :3]))
    print(f"estimate {rms:.3f} m off (RMS), NEES {nees:.1f} (3 if consistent), {hover_rms:.3f} m from its place")
    return {"rms": rms, "nees": float(nees), "hover_rms": hover_rms}


if __name__ == "__main__":
    main()
