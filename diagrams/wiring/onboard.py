"""The boxes of the onboard half: an estimator, the servo and the planner.

Of every estimator the box `filter` has the belief, and `handler` says y, delta and V2.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from pydrake.systems.framework import System
from pydrake.trajectories import Trajectory

from ortilo_drake.diagrams.wiring.intermittent import filtering_of, intermittent_boxes
from ortilo_drake.diagrams.wiring.own_part import BELIEF, own_box, own_estimator_boxes, system_estimator_boxes, wired
from ortilo_drake.diagrams.wiring.systems import require_ports, system_box
from ortilo_drake.diagrams.wiring.tight import tight_boxes
from ortilo_drake.loop.element import Box, constant, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import ACTED_SIZE, N_U, N_XBAR, REFERENCE_SIZE, VELOCITY_SIZE
from ortilo_drake.onboard.commands.timeline import command_log_box, state_ahead_box
from ortilo_drake.onboard.estimator.filter_element import extra_box, parts_box
from ortilo_drake.onboard.estimator.resume import initial_estimate
from ortilo_drake.onboard.planner.planned import Planned, start_of
from ortilo_drake.onboard.planner.players import PathPlayer, reference_box
from ortilo_drake.onboard.servo.lq_gain import gain_of
from ortilo_drake.onboard.servo.lq_servo import TRUE_VELOCITY, augmented_servo_box, servo_box
from ortilo_drake.scenario import Belief, LqServo
from ortilo_drake.sensors.described import port_of

AROUND = {"servo": N_U, "reference": REFERENCE_SIZE, "velocity": VELOCITY_SIZE, "acted_delivered": ACTED_SIZE}
INPUTS_NAMED = {"servo": "control", "acted_delivered": "acted"}  # as Drake's ports are named
ESTIMATORS = {"intermittent": intermittent_boxes, "tight": tight_boxes}


class Parts(NamedTuple):
    """Parts in place of those that a scenario names, as functions; see diagrams/onboard.py."""

    estimator: Callable[[Belief, np.ndarray], System] | None = None
    servo: Callable[[Belief], System] | None = None
    planner: Callable[[Belief], Planned] | None = None


NO_PARTS: Final = Parts()


def onboard_boxes(
    belief: Belief,
    room: Room,
    plan: Planned,
    ticks: int,
    messages: dict[str, Box],
    parts: Parts = NO_PARTS,
    takes_paths: bool = False,
) -> list[Box]:
    """Return the boxes of the onboard half.

    They read besides the messages boxes `velocity`, where a scenario lends the true ones, and `acted_delivered`, where
    it is told which commands acted.

    Args:
        belief: what is known of a scenario.
        room: its room as it was surveyed.
        plan: what is flown: a path, or the System or Box that says it.
        ticks: of the flight.
        messages: which box says each sensor's message as it lands.
        parts: in place of the scenario's.
        takes_paths: whether the path is an input of Drake's player.

    Raises:
        InputError: if a part of one's own has not the ports that it needs.
    """
    xbar_0 = initial_estimate(belief, start_of(plan))
    signals = {port_of(name): (box.name, box.size) for name, box in messages.items()}
    signals |= {"control": ("servo", N_U), "reference": ("reference", REFERENCE_SIZE)}
    signals |= {"velocity": ("velocity", VELOCITY_SIZE)} if belief.lends_velocities else {}
    signals |= {"acted": ("acted_delivered", ACTED_SIZE)} if belief.commands.are_reported else {}
    make = parts.estimator or system_of(belief, "estimator")
    if make is not None:
        estimator = system_estimator_boxes(belief, make(belief, xbar_0), signals)
    else:
        estimator = ESTIMATORS.get(belief.estimator.kind, own_estimator_boxes)(belief, room, xbar_0, messages)
    force = next((f"{box.name}.force" for box in estimator if "force" in box.parts), "no_force")
    boxes = [*estimator, *([constant(force, np.zeros(3))] if force == "no_force" else [])]
    signals |= {"estimate": ("belief_parts.estimate", N_XBAR), "covariance": ("belief_parts.covariance", N_XBAR**2)}
    signals |= {"force": (force, 3), "belief": (belief_in(estimator), BELIEF)}
    if isinstance(plan, Box):
        boxes += wired("planner", "reference", belief, plan, signals, messages)
    elif not isinstance(plan, Trajectory):
        boxes.append(system_box("reference", plan, ("reference",), signals))
    elif takes_paths:
        boxes.append(system_box("reference", PathPlayer(), ("y0",), {}))
    else:
        boxes.append(reference_box(plan, ticks, belief.h))
    make_servo = parts.servo or system_of(belief, "servo")
    own_servo = None if make_servo is None else make_servo(belief)
    boxes += servo_boxes(belief, belief_in(estimator), force, messages, own_servo, signals)
    if any(said.startswith("belief_parts.") for box in boxes for said in box.reads.values()):
        boxes.append(belief_parts_box(boxes))
    return boxes


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
    seen = "true_velocity" if scenario.lends_velocities else belief
    if scenario.lends_velocities:
        boxes.append(Box("true_velocity", TRUE_VELOCITY, N_XBAR).with_inputs(belief=belief))
    if not isinstance(scenario.servo, LqServo):
        signals = signals | ({"estimate": (seen, N_XBAR)} if scenario.lends_velocities else {})
        return [*boxes, *wired("servo", "servo", scenario, own_box("servo", scenario), signals, messages)]
    if commands.servo == "augmented":
        servo = augmented_servo_box(scenario.servo, vehicle, scenario.h, commands.delay or 0.0)
    else:
        servo = servo_box(gain_of(scenario), vehicle.mass, scenario.servo)
    return [*boxes, servo.with_inputs(belief=seen, force=force, reference=reference)]


def system_of(belief: Belief, role: str) -> Callable[..., System] | None:
    """Return the function that makes the System of a part that a scenario names; None if it is built in or an element.

    Of a planner it may make a path.
    """
    kind = getattr(getattr(belief, role), "kind", "")
    built_in = {"estimator": tuple(ESTIMATORS), "servo": ("lq",), "planner": ("gcs", "waypoints", "hover")}[role]
    found = None if kind in built_in else find_part(role, kind)
    return None if found is None or found.box is not None else found.make


def half_of(belief: Belief, heard: list[Box], boxes: list[Box]) -> tuple[Wiring, dict[str, str]]:
    """Return the wiring of a half that is alone, or of its estimator, and what each of its output ports says.

    It is made of the boxes that say its messages, `heard`, and the rest; what it reads of AROUND comes from outside
    where it is not among them.
    """
    named = {box.name for box in boxes}
    around = [outside(name, size) for name, size in AROUND.items() if name not in named]
    said = {"control": "servo", "estimate": "belief_parts.estimate", "covariance": "belief_parts.covariance"}
    said |= {"reference": "reference"} | measurement_in(boxes)
    shown = [] if "belief_parts" in named else [belief_parts_box(boxes)]
    if "vehicle_belief" in named:
        its = filtering_of(belief)
        shown.append(extra_box("extra", its.n).with_inputs(belief=its.belief))
        said |= {"force": "vehicle_belief.force", "extra": "extra"}
    signals = {signal: box for signal, box in said.items() if box not in AROUND or box in named}
    return Wiring([*heard, *around, *boxes, *shown]), signals


def belief_parts_box(boxes: list[Box]) -> Box:
    """Return the box that splits a belief into `estimate` (15) and `covariance` (225), for Drake's ports."""
    return parts_box("belief_parts").with_inputs(belief=belief_in(boxes))


def belief_in(boxes: list[Box]) -> str:
    """Return the name of the belief of [x; i] (240) that was predicted for this tick."""
    named = {box.name: box for box in boxes}
    if "vehicle_belief" in named:
        return "vehicle_belief.belief"
    return "filter.belief" if "belief" in named["filter"].parts else "filter"


def measurement_in(boxes: list[Box]) -> dict[str, str]:
    """Return the names of y, delta and V2 as they reach the filter."""
    named = {box.name: box for box in boxes}
    told = "robust_gate" if "robust_gate" in named else "handler"
    own = named["estimator"].parts if "estimator" in named else {}
    return {name: f"estimator.{name}" if name in own else f"{told}.{name}" for name in ("y", "delta", "V2")}
