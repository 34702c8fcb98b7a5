"""Ports and sizes of the sensors' messages."""

from pydrake.systems.framework import InputPort, System

from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD
from ortilo_drake.scenario import Belief


def message_port(system: System) -> InputPort:
    """Return the port at which a sensor's messages come in, of the system that make_onboard returned."""
    ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    return next(port for port in ports if port.get_name() not in ("estimate", "covariance"))


def message_size(sensor: Sensor, scenario: Belief, room: Room) -> int:
    """Return the size of a sensor's message."""
    if sensor.make_onboard is not None:
        return int(message_port(sensor.make_onboard(scenario.belief, room)).size())
    m = len(sensor.rows)
    payload = sensor.payload or (m if sensor.V(scenario) is not None else m + m * m)
    return PAYLOAD + payload
