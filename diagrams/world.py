"""The world: the vehicle, its sensors and the links."""

from typing import Any

import numpy as np
from pydrake.systems.framework import Context, Diagram, DiagramBuilder

from ortilo_drake.diagrams.rendered_camera import add_rendered_camera, move_scene
from ortilo_drake.diagrams.vehicle import integrated_boxes
from ortilo_drake.diagrams.wiring.truth import body_of, drawn_values, of_body, payloads_of, true_start, true_vehicle
from ortilo_drake.diagrams.wiring.world import is_system, sensors_boxes, world_boxes
from ortilo_drake.loop.diagram import add_wiring
from ortilo_drake.loop.element import Values, outside
from ortilo_drake.loop.shell import add_chance
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import N_U, N_X
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import CommandLink as CommandLinkSettings
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.truth import Truth
from ortilo_drake.sensors.described import port_of
from ortilo_drake.world.drawn_truth import draw_truth, of_seed
from ortilo_drake.world.faults.table import check_room


class World(Diagram):
    """The world as a Diagram, made of the wiring of diagrams/wiring/world.py.

    In real time a command comes when it comes. With a command_period the world looks for one that often, through a
    failsafe, and Drake integrates the plant in between, whatever world.plant says; all else keeps its tick h. Where a
    System plays a sensor faster than the tick, Drake integrates the plant between its samples.

    Ports:
        control (4): u = [f_T, tau_x, tau_y, tau_z] as commanded, sampled and held every tick; what the rotors get
            of it is the command link's affair, a perfect one adds nothing.
        command (5): with a command_period, in place of control: u and the time at which it was received [s].
        command_stamp (1): with a command_period and only where the scenario wants `acted`: the time of the tick that
            sent it [s], -1 before the first.
        state (12, output): the true x.
        failsafe_mode (output): with a command_period, who flies: an index in world.failsafe.MODES.
        uwb, detections, imu, ... (outputs): the messages of the sensors that the scenario flies.
        image (ImageRgba8U), shutter (outputs): a rendered camera's picture and its message, in place of detections.
        depth_image, label_image (outputs): see diagrams/rendered_camera.py; drawn only if asked for.
        velocity (output): the true velocities, only where the scenario lends them to the servo.
        acted (output): which commands acted, only where the scenario's commands want it.

    Layouts of the messages: model/signals.py.

    Args:
        scenario: the scenario.
        command_period: how often to look for a command [s]; by default there is one every tick.
        fused: whether all elements are one system, which is faster, or a system each.
        r_0: where the vehicle hovers in a default Context, p_WB (3) [m]; the origin where it is not given.

    A default Context hovers there, with noise of the scenario's seed, in the world as it is believed to be; SetSeed
    draws how it differs (scenario/truth.py). A Context of Drake's SetRandomContext, as MonteCarloSimulation makes it,
    is the same with noise of a seed that Drake's generator drew.

    Raises:
        InputError: if there is a command_period and a command link that is not perfect: whatever carries the commands
            to this world loses and delays them. If a fault names an anchor, a landmark or a rotor that is not there.
    """

    def __init__(
        self,
        scenario: Scenario,
        command_period: float | None = None,
        fused: bool = False,
        r_0: np.ndarray | None = None,
    ):
        super().__init__()
        if command_period is not None and scenario.command_link != CommandLinkSettings():
            raise InputError("command_link: must be left as it is where commands come from outside, in real time")
        room, builder = scenario.load_room(), DiagramBuilder()
        check_room(scenario, room)
        self._scenario, self._room = scenario, room
        r_0, chance = np.zeros(3) if r_0 is None else r_0, add_chance(builder, scenario.h)
        self._x_0 = np.concatenate([r_0, [0.0, 0.0, scenario.yaw], np.zeros(6)])
        own = [name for name in scenario.sensors if is_system(scenario, name)]
        if command_period is not None or any(scenario.samples(name) > 1 for name in own):
            sensing, messages = sensors_boxes(scenario, room, whole_imu=True)
            boxes = [*integrated_boxes(scenario, command_period, self._x_0), *sensing]
        else:
            boxes, messages = world_boxes(scenario, room, r_0, whole_imu=True)
        boxes.append(outside("servo", N_U) if command_period is None else outside("command_stamp", 1))
        self._wiring = wiring = Wiring(boxes)
        self._plant: Any = wiring.boxes["plant"].system  # one that Drake integrates
        names = {"state": "plant"} | ({} if command_period is None else {"failsafe_mode": "failsafe.mode"})
        for sensor, box in messages.items():
            names["shutter" if scenario.is_picture(sensor) else port_of(sensor)] = box.name
        names |= {"velocity": "velocity"} if scenario.lends_velocities else {}
        names |= {"acted": "acted_delivered"} if scenario.commands.are_reported else {}
        if scenario.is_rendered:
            names["seen"] = "camera_clock" if "camera_clock" in wiring.boxes else "plant"
        self._added = add_wiring(
            builder, wiring, names, scenario.h, None, fused, {"servo": "control"}, scenario.seed, chance
        )
        outputs = self._added.outputs
        for name in names:
            if name != "seen":
                builder.ExportOutput(outputs[name], name)
        if scenario.is_rendered:
            add_rendered_camera(builder, scenario, room, outputs["seen"], outputs["shutter"])
        builder.BuildInto(self)
        self.set_name("world")

    def SetState(self, context: Context, x: np.ndarray) -> None:
        """Set the true state x (12); rotors and what was felt stay as they are. The context is the root's."""
        if self._plant is not None:
            self._plant.SetState(self._plant.GetMyMutableContextFromRoot(context), x)
            return
        box, state = body_of(self._wiring)
        body = self._added.state_of(context, box, state).copy()
        body[:N_X] = x
        self._added.give(context, {box: Values(start={state: body})})

    def SetSeed(self, context: Context, seed: int) -> None:
        """Set the seed of all noise, and how the world of that seed differs: it hovers at its true start.

        The context is the root's.
        """
        self._added.set_seed(context, seed)
        self._added.give(context, drawn_values(self._wiring, self._scenario, self._room, of_seed(seed)))
        drawn = self.Drawn(context) if self._scenario.truth != Truth() else None
        if drawn is not None:
            self._set_beside(context, drawn)
        if self._plant is not None:
            hold, hover = self.GetSubsystemByName("hold"), [self._scenario.vehicle.hover_thrust, 0.0, 0.0, 0.0]
            self.SetState(context, self._x_0 if drawn is None else self._x_0 + true_start(drawn))
            hold.SetVectorState(hold.GetMyMutableContextFromRoot(context), hover)

    def Give(self, context: Context, given: dict[str, Values]) -> None:
        """Give boxes of the wiring other numbers, tables or states, by their names; the context is the root's."""
        self._added.give(context, given)

    def ChangeBody(self, context: Context, heavier: float, push: np.ndarray) -> None:
        """Have the vehicle be heavier and pushed, beside how this world differs anyway; the context is the root's.

        Its mass is 1 + heavier times the world's own, and the push in W (3) [N] is added to the world's own mean force;
        it is felt only where truth.force is set.
        """
        drawn = self.Drawn(context)
        drawn["vehicle.mass_factor"] = drawn["vehicle.mass_factor"] * (1.0 + heavier)
        drawn["force.mean"] = drawn["force.mean"] + push
        self._added.give(context, of_body(self._wiring, self._scenario, drawn))
        self._set_beside(context, drawn)

    def Drawn(self, context: Context) -> dict[str, np.ndarray]:
        """Return the draws that make the true world of the context's seed; the context is the root's."""
        payloads = payloads_of(self._wiring, self._scenario, self._room)
        return draw_truth(self._scenario.truth, self._added.seed_in(context), self._room, payloads)

    def _set_beside(self, context: Context, drawn: dict[str, np.ndarray]) -> None:
        """Set what is drawn of systems that are no elements: the plant that Drake integrates, the scene it renders."""
        if self._plant is not None:
            vehicle = true_vehicle(self._scenario.vehicle, drawn)
            self._plant.SetVehicle(self._plant.GetMyMutableContextFromRoot(context), vehicle)
        if self._scenario.is_rendered:
            move_scene(self.GetSubsystemByName("rendered_camera"), context, self._room, drawn)


make_world = World
