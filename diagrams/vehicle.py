"""The vehicle as Drake integrates it, where commands come in real time or a sensor is asked between two ticks.

Else the vehicle is made of elements: wiring/vehicle.py.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort, System
from pydrake.systems.primitives import ZeroOrderHold

from ortilo_drake.diagrams.wiring.vehicle import disturbance_boxes, wrench_changes
from ortilo_drake.loop.diagram import add_wiring, connect_chance, system_of
from ortilo_drake.loop.element import Box, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.radio.command_link import command_link_box
from ortilo_drake.world.vehicle.acted_report import ActedReport
from ortilo_drake.world.vehicle.failsafe import Failsafe
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import Rotors_

_INSTANT = 1e-6  # s: the tick of what changes a wrench at any time


class Integrated(NamedTuple):
    """A vehicle that Drake integrates.

    Attributes:
        plant: its System.
        ports: state, acceleration, control, disturbance and, where the scenario wants it, acted.
        boxes: those of its elements, each with what it reads.
        systems: that play them, by name.
    """

    plant: System
    ports: dict[str, OutputPort]
    boxes: list[Box]
    systems: dict[str, System]


def add_vehicle(
    builder: DiagramBuilder, scenario: Scenario, command_period: float | None, x_0: np.ndarray, chance: OutputPort
) -> Integrated:
    """Add the plant with what commands and pushes it.

    The Diagram gets the inputs control or, with a command_period, command and command_stamp.

    Args:
        builder: of the world.
        scenario: the scenario.
        command_period: see diagrams/world.py.
        x_0: state at the start (12).
        chance: of loop/seeds.py.
    """
    h, vehicle = scenario.h, scenario.vehicle
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(command_period or h, N_U))
    plant = builder.AddSystem(QuadrotorPlant_[float](vehicle, scenario.world.kinematics, x_0=x_0))
    pushing = disturbance_boxes(scenario)
    moved = Wiring([*pushing, outside("plant", N_X)] if any(scenario.world.drag) else pushing)
    state, said = {"plant": plant.GetOutputPort("state")}, {"disturbance": pushing[-1].name}
    pushes = add_wiring(builder, moved, said, h, state, seed=scenario.seed, chance=chance)
    disturbance = builder.AddNamedSystem("disturbance_hold", ZeroOrderHold(h, 6))
    builder.Connect(pushes.outputs["disturbance"], disturbance.get_input_port())
    builder.Connect(disturbance.get_output_port(), plant.GetInputPort("disturbance"))
    changes = {box.name: box.with_inputs(control="control") for box in wrench_changes(scenario, _INSTANT)}
    made = {name: system_of(Wiring([box, outside("control", N_U)]), _INSTANT) for name, box in changes.items()}
    changing = [builder.AddSystem(system) for system in made.values()]
    acting: list[System] = [*changing, hold]
    if scenario.world.rotors.kind == "first_order":  # their speeds are what lags, not the wrench as it is changed
        acting = [hold, builder.AddSystem(Rotors_[float](vehicle)), *changing]
    for before, after in pairwise([*acting, plant]):
        builder.Connect(before.get_output_port(), _control_of(after))
    ports = {
        "state": plant.GetOutputPort("state"),
        "acceleration": plant.GetOutputPort("acceleration"),
        "control": acting[-1].get_output_port(),
        "disturbance": disturbance.get_output_port(),
    }
    report = None
    if scenario.commands.are_reported:
        is_late = command_period is not None or scenario.command_link != CommandLinkSettings()
        report = ActedReport(vehicle, h, command_period or h, is_late, command_period is not None)
        ports["acted"] = builder.AddSystem(report).get_output_port()
    link = _command(builder, scenario, _control_of(acting[0]), plant, report, command_period)
    for system in (*changing, *([link] if link else [])):
        connect_chance(builder, chance, system)
    boxes = [*pushing, *changes.values(), outside("control", N_U)]
    return Integrated(plant, ports, boxes, pushes.systems | made | ({"command_link": link} if link else {}))


def _control_of(system: System) -> InputPort:
    return system.GetInputPort("control") if system.HasInputPort("control") else system.get_input_port()


def _command(
    builder: DiagramBuilder,
    scenario: Scenario,
    commanded: InputPort,
    plant: System,
    report: ActedReport | None,
    command_period: float | None,
) -> System | None:
    """Connect what commands the vehicle, the failsafe in real time, else the command link, which is returned."""
    link: System | None = None
    told = [commanded, *([report.GetInputPort("control")] if report else [])]
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
            system_of(Wiring([box.with_inputs(control="control"), outside("control", N_U)]), scenario.h)
        )
        builder.ExportInput(link.GetInputPort("control"), "control")
        commands = link.GetOutputPort("applied")
        if report is not None:
            builder.Connect(link.GetOutputPort("stamp"), report.GetInputPort("stamp"))
    else:
        control = builder.ExportInput(told[0], "control")
        for port in told[1:]:
            builder.ConnectInput(control, port)
        return None
    for port in told:
        builder.Connect(commands, port)
    return link
