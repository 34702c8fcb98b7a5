"""The closed loop: world and onboard half joined by wires, with a log of everything at every tick."""

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, DiagramBuilder
from pydrake.systems.primitives import Multiplexer, VectorLogSink
from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.onboard import make_onboard
from ortilo_drake.diagrams.world import make_world
from ortilo_drake.model.signals import MEASUREMENT_SIZE, N_U, N_X, N_XBAR, REFERENCE_SIZE
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.scenery.meshcat_flight import MeshcatFlight

# What the log holds, in order: port -> size.
LOGGED = {
    "state": N_X,
    "control": N_U,
    "measurement": MEASUREMENT_SIZE,
    "estimate": N_XBAR,
    "covariance": N_XBAR * N_XBAR,
    "reference": REFERENCE_SIZE,
}


def make_closed_loop(
    scenario: Scenario, trajectory: Trajectory | None = None, meshcat: Meshcat | None = None
) -> Diagram:
    """Return world and onboard half in one Diagram.

    Ports:
        state (12, output), control (4, output), estimate (15, output), covariance (225, output).

    The subsystems are named world, onboard and log. The log is one VectorLogSink at the control rate over the
    signals of LOGGED, each as the filter consumed it: Drake publishes at t_k before it updates. So the logged control
    is the commanded one, whatever a lossy command link made of it.

    Args:
        scenario: the scenario.
        trajectory: the path to fly; by default what the scenario's planner plans.
        meshcat: if given, shows the flight in it.

    Raises:
        InputError: if there is no path or no servo gain.
    """
    builder = DiagramBuilder()
    world = builder.AddSystem(make_world(scenario))
    onboard = builder.AddSystem(make_onboard(scenario, trajectory))
    for k in range(onboard.num_input_ports()):
        port = onboard.get_input_port(k)
        builder.Connect(world.GetOutputPort(port.get_name()), port)
    builder.Connect(onboard.GetOutputPort("control"), world.GetInputPort("control"))

    multiplexer = builder.AddNamedSystem("log_inputs", Multiplexer(list(LOGGED.values())))
    for k, name in enumerate(LOGGED):
        source = world if name == "state" else onboard
        builder.Connect(source.GetOutputPort(name), multiplexer.get_input_port(k))
        if name in ("state", "control", "estimate", "covariance"):
            builder.ExportOutput(source.GetOutputPort(name), name)
    log = builder.AddNamedSystem("log", VectorLogSink(sum(LOGGED.values()), scenario.h))
    builder.Connect(multiplexer.get_output_port(), log.get_input_port())
    if meshcat is not None:
        display = builder.AddSystem(MeshcatFlight(meshcat, scenario.h))
        for name in ("state", "estimate", "covariance"):
            source = world if name == "state" else onboard
            builder.Connect(source.GetOutputPort(name), display.GetInputPort(name))
    diagram = builder.Build()
    diagram.set_name(scenario.name)
    return diagram


def set_hovering(diagram: Diagram, context: Context, scenario: Scenario) -> None:
    """Put the vehicle of a closed loop hovering at rest at the start of its reference."""
    onboard, world = diagram.GetSubsystemByName("onboard"), diagram.GetSubsystemByName("world")
    reference = onboard.GetOutputPort("reference").Eval(onboard.GetMyContextFromRoot(context))
    set_world_hovering(world, context, scenario, reference[0:3])


def set_world_hovering(world: Diagram, context: Context, scenario: Scenario, r_0: np.ndarray) -> None:
    """Put the vehicle of a world hovering at rest at r_0, p_WB (3); the context is the root's."""
    x_0 = np.zeros(N_X)
    x_0[0:3] = r_0
    x_0[5] = scenario.servo.yaw
    quadrotor = world.GetSubsystemByName("quadrotor")
    quadrotor.SetState(quadrotor.GetMyMutableContextFromRoot(context), x_0)
    hold = world.GetSubsystemByName("hold")
    hold.SetVectorState(hold.GetMyMutableContextFromRoot(context), [scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0])
