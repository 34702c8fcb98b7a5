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

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.diagrams.wiring.systems import require_ports, system_box
from ortilo_drake.loop.element import Box, constant, parts_of
from ortilo_drake.loop.own import output_at_first
from ortilo_drake.loop.raised import ElementError
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_U, N_X, N_XBAR, PAYLOAD, REFERENCE_SIZE, SENSORS
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.belief import together_box, widened_box
from ortilo_drake.scenario import Belief
from ortilo_drake.scenario.own_parts import box_of

BELIEF = N_XBAR + N_XBAR * N_XBAR
OF_VEHICLE = N_X + N_X * N_X
SAYS = {"estimator": (BELIEF, OF_VEHICLE), "servo": (N_U,), "planner": (REFERENCE_SIZE,)}
READS = ("force", "reference", "control", "estimate", "covariance", "belief")  # beside messages
LATER = {"estimator": ("reference", "control"), "servo": ("control",)}  # of a planner: onboard/planner/planned.py


def own_estimator_boxes(belief: Belief, room: Room, xbar_0: np.ndarray, messages: dict[str, Box]) -> list[Box]:
    """Return an estimator of one's own that is an element, `filter`; arguments as of intermittent_boxes.

    What it makes of its messages it does not tell: of its `handler` nothing arrives.
    """
    made = own_box("estimator", belief, xbar_0)
    signals = {"reference": ("reference", REFERENCE_SIZE), "control": ("servo", N_U)}
    if made.size == BELIEF:
        return [silent_handler(belief), *wired("estimator", "filter", belief, made, signals, messages)]
    made = replace(made, parts={"estimate": (0, N_X), "covariance": (N_X, N_X * N_X)})
    whole = widened_box().with_inputs(estimate="own_filter.estimate", covariance="own_filter.covariance")
    return [silent_handler(belief), whole, *wired("estimator", "own_filter", belief, made, signals, messages)]


def silent_handler(belief: Belief) -> Box:
    """Return a handler of which nothing arrives."""
    sizes = belief.measurement.sizes
    return replace(constant("handler", np.zeros(sum(sizes.values()))), parts=parts_of(sizes))


def system_estimator_boxes(belief: Belief, system: System, signals: dict[str, tuple[str, int]]) -> list[Box]:
    """Return the boxes of an estimator that is a System: `estimator`, and `filter`, which says its belief.

    An estimator of the twelve states gets the integral of the position error beside them. Its inputs may read what
    stands in `signals`, see system_box.

    Raises:
        InputError: if it has not the ports that it needs, or not the sizes.
    """
    require_ports(system, (), ("estimate", "covariance"), "estimator")
    n, squared = (system.GetOutputPort(name).size() for name in ("estimate", "covariance"))
    if n not in (N_X, N_XBAR) or squared != n * n:
        raise InputError(
            f"estimator: {system.get_name()}: estimate ({n}) and covariance ({squared}): must be {N_X} or {N_XBAR} "
            "numbers, and their square"
        )
    sizes = belief.measurement.sizes
    says = ("estimate", "covariance", *(name for name in ("force", *sizes) if system.HasOutputPort(name)))
    own = system_box("estimator", system, says, signals)
    whole = together_box() if n == N_XBAR else widened_box()
    boxes = [own, whole.with_inputs(estimate="estimator.estimate", covariance="estimator.covariance")]
    return boxes if sizes.keys() <= own.parts.keys() else [*boxes, silent_handler(belief)]


def own_box(role: str, belief: Belief, *arguments: np.ndarray) -> Box:
    """Return the box of the part of a role that a scenario names, an element, as the part makes it."""
    kind = getattr(belief, role).kind
    part: Any = find_part(role, kind)
    made: Box = box_of(part, f"{role}.kind: {kind}", belief, *arguments)
    return made


def wired(
    role: str,
    name: str,
    scenario: Belief,
    made: Box,
    signals: dict[str, tuple[str, int]],
    messages: dict[str, Box],
) -> list[Box]:
    """Return a part under a name in the wiring, with what it reads and nobody else.

    Args:
        role: estimator, servo or planner.
        name: in the wiring.
        scenario: that names the part.
        made: the part.
        signals: those of READS that it may read, and others, see system_box.
        messages: which box says each sensor's message as it lands.

    Raises:
        InputError: if it says or reads what a part of its role does not.
    """
    element, kind = made.element, getattr(scenario, role).kind
    if made.size not in SAYS[role]:
        allowed = " or ".join(map(str, SAYS[role]))
        raise InputError(f"{role}.kind: {kind}: says {made.size} numbers, must say {allowed}")
    added = {sensor: constant(f"{name}_no_{sensor}", np.zeros(PAYLOAD)) for sensor in SENSORS if sensor not in messages}
    known = {sensor: (box.name, box.size) for sensor, box in messages.items()}
    known |= {name: signals[name] for name in READS if name in signals}
    known |= {sensor: (box.name, box.size) for sensor, box in added.items()}
    for what, function in element.functions.items():
        there = [port for port in known if what == "step" or port not in LATER.get(role, ())]
        for port in element.inputs_of(function):
            if port not in there:
                raise InputError(f"{role}.kind: {kind}: {what} reads {port!r}, must be one of {', '.join(there)}")
    _try_out(made, {port: size for port, (_, size) in known.items()}, f"{role}.kind: {kind}")
    part = replace(made, name=name, reads={port: known[port][0] for port in element.inputs})
    return [part, *(box for sensor, box in added.items() if sensor in element.inputs)]


def _try_out(box: Box, sizes: Mapping[str, int], whose: str) -> None:
    """Call out and step once in plain Python, before numba compiles them.

    numba answers a misspelt name with a page, and does not check an index: a write beyond an array would go into
    whatever lies there. Other errors may come of the inputs' zeros, so they are left to the flight.

    Raises:
        InputError: if a name or an attribute is unknown, an index lies outside its array, or anything is returned.
    """
    for what in box.element.functions:
        try:
            with np.errstate(all="ignore"):
                output_at_first(box, what, sizes)
        except (NameError, AttributeError, IndexError, ElementError) as error:
            of_n = isinstance(error, AttributeError) and isinstance(error.obj, np.record)
            said = f"n has no {getattr(error, 'name', '')!r}" if of_n else f"{error}"
            raise InputError(f"{whose}: {what}: {said}") from None
        except Exception:
            continue
