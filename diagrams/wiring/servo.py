"""The boxes of the servo, and of what it knows of the way of its commands to the rotors."""

from pydrake.systems.framework import System

from ortilo_drake.diagrams.wiring.own_part import own_servo_boxes
from ortilo_drake.diagrams.wiring.systems import require_ports, system_box
from ortilo_drake.loop.element import Box
from ortilo_drake.model.signals import N_XBAR
from ortilo_drake.onboard.commands.command_log import command_log_box
from ortilo_drake.onboard.commands.state_ahead import state_ahead_box
from ortilo_drake.onboard.servo.augmented_servo import augmented_servo_box
from ortilo_drake.onboard.servo.lq_gain import gain_of
from ortilo_drake.onboard.servo.lq_servo import SERVO_ESTIMATE, servo_box
from ortilo_drake.scenario import Belief, LqServo


def servo_boxes(
    scenario: Belief,
    belief: str,
    force: str,
    messages: dict[str, Box],
    own: System | None,
    signals: dict[str, tuple[str, int]],
) -> list[Box]:
    """Return the servo, `servo`, with what it acts on.

    Args:
        scenario: the scenario.
        belief: the box that says the belief of [x; i].
        force: the box that says the force that is believed to act.
        messages: which box says each sensor's message as it lands.
        own: a servo of one's own that is a System.
        signals: what its inputs may read, see system_box.

    Raises:
        InputError: if a servo of one's own has not the ports that it needs.
    """
    commands, vehicle, boxes = scenario.commands, scenario.vehicle, list[Box]()
    reference = "reference"
    if commands.are_kept:
        boxes.append(command_log_box(scenario).with_inputs(control="servo", acted="acted_delivered"))
        signals = signals | {"timeline": ("command_log", boxes[-1].size)}
    if commands.servo == "predicted":
        ahead = state_ahead_box(vehicle, scenario.h, scenario.yaw)
        boxes.append(ahead.with_inputs(belief=belief, force=force, timeline="command_log"))
        belief, reference = "state_ahead.belief", "state_ahead.reference"
        signals = signals | {"estimate": (belief, N_XBAR), "reference": (reference, 9)}
    if own is not None:
        require_ports(own, ("estimate", "reference"), ("control",), "servo")
        return [*boxes, system_box("servo", own, ("control",), signals)]
    if scenario.lends_velocities:
        boxes.append(Box("servo_estimate", SERVO_ESTIMATE, N_XBAR).with_inputs(belief=belief))
        belief = "servo_estimate"
    if not isinstance(scenario.servo, LqServo):
        says = {"force": force, "reference": reference}
        return [*boxes, *own_servo_boxes(scenario, belief, says, messages)]
    if commands.servo == "augmented":
        servo = augmented_servo_box(scenario.servo, vehicle, scenario.h, commands.delay or 0.0)
    else:
        servo = servo_box(gain_of(scenario), vehicle.mass, scenario.servo)
    return [*boxes, servo.with_inputs(belief=belief, force=force, reference=reference)]
