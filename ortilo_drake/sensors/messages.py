"""The sensors' messages: their ports and sizes, and the Systems that compute fixes from them."""

from pydrake.systems.framework import InputPort, System

from ortilo_drake.loop.element import Box, outside
from ortilo_drake.loop.shell import WiredSystem_
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.parts import Sensor
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_XBAR, PAYLOAD
from ortilo_drake.onboard.estimator.belief import together_box
from ortilo_drake.scenario import Belief


def message_port(system: System) -> InputPort:
    """Return the input port of the sensor's messages at the System that make_onboard returned."""
    ports = [system.get_input_port(i) for i in range(system.num_input_ports())]
    return next(port for port in ports if port.get_name() not in ("estimate", "covariance"))


def solver_system(port: str, size: int, solver: Box, h: float) -> System:
    """Return a solver's element as a System with the ports of make_onboard (model/parts.py).

    `port` is the name of the messages' port, `size` the size of a message. The solver reads `message` and `belief`; h
    is the tick [s].
    """
    prior = together_box("prior")
    inputs = [outside(port, size), outside("estimate", N_XBAR), outside("covariance", N_XBAR**2)]
    wiring = Wiring([*inputs, prior, solver.with_inputs(message=port, belief="prior")])
    return WiredSystem_[float](solver.name, wiring, {"fix": (solver.name,)}, h)


def message_size(sensor: Sensor, scenario: Belief, room: Room) -> int:
    """Return the size of a sensor's message."""
    if sensor.compiled is not None:
        return PAYLOAD + sensor.compiled.payload
    if sensor.payload is not None:
        return PAYLOAD + (sensor.payload(scenario, room) if callable(sensor.payload) else sensor.payload)
    if sensor.make_onboard is not None:
        return int(message_port(sensor.make_onboard(scenario.belief, room)).size())
    m = len(sensor.rows)
    return PAYLOAD + (m if sensor.V(scenario) is not None else m + m * m)
