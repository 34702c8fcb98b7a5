"""The boxes between a sensor's message as it lands and what the handler takes of it."""

from ortilo_drake.diagrams.wiring.systems import system_box
from ortilo_drake.loop.element import Box
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.estimator.filter_element import parts_box
from ortilo_drake.onboard.fix_solver import own_fix_box
from ortilo_drake.scenario import Belief
from ortilo_drake.sensors.described import described_per_tick
from ortilo_drake.sensors.messages import message_port


def solver_boxes(belief: Belief, room: Room, sensor: str, message: Box, at: str) -> list[Box]:
    """Return the boxes that make a fix of a sensor's message, the last one says it; none where none is needed.

    Args:
        belief: what is known of a scenario.
        room: its room as it was surveyed.
        sensor: the sensor's name; one whose message begins with its value needs no fix.
        message: its message.
        at: the box, or its part, of the belief of [x; i] (240) about which the fix is solved. A System reads it in two
            parts, `<sensor>_prior`.
    """
    its, solver = described_per_tick(sensor, belief), None
    make = its.make_onboard
    if belief.samples(sensor) == 1 and its.compiled is not None:
        solver, make = own_fix_box(sensor, its.compiled, len(its.rows), belief, room), None
    elif belief.samples(sensor) == 1 and its.solver is not None:
        solver = its.solver(belief, room)
    if solver is not None:
        return [solver.with_inputs(message=message.name, belief=at)]
    if make is None:
        return []
    system, prior = make(belief, room), f"{sensor}_prior"
    signals = {message_port(system).get_name(): (message.name, message.size)}
    signals |= {"estimate": (f"{prior}.estimate", N_XBAR), "covariance": (f"{prior}.covariance", N_XBAR**2)}
    fix = system_box(f"{sensor}_fix", system, (system.get_output_port().get_name(),), signals)
    return [parts_box(prior).with_inputs(belief=at), fix]
