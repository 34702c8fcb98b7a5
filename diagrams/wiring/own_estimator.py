"""The boxes of an estimator of one's own."""

from dataclasses import replace

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.diagrams.wiring.systems import require_ports, system_box
from ortilo_drake.loop.element import Box, constant
from ortilo_drake.model.input_error import InputError
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import N_X, N_XBAR, PAYLOAD, SENSORS
from ortilo_drake.onboard.estimator.own_element import own_estimator_box
from ortilo_drake.onboard.estimator.whole_belief import together_box, widened_box
from ortilo_drake.scenario import Belief


def own_estimator_boxes(belief: Belief, room: Room, xbar_0: np.ndarray, messages: dict[str, Box]) -> list[Box]:
    """Return an estimator that was registered with a compiled share; arguments as of intermittent_boxes.

    What it makes of its messages it does not tell: of its `handler` nothing arrives.

    Raises:
        ValueError: if it has no such share.
    """
    kind = belief.estimator.kind
    part = find_part("estimator", kind)
    if part is None or part.compiled is None:
        raise ValueError(f"estimator.kind: {kind}: has no compiled form")
    silent = {name: constant(f"no_{name}", np.zeros(PAYLOAD)) for name in SENSORS if name not in messages}
    said = {name: (silent | messages)[name].name for name in SENSORS}
    own = own_estimator_box("filter", part.compiled, belief, xbar_0)
    return [own.reading(**said, control="servo"), silent_handler(belief), *silent.values()]


def silent_handler(belief: Belief) -> Box:
    """Return a handler of which nothing arrives."""
    parts, at = {}, 0
    for name, size in belief.measurement.sizes.items():
        parts[name], at = (at, size), at + size
    return replace(constant("handler", np.zeros(at)), parts=parts)


def system_estimator_boxes(belief: Belief, system: System, signals: dict[str, tuple[str, int]]) -> list[Box]:
    """Return the boxes of an estimator that is a System: `estimator`, and `filter`, which says its belief.

    An estimator of the twelve states gets the integral of the position error beside them.

    Args:
        belief: what is known of the scenario.
        system: the estimator.
        signals: what its inputs may read, see system_box.

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
    boxes = [own, whole.reading(estimate="estimator.estimate", covariance="estimator.covariance")]
    told = [name for name in sizes if name in own.parts]
    if len(told) < len(sizes):
        boxes.append(silent_handler(belief))
    return boxes
