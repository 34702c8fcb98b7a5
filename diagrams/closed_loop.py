"""The closed loop: world and onboard half joined by wires, with a log of everything at every tick."""

from __future__ import annotations  # help() shows types by their names

from collections.abc import Callable
from pathlib import Path

import numpy as np
from pydrake.geometry import Meshcat
from pydrake.systems.framework import Context, Diagram, DiagramBuilder, PortDataType, System
from pydrake.systems.primitives import LogVectorOutput, VectorLog
from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.onboard import NO_PARTS, Onboard, Parts
from ortilo_drake.diagrams.world import World
from ortilo_drake.loop.diagram import together
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.planner.planned import Planned
from ortilo_drake.scenario import Belief, Scenario, load_scenario
from ortilo_drake.world.scenery.meshcat_flight import MeshcatFlight


class ClosedLoop(Diagram):
    """World and onboard half in one Diagram.

    Ports:
        state (12, output), control (4, output), estimate (15, output), covariance (225, output).

    The subsystems are named world, onboard and log. The log is one VectorLogSink at the control rate over the
    signals of measurement.logged_sizes(), each as the filter consumed it: Drake publishes at t_k before it updates. So
    the logged control is the commanded one, whatever a lossy command link made of it.

    A default Context hovers where the reference starts, truth and belief together, with noise of the scenario's seed;
    Drake's SetRandomContext and MonteCarloSimulation draw other noise, see diagrams/world.py.

    Arguments as of make_closed_loop; `parts` are its estimator, servo and planner.

    Raises:
        InputError: if there is no path or no servo gain, or if the onboard half wants what the world does not send.
    """

    def __init__(
        self,
        scenario: Scenario,
        trajectory: Trajectory | None = None,
        meshcat: Meshcat | None = None,
        parts: Parts = NO_PARTS,
        fused: bool = False,
    ):
        super().__init__()
        builder = DiagramBuilder()
        self._onboard = onboard = Onboard(scenario, trajectory, parts=parts, fused=fused)
        self._world = world = builder.AddSystem(World(scenario, fused=fused, r_0=onboard.r_0))
        builder.AddSystem(onboard)
        sent = {port.get_name(): port for port in map(world.get_output_port, range(world.num_output_ports()))}
        if not scenario.lends_velocities:
            del sent["state"]  # the truth: no part of one's own may read it
        for port in map(onboard.get_input_port, range(onboard.num_input_ports())):
            name = port.get_name()
            if name not in sent:
                raise InputError(f"onboard: wants '{name}', the world sends only {', '.join(sent)}")
            if port.get_data_type() == PortDataType.kVectorValued and port.size() != sent[name].size():
                raise InputError(
                    f"onboard: takes '{name}' of {port.size()} numbers, the world sends {sent[name].size()}"
                )
            builder.Connect(sent[name], port)
        builder.Connect(onboard.GetOutputPort("control"), world.GetInputPort("control"))

        logged = together(builder, [world.GetOutputPort("state"), onboard.GetOutputPort("logged")])
        logged.get_system().set_name("log_inputs")
        self._log = LogVectorOutput(logged, builder, scenario.h)
        self._log.set_name("log")
        shown = {"state": world.GetOutputPort("state")}
        shown |= {name: onboard.GetOutputPort(name) for name in ("control", "estimate", "covariance")}
        for name, said in shown.items():
            builder.ExportOutput(said, name)
        if meshcat is not None:
            display = builder.AddSystem(MeshcatFlight(meshcat, scenario.h, vehicle=scenario.vehicle))
            for name in ("state", "estimate", "covariance"):
                builder.Connect(shown[name], display.GetInputPort(name))
        builder.BuildInto(self)
        self.set_name(scenario.name)

    def SetSeed(self, context: Context, seed: int) -> None:
        """Set the seed of all noise; the context is this diagram's."""
        self._world.SetSeed(context, seed)

    def FindLog(self, context: Context) -> VectorLog:
        """Return the log in a context of this diagram."""
        return self._log.FindLog(context)


def make_closed_loop(
    scenario: str | Path | Scenario,
    trajectory: Trajectory | None = None,
    meshcat: Meshcat | None = None,
    estimator: Callable[[Belief, np.ndarray], System] | None = None,
    servo: Callable[[Belief], System] | None = None,
    planner: Callable[[Belief], Planned] | None = None,
    fused: bool = False,
) -> ClosedLoop:
    """Return the closed loop of a scenario, with parts of one's own where they are given.

    Args:
        scenario: as load_scenario.
        trajectory: the path to fly; by default what the planner plans.
        meshcat: if given, shows the flight in it.
        estimator: makes the estimator in place of the scenario's, see diagrams/onboard.py.
        servo: makes the servo.
        planner: makes the path, or the System that gives the reference.
        fused: whether all elements of a half are one system, which is faster, or a system each.

    Raises:
        InputError: as load_scenario and ClosedLoop.
    """
    return ClosedLoop(load_scenario(scenario), trajectory, meshcat, Parts(estimator, servo, planner), fused)
