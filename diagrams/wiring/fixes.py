"""The boxes between a sensor's message as it lands and what the handler takes of it."""

from pydrake.systems.framework import System

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.element import Box
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.estimator.robust.stuck_gate import stuck_box
from ortilo_drake.onboard.fix_solver import own_fix_box
from ortilo_drake.onboard.sample_mean import SampleMean
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.robust import Robust
from ortilo_drake.sensors.described import described, described_per_tick
from ortilo_drake.sensors.messages import message_port


def gated_messages(settings: Robust | None, messages: dict[str, Box], samples: dict[str, int]) -> dict[str, Box]:
    """Return the box of each sensor's message as it is heard: behind a gate if it may be stuck."""
    if settings is None or settings.stuck is None:
        return messages
    gates = {name: stuck_box(name, said.size, settings.stuck, samples[name]) for name, said in messages.items()}
    return {name: gate.with_inputs(message=messages[name].name) for name, gate in gates.items()}


def solver_boxes(belief: Belief, room: Room, heard: dict[str, Box]) -> dict[str, Box]:
    """Return the boxes that make fixes of messages, by sensor.

    An element reads a `belief` of [x; i] (240) besides; a System reads `<sensor>_prior`, whose parts are that belief's.
    A sensor whose message begins with its value has none.
    """
    solvers = {name: solver_box(belief, room, name, said) for name, said in heard.items()}
    return {name: solver for name, solver in solvers.items() if solver is not None}


def solver_box(belief: Belief, room: Room, sensor: str, message: Box) -> Box | None:
    """Return the box that makes a fix of a sensor's message; None where none is needed."""
    if belief.samples(sensor) > 1:
        make = described_per_tick(sensor, belief).make_onboard
        return None if make is None else system_solver_box(sensor, make(belief, room), message)
    own = described(sensor)
    solver: Box | None = None if own.solver is None else own.solver(belief, room)
    if own.compiled is not None:
        solver = own_fix_box(sensor, own.compiled, len(own.rows), belief, room)
    elif solver is None and own.make_onboard is not None:
        return system_solver_box(sensor, own.make_onboard(belief, room), message)
    return None if solver is None else solver.with_inputs(message=message.name)


def system_solver_box(sensor: str, system: System, message: Box) -> Box:
    """Return the box of a System that makes fixes: it reads the message and, where it asks, its prior."""
    signals = {message_port(system).get_name(): (message.name, message.size)}
    sizes = {"estimate": N_XBAR, "covariance": N_XBAR**2}
    signals |= {name: (f"{sensor}_prior.{name}", size) for name, size in sizes.items()}
    return system_box(f"{sensor}_fix", system, (system.get_output_port().get_name(),), signals)


def mean_box(sensor: str, size: int, samples: int, message: Box) -> Box:
    """Return the box of the mean of the samples in a message, each of that size, as a message of one."""
    mean = SampleMean(sensor, size, samples)
    return system_box(f"{sensor}_mean", mean, ("mean",), {sensor: (message.name, message.size)})
