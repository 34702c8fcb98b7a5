"""The vehicle as Drake integrates it, where commands come in real time or a sensor is asked between two ticks.

Else the vehicle is made of elements: wiring/vehicle.py.
"""

from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import ZeroOrderHold

from ortilo_drake.diagrams.wiring.vehicle import disturbance_boxes
from ortilo_drake.loop.diagram import add_wiring, system_of
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import N_U
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import VehicleTruth
from ortilo_drake.world.faults.vehicle_faults import wrench_faults_box, wrench_table
from ortilo_drake.world.radio.command_link import command_link_box
from ortilo_drake.world.vehicle.acted_report import ActedReport
from ortilo_drake.world.vehicle.failsafe import Failsafe
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import Rotors_
from ortilo_drake.world.vehicle.wrench_error import wrench_error_box

_INSTANT = 1e-6  # s: the tick of what changes a wrench at any time


def add_vehicle(
    builder: DiagramBuilder, scenario: Scenario, command_period: float | None
) -> tuple[System, dict[str, OutputPort]]:
    """Add the plant with what commands and pushes it; return it, and its ports.

    They are state, control, disturbance and, where the scenario wants it, acted. The Diagram gets the inputs control
    or, with a command_period, command and command_stamp.

    Args:
        builder: of the world.
        scenario: the scenario.
        command_period: see diagrams/world.py.
    """
    h, vehicle = scenario.h, scenario.vehicle
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(command_period or h, N_U))
    plant = builder.AddSystem(QuadrotorPlant_[float](vehicle, scenario.world.kinematics))
    pushing = disturbance_boxes(scenario)
    pushes = add_wiring(builder, Wiring(pushing), {"disturbance": pushing[-1].name}, h).outputs["disturbance"]
    disturbance = builder.AddNamedSystem("disturbance_hold", ZeroOrderHold(h, 6))
    builder.Connect(pushes, disturbance.get_input_port())
    builder.Connect(disturbance.get_output_port(), plant.GetInputPort("disturbance"))
    acting: list[System] = [hold]
    if scenario.world.rotors.kind == "first_order":
        acting.append(builder.AddSystem(Rotors_[float](vehicle)))
    acting += [builder.AddSystem(_at_any_time(box)) for box in _changes(scenario)]
    for before, after in zip(acting, [*acting[1:], plant], strict=True):
        port = after.GetInputPort("control") if after.HasInputPort("control") else after.get_input_port()
        builder.Connect(before.get_output_port(), port)
    ports = {
        "state": plant.GetOutputPort("state"),
        "control": acting[-1].get_output_port(),
        "disturbance": disturbance.get_output_port(),
    }
    report = None
    if scenario.commands.are_reported:
        is_late = command_period is not None or scenario.command_link != CommandLinkSettings()
        report = ActedReport(vehicle, h, command_period or h, is_late, command_period is not None)
        ports["acted"] = builder.AddSystem(report).get_output_port()
    _command(builder, scenario, hold, plant, report, command_period)
    return plant, ports


def _changes(scenario: Scenario) -> list[Box]:
    """Return what changes the wrench on its way to the body, in its order."""
    boxes, faults = list[Box](), wrench_table(scenario.faults, scenario.vehicle)
    if scenario.truth.vehicle != VehicleTruth():
        boxes.append(wrench_error_box())
    if faults.kinds.size:
        boxes.append(wrench_faults_box(faults, _INSTANT))
    return boxes


def _at_any_time(box: Box) -> System:
    """Return the system of a box that reads the control and is asked between two ticks."""
    return system_of(Wiring([box.reading(control="control"), outside("control", N_U)]), _INSTANT)


def _command(
    builder: DiagramBuilder,
    scenario: Scenario,
    hold: System,
    plant: System,
    report: ActedReport | None,
    command_period: float | None,
) -> None:
    """Connect what commands the vehicle: the failsafe in real time, else the command link."""
    told = [hold.get_input_port(), *([report.GetInputPort("control")] if report else [])]
    if command_period is not None:
        failsafe = builder.AddSystem(Failsafe(scenario.failsafe, scenario.vehicle, command_period))
        builder.ExportInput(failsafe.GetInputPort("command"), "command")
        builder.Connect(plant.GetOutputPort("state"), failsafe.GetInputPort("state"))
        builder.ExportOutput(failsafe.GetOutputPort("mode"), "failsafe_mode")
        commands = failsafe.GetOutputPort("control")
        if report is not None:
            builder.Connect(failsafe.GetOutputPort("mode"), report.GetInputPort("mode"))
            builder.ExportInput(report.GetInputPort("stamp"), "command_stamp")
    elif scenario.command_link != CommandLinkSettings():
        box = command_link_box(scenario.command_link, scenario.vehicle.hover_thrust, scenario.h)
        link = builder.AddSystem(
            system_of(Wiring([box.reading(control="control"), outside("control", N_U)]), scenario.h)
        )
        builder.ExportInput(link.GetInputPort("control"), "control")
        commands = link.GetOutputPort("applied")
        if report is not None:
            builder.Connect(link.GetOutputPort("stamp"), report.GetInputPort("stamp"))
    else:
        control = builder.ExportInput(told[0], "control")
        for port in told[1:]:
            builder.ConnectInput(control, port)
        return
    for port in told:
        builder.Connect(commands, port)
