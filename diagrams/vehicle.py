"""The vehicle as Drake integrates it, where commands come in real time or a sensor is asked between two ticks.

Else the vehicle is made of elements: wiring/world.py.
"""

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort, System
from pydrake.systems.primitives import PassThrough, ZeroOrderHold

from ortilo_drake.diagrams.wiring.world import disturbance_boxes, report_link_boxes, rotors_lag, wrench_changes
from ortilo_drake.loop.diagram import add_wiring, together
from ortilo_drake.loop.element import OUTSIDE, Box, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import ACTED_SIZE, N_U, N_X
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.radio.command_link import command_link_box
from ortilo_drake.world.sensors.sample_collector import Passed
from ortilo_drake.world.vehicle.acted_report import ActedReport
from ortilo_drake.world.vehicle.continuous import PASSED
from ortilo_drake.world.vehicle.failsafe import Failsafe
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import Rotors_

_INSTANT = 1e-6  # s: the tick of what changes a wrench at any time


class Integrated(NamedTuple):
    """A vehicle that Drake integrates.

    Attributes:
        plant: its System.
        boxes: in the place of those of vehicle_boxes.
        sources: the output ports that they stand for, by name.
        within: boxes of its own elements.
        systems: that play these, by name.
    """

    plant: System
    boxes: list[Box]
    sources: dict[str, OutputPort]
    within: list[Box]
    systems: dict[str, System]


def add_vehicle(
    builder: DiagramBuilder, scenario: Scenario, command_period: float | None, x_0: np.ndarray, chance: OutputPort
) -> Integrated:
    """Add the plant to a world, from its state x_0 (12), with what commands and pushes it.

    The world gets the inputs control or, with a command_period, command and command_stamp; see World and loop/seeds.py.
    """
    h, period, vehicle = scenario.h, command_period or scenario.h, scenario.vehicle
    within, systems = [outside("control", N_U)], dict[str, System]()

    def add(boxes: list[Box], tick: float, **sources: OutputPort) -> dict[str, OutputPort]:
        """Add elements of its own; return what the last one says, by its parts if it has any."""
        last = boxes[-1]
        asked = {part: f"{last.name}.{part}" for part in last.parts} or {"said": last.name}
        wiring = Wiring([*boxes, outside("plant", N_X), outside("control", N_U)])
        added = add_wiring(builder, wiring, asked, tick, sources, seed=scenario.seed, chance=chance)
        within.extend(boxes)
        systems.update(added.systems)
        return added.outputs

    def through(system: System, port: OutputPort) -> OutputPort:
        builder.Connect(port, system.get_input_port())
        return system.get_output_port()

    plant = builder.AddSystem(QuadrotorPlant_[float](vehicle, scenario.world.kinematics, x_0=x_0))
    state = plant.GetOutputPort("state")
    if command_period is not None:
        failsafe = builder.AddSystem(Failsafe(scenario.failsafe, vehicle, command_period))
        builder.ExportInput(failsafe.GetInputPort("command"), "command")
        builder.Connect(state, failsafe.GetInputPort("state"))
        builder.ExportOutput(failsafe.GetOutputPort("mode"), "failsafe_mode")
        told = {name: failsafe.GetOutputPort(name) for name in ("control", "mode")}
    elif scenario.command_link != CommandLinkSettings():
        told = add([command_link_box(scenario.command_link, vehicle.hover_thrust, h).with_inputs(control="control")], h)
        told["control"] = told.pop("applied")
    else:
        passing = builder.AddSystem(PassThrough(N_U))
        builder.ExportInput(passing.get_input_port(), "control")
        told = {"control": passing.get_output_port()}

    pushes = add(disturbance_boxes(scenario), h, plant=state)["said"]
    pushes = through(builder.AddNamedSystem("disturbance_hold", ZeroOrderHold(h, 6)), pushes)
    acts, changes = told["control"], wrench_changes(scenario, _INSTANT, "control")
    hold, has_rotors = builder.AddNamedSystem("hold", ZeroOrderHold(period, N_U)), rotors_lag(scenario)
    if has_rotors:  # their speeds are what lags, not the wrench as it is changed
        acts = through(builder.AddSystem(Rotors_[float](vehicle)), through(hold, acts))
    acts = add(changes, _INSTANT, control=acts)["said"] if changes else acts
    acts = acts if has_rotors else through(hold, acts)
    builder.Connect(acts, plant.GetInputPort("control"))
    builder.Connect(pushes, plant.GetInputPort("disturbance"))

    acceleration, felt = plant.GetOutputPort("acceleration"), {"control": (0, N_U), "disturbance": (N_U, 6)}
    boxes = [outside("plant", N_X), Box("felt", OUTSIDE, N_U + 6, parts=felt), outside("rotors_felt", N_U)]
    boxes.append(outside("acceleration", 3))
    sources = {"plant": state, "felt": together(builder, [acts, pushes]), "felt.control": acts}
    sources |= {"felt.disturbance": pushes, "rotors_felt": acts, "acceleration": acceleration}
    if scenario.imu_samples > 1:
        size = (scenario.imu_samples - 1) * PASSED
        passed = builder.AddSystem(Passed(PASSED, scenario.imu_samples, h))
        boxes.append(Box("vehicle", OUTSIDE, size, parts={"passed": (0, size)}))
        passing_on = through(passed, together(builder, [state, acceleration]))
        sources |= {"vehicle": passing_on, "vehicle.passed": passing_on}
    if scenario.commands.are_reported:
        is_late = command_period is not None or scenario.command_link != CommandLinkSettings()
        report = builder.AddSystem(ActedReport(vehicle, h, period, is_late, command_period is not None))
        for name, port in told.items():
            builder.Connect(port, report.GetInputPort(name))
        if command_period is not None:
            builder.ExportInput(report.GetInputPort("stamp"), "command_stamp")
        acted = outside("acted", ACTED_SIZE)
        boxes += [acted, *report_link_boxes(scenario, acted)]
        sources["acted"] = report.get_output_port()
    return Integrated(plant, boxes, sources, within, systems)
