"""The vehicle in the world: its plant, what commands it and what pushes it."""

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort, System
from pydrake.systems.primitives import Adder, ZeroOrderHold

from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import ForceTruth, VehicleTruth
from ortilo_drake.world.faults.vehicle_faults import ForceFaults, WrenchFaults, force_table, wrench_table
from ortilo_drake.world.radio.command_link import CommandLink_
from ortilo_drake.world.slow_error import SlowError_, gauss_markov
from ortilo_drake.world.vehicle.acted_report import ActedReport
from ortilo_drake.world.vehicle.disturbance import DisturbanceSource_
from ortilo_drake.world.vehicle.failsafe import Failsafe
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import Rotors_
from ortilo_drake.world.vehicle.wrench_error import WrenchError_

Ports = dict[str, OutputPort]


def add_vehicle(
    builder: DiagramBuilder, scenario: Scenario, hold: ZeroOrderHold, command_period: float | None
) -> tuple[System, Ports]:
    """Add the plant with what commands and pushes it; return it, and its ports.

    They are state, control, disturbance and, where the scenario wants it, acted.

    Args:
        builder: of the world.
        scenario: the scenario.
        hold: of the commanded u.
        command_period: see diagrams/world.py.
    """
    sampled = scenario.world.plant == "sampled" and command_period is None and not scenario.faster_sensors
    h = scenario.h
    plant = builder.AddSystem(
        QuadrotorPlant_[float](scenario.vehicle, scenario.world.kinematics, time_step=h if sampled else 0.0)
    )
    disturbance = _with_faults(builder, scenario, _add_disturbance(builder, scenario))
    disturbance_hold = builder.AddNamedSystem("disturbance_hold", ZeroOrderHold(h, 6))
    builder.Connect(disturbance, disturbance_hold.get_input_port())
    # A sampled plant samples and holds its inputs itself.
    commanded = [hold.get_input_port(), *([plant.GetInputPort("control")] if sampled else [])]
    actuator: LeafSystem = hold
    changes: list[LeafSystem] = []  # of the wrench, in their order
    if scenario.truth.vehicle != VehicleTruth():
        changes.append(builder.AddSystem(WrenchError_[float]()))
    wrench_faults = wrench_table(scenario.faults, scenario.vehicle)
    if wrench_faults.kinds.size:
        changes.append(builder.AddSystem(WrenchFaults(wrench_faults)))
    if scenario.world.rotors.kind == "first_order":
        actuator = builder.AddSystem(Rotors_[float](scenario.vehicle))
        builder.Connect(hold.get_output_port(), actuator.get_input_port())
        for change in changes:
            builder.Connect(actuator.get_output_port(), change.get_input_port())
            actuator = change
    else:
        for change in reversed(changes):
            for port in commanded:
                builder.Connect(change.get_output_port(), port)
            commanded = [change.get_input_port()]
    report = _add_report(builder, scenario, command_period) if scenario.commands.are_reported else None
    if command_period is not None:
        failsafe = builder.AddSystem(Failsafe(scenario.failsafe, scenario.vehicle, command_period))
        builder.ExportInput(failsafe.GetInputPort("command"), "command")
        builder.Connect(failsafe.GetOutputPort("control"), commanded[0])
        builder.Connect(plant.GetOutputPort("state"), failsafe.GetInputPort("state"))
        builder.ExportOutput(failsafe.GetOutputPort("mode"), "failsafe_mode")
        if report is not None:
            builder.Connect(failsafe.GetOutputPort("control"), report.GetInputPort("control"))
            builder.Connect(failsafe.GetOutputPort("mode"), report.GetInputPort("mode"))
            builder.ExportInput(report.GetInputPort("stamp"), "command_stamp")
    elif scenario.command_link == CommandLinkSettings():  # a perfect link
        control = builder.ExportInput(commanded[0], "control")
        for port in (*commanded[1:], *([report.GetInputPort("control")] if report else [])):
            builder.ConnectInput(control, port)
    else:
        settings, told = scenario.command_link, report is not None
        link = builder.AddSystem(CommandLink_[float](settings, scenario.vehicle, scenario.seed, h, told))
        builder.ExportInput(link.get_input_port(), "control")
        for port in (*commanded, *([report.GetInputPort("control")] if report else [])):
            builder.Connect(link.GetOutputPort("applied"), port)
        if report is not None:
            builder.Connect(link.GetOutputPort("stamp"), report.GetInputPort("stamp"))
    if sampled:
        builder.Connect(disturbance, plant.GetInputPort("disturbance"))
    else:
        builder.Connect(actuator.get_output_port(), plant.GetInputPort("control"))
        builder.Connect(disturbance_hold.get_output_port(), plant.GetInputPort("disturbance"))
    ports = {
        "state": plant.GetOutputPort("state"),
        "control": actuator.get_output_port(),
        "disturbance": disturbance_hold.get_output_port(),
    }
    return plant, ports | ({"acted": report.get_output_port()} if report is not None else {})


def _add_report(builder: DiagramBuilder, scenario: Scenario, command_period: float | None) -> ActedReport:
    """Add what tells the onboard half which commands acted."""
    in_real_time = command_period is not None
    is_late = in_real_time or scenario.command_link != CommandLinkSettings()
    period = command_period or scenario.h
    return builder.AddSystem(ActedReport(scenario.vehicle, scenario.h, period, is_late, in_real_time))


def _add_disturbance(builder: DiagramBuilder, scenario: Scenario) -> OutputPort:
    """Add what pushes the vehicle about, as it is drawn in each tick; return where it comes out."""
    white = builder.AddSystem(DisturbanceSource_[float](scenario.world.disturbance, scenario.seed, scenario.h))
    lasting = scenario.truth.force
    if lasting == ForceTruth():
        return white.get_output_port()
    sd = np.array([*[lasting.gust_sd] * 3, 0.0, 0.0, 0.0])
    noise = gauss_markov(sd, lasting.gust_time, scenario.h)
    force = builder.AddSystem(SlowError_[float]("lasting_force", noise, scenario.seed, scenario.h))
    both = builder.AddSystem(Adder(2, 6))
    builder.Connect(white.get_output_port(), both.get_input_port(0))
    builder.Connect(force.get_output_port(), both.get_input_port(1))
    return both.get_output_port()


def _with_faults(builder: DiagramBuilder, scenario: Scenario, disturbance: OutputPort) -> OutputPort:
    """Add the faults that change what a disturbance does, if there are any; return where it comes out."""
    faults = force_table(scenario.faults)
    if not faults.kinds.size:
        return disturbance
    changed = builder.AddSystem(ForceFaults(faults))
    builder.Connect(disturbance, changed.get_input_port())
    pushing: OutputPort = changed.get_output_port()
    return pushing
