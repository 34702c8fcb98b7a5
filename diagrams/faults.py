"""Faults of the sensors' messages in the world: each a system between a sensor and its link."""

from pydrake.systems.framework import DiagramBuilder, OutputPort

from ortilo_drake.model.room import Room
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.scenario import Scenario
from ortilo_drake.scenario.faults import Stuck
from ortilo_drake.world.faults.message_fault import MessageFault, StuckSensor
from ortilo_drake.world.faults.scene_faults import message_faults
from ortilo_drake.world.faults.table import KINDS


def add_sensor_faults(
    builder: DiagramBuilder, scenario: Scenario, sensor: str, room: Room, message: OutputPort, state: OutputPort
) -> OutputPort:
    """Add the faults that concern a sensor's messages, in the scenario's order; return where the messages come out.

    Args:
        builder: of the world.
        scenario: the scenario.
        sensor: its name.
        room: its room.
        message: the sensor's messages, with their errors; of one faster than the tick its samples.
        state: as the sensor sees it.
    """
    sampled = scenario.sampled_for(sensor)
    for its in message_faults(scenario.faults, sensor):
        name, size = f"{sensor}_fault_{its.i}", message.size()
        if its.fault.kind not in KINDS:
            raise InputError(f"faults.{its.i}: {its.fault.kind}: is an element: the engine alone flies it")
        if isinstance(its.fault, Stuck):
            stuck = builder.AddSystem(StuckSensor(name, size, its, scenario.h, scenario.samples(sensor)))
            builder.Connect(message, stuck.get_input_port())
            message = stuck.get_output_port()
        else:
            changed = builder.AddSystem(MessageFault(name, size, its, room.anchor_positions, scenario.seed, sampled.h))
            builder.Connect(message, changed.GetInputPort("message"))
            builder.Connect(state, changed.GetInputPort("state"))
            message = changed.get_output_port()
    return message


def check_room(scenario: Scenario, room: Room) -> None:
    """Refuse faults of anchors, landmarks and rotors that are not there.

    Raises:
        InputError: naming the fault, the number and what is allowed.
    """
    counts = {"anchor": len(room.anchors), "landmark": len(room.landmarks), "rotor": scenario.vehicle.rotor_count}
    for i, fault in enumerate(scenario.faults):
        for name, count in counts.items():
            for index in (*getattr(fault, f"{name}s", ()), getattr(fault, name, 0)):
                if index >= count:
                    raise InputError(f"faults.{i}: {fault.kind}: {name} {index}: must be below {count}, their number")
