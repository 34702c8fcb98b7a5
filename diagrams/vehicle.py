"""The vehicle as Drake integrates it, where commands come in real time or a sensor is asked between two ticks.

Else the vehicle is made of elements: wiring/world.py.
"""

import numpy as np
from pydrake.systems.framework import System
from pydrake.systems.primitives import PassThrough, ZeroOrderHold

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.diagrams.wiring.world import (
    disturbance_boxes,
    needs_forces,
    report_link_boxes,
    rotors_lag,
    wrench_changes,
)
from ortilo_drake.loop.diagram import system_of
from ortilo_drake.loop.element import Box, Element, bundle, outside, parts_of
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Scenario
from ortilo_drake.world.radio.command_link import command_link_box
from ortilo_drake.world.sensors.sample_collector import Passed
from ortilo_drake.world.vehicle.acted_report import ActedReport
from ortilo_drake.world.vehicle.continuous import PASSED
from ortilo_drake.world.vehicle.failsafe import Failsafe
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_, acceleration_box
from ortilo_drake.world.vehicle.rotors import Rotors_

_INSTANT = 1e-6  # s: the tick of what changes a wrench at any time


def integrated_boxes(scenario: Scenario, command_period: float | None, x_0: np.ndarray) -> list[Box]:
    """Return in the place of vehicle_boxes a plant that Drake integrates from x_0 (12), and all that acts on it.

    They read the control (4) of a box `servo` or, with a command_period, inputs of the world: command and
    command_stamp, see World.
    """
    h, period, vehicle = scenario.h, command_period or scenario.h, scenario.vehicle
    told = {"control": ("servo", N_U)}
    if command_period is not None:
        failsafe = Failsafe(scenario.failsafe, vehicle, command_period)
        boxes = [system_box("failsafe", failsafe, ("control", "mode"), {"state": ("plant", N_X)})]
        told = {"control": ("failsafe.control", N_U), "mode": ("failsafe.mode", 1), "stamp": ("command_stamp", 1)}
    elif scenario.command_link != CommandLinkSettings():
        boxes = [command_link_box(scenario.command_link, vehicle.hover_thrust, h).with_inputs(control="servo")]
        told = {"control": ("command_link.applied", N_U), "stamp": ("command_link.stamp", 1)}
    else:
        boxes = []

    def through(name: str, system: System, said: str) -> str:
        """Add a System between what is said and what it makes of that; return its name."""
        system.set_name(name)
        port, size = system.get_input_port(), system.get_input_port().size()
        signals = {port.get_name(): (said, size)}
        boxes.append(system_box(name, system, (system.get_output_port().get_name(),), signals))
        return name

    boxes += disturbance_boxes(scenario)
    pushes = through("disturbance_hold", ZeroOrderHold(h, 6), boxes[-1].name)
    acts, hold = told["control"][0], ZeroOrderHold(period, N_U)
    if rotors_lag(scenario):  # their speeds are what lags, not the wrench as it is changed
        acts = through("rotors", Rotors_[float](vehicle), through("hold", hold, acts))
    for box in wrench_changes(scenario, _INSTANT, "control"):
        wiring = Wiring([box.with_inputs(control="control"), outside("control", N_U)])
        acts = through(box.name, system_of(wiring, _INSTANT, scenario.seed), acts)
    acts = through("rotors_felt", PassThrough(N_U), acts) if rotors_lag(scenario) else through("hold", hold, acts)

    plant = QuadrotorPlant_[float](vehicle, scenario.world.kinematics, x_0=x_0)
    signals = {"control": (acts, N_U), "disturbance": (pushes, 6)}
    felt = parts_of({name: size for name, (_, size) in signals.items()})
    boxes.append(system_box("plant", plant, ("state",), signals))
    boxes.append(Box("felt", Element("bundle"), N_U + 6, parts=felt, holds=(acts, pushes)))
    if needs_forces(scenario, whole_imu=True) or scenario.faster_sensors:
        felt_by = {"state": "plant", "control": acts, "disturbance": pushes}
        boxes.append(acceleration_box(vehicle, scenario.world.kinematics).with_inputs(**felt_by))
    if scenario.faster_sensors:
        passed = Passed(PASSED, scenario.instants, h)
        moving = [box for box in boxes if box.name in ("plant", "acceleration")]
        boxes += [bundle("moving", moving), system_box("vehicle", passed, ("passed",), {"signal": ("moving", PASSED)})]
    if scenario.commands.are_reported:
        report = ActedReport(vehicle, h, period, "stamp" in told, command_period is not None)
        boxes.append(system_box("acted", report, ("acted",), told))
        boxes += report_link_boxes(scenario, boxes[-1])
    return boxes
