"""The boxes of an estimator, a servo or a planner of one's own that is an element (model/parts.py, Part.box).

What it may read, by the names of its functions' parameters; what is in brackets only `step` reads, as it is said later
in a tick than what the part itself says:

    part        says                reads
    estimator   belief (240 or 156) messages, (reference, control)
    servo       control (4)         messages, reference, belief, estimate, covariance, force, (control)
    planner     reference (9)       belief, estimate, covariance, force, (messages, reference, control)

    messages            each sensor's by its name as it lands, see model/signals.py; zeros of uwb, camera or imu where
                        it does not fly
    belief              [estimate (15), covariance row by row (225)] that was predicted for this tick
    estimate            xhat and, in its last three entries, the integral of the position error (15)
    covariance          its covariance row by row (225)
    force               the disturbance force in W that is believed to act [N] (3); 0 where no estimator knows it
    reference           r, r_dot, r_ddot (9)
    control             u_k (4)

An estimator says the belief, or that of the vehicle's twelve states [estimate (12), covariance (144)]: the integral,
which is known, is added to it.
"""

from dataclasses import replace

import numpy as np

from ortilo_drake.diagrams.onboard import initial_estimate
from ortilo_drake.loop.element import Box, constant
from ortilo_drake.loop.own import cut
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_U, N_X, N_XBAR, PAYLOAD, REFERENCE_SIZE, SENSORS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.integral_element import integral_box
from ortilo_drake.scenario import Belief, Scenario

BELIEF = N_XBAR + N_XBAR * N_XBAR
OF_VEHICLE = N_X + N_X * N_X
CUTS = {"estimate": (0, N_XBAR), "covariance": (N_XBAR, N_XBAR * N_XBAR)}
SAYS = {"estimator": (BELIEF, OF_VEHICLE), "servo": (N_U,), "planner": (REFERENCE_SIZE,)}
LATER = {"estimator": ("reference", "control"), "servo": ("control",)}  # of a planner: onboard/planner/planned.py


def own_estimator_boxes(scenario: Scenario, room: Room, r_0: np.ndarray, messages: dict[str, Box]) -> list[Box]:
    """Return an estimator of one's own, `filter`; arguments as of onboard_boxes.

    What it makes of its messages it does not tell: of its `handler` nothing arrives.
    """
    belief = scenario.belief
    made = own_box("estimator", belief, initial_estimate(belief, r_0))
    says = {"reference": "reference", "control": "servo"}
    parts, at = {}, 0
    for name, size in belief.measurement.sizes.items():
        parts[name], at = (at, size), at + size
    handler = replace(constant("handler", np.zeros(at)), parts=parts)
    if made.size == BELIEF:
        return [handler, *wired("estimator", "filter", belief, made, says, messages)]
    whole = integral_box("filter").reading(belief="own_filter")
    return [handler, whole, *wired("estimator", "own_filter", belief, made, says, messages)]


def own_servo_boxes(scenario: Scenario, belief: str, says: dict[str, str], messages: dict[str, Box]) -> list[Box]:
    """Return a servo of one's own, `servo`; arguments as of wired."""
    its = scenario.belief
    return wired("servo", "servo", its, own_box("servo", its), says | {"control": "servo"}, messages, belief)


def own_planner_boxes(scenario: Scenario, made: Box, belief: str, force: str, messages: dict[str, Box]) -> list[Box]:
    """Return a planner of one's own, `reference`, by its own box; the rest as of wired."""
    says = {"force": force, "reference": "reference", "control": "servo"}
    return wired("planner", "reference", scenario.belief, made, says, messages, belief)


def own_box(role: str, belief: Belief, *arguments: np.ndarray) -> Box:
    """Return the box of the part of a role that a scenario names, as the part makes it.

    Raises:
        InputError: if it is no element.
    """
    kind = getattr(belief, role).kind
    part = find_part(role, kind)
    if part is None or part.box is None:
        raise InputError(f"{role}.kind: {kind}: is no element")
    box: Box = part.box(belief, *arguments)
    return box


def wired(
    role: str,
    name: str,
    scenario: Belief,
    made: Box,
    says: dict[str, str],
    messages: dict[str, Box],
    belief: str | None = None,
) -> list[Box]:
    """Return a part under a name in the wiring, with what it reads and nobody else.

    Args:
        role: estimator, servo or planner.
        name: in the wiring.
        scenario: that names the part.
        made: the part.
        says: which box says what the part may read, messages and belief apart.
        messages: which box says each sensor's message as it lands.
        belief: which box says the belief, of which it may read parts; None where it may not.

    Raises:
        InputError: if it says or reads what a part of its role does not.
    """
    element, kind = made.element, getattr(scenario, role).kind
    if made.size not in SAYS[role]:
        sizes = " or ".join(map(str, SAYS[role]))
        raise InputError(f"{role}.kind: {kind}: says {made.size} numbers, must say {sizes}")
    silent = {
        sensor: constant(f"{name}_no_{sensor}", np.zeros(PAYLOAD)) for sensor in SENSORS if sensor not in messages
    }
    cuts = {part: cut(f"{name}_{part}", *its).reading(whole=belief) for part, its in CUTS.items()} if belief else {}
    added = silent | cuts
    known = (
        {sensor: box.name for sensor, box in messages.items()} | says | {part: box.name for part, box in added.items()}
    )
    known |= {"belief": belief} if belief else {}
    for what, function in element.functions.items():
        allowed = [port for port in known if what == "step" or port not in LATER.get(role, ())]
        for port in element.inputs_of(function):
            if port not in allowed:
                raise InputError(f"{role}.kind: {kind}: {what} reads {port!r}, must be one of {', '.join(allowed)}")
    reads = {port: known[port] for port in element.inputs}
    return [replace(made, name=name, reads=reads), *(box for port, box in added.items() if port in element.inputs)]
