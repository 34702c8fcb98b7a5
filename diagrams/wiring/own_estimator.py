"""The boxes of an estimator of one's own."""

from dataclasses import replace

import numpy as np

from ortilo_drake.diagrams.onboard import initial_estimate
from ortilo_drake.loop.element import Box, constant
from ortilo_drake.model.parts import find_part
from ortilo_drake.model.room import Room
from ortilo_drake.model.signals import PAYLOAD, SENSORS
from ortilo_drake.onboard.estimator.own_element import own_estimator_box
from ortilo_drake.scenario import Scenario


def own_estimator_boxes(scenario: Scenario, room: Room, r_0: np.ndarray, messages: dict[str, Box]) -> list[Box]:
    """Return an estimator that was registered with a compiled share; arguments as of onboard_boxes.

    What it makes of its messages it does not tell: of its `handler` nothing arrives.

    Raises:
        ValueError: if it has no such share.
    """
    belief, kind = scenario.belief, scenario.estimator.kind
    part = find_part("estimator", kind)
    if part is None or part.compiled is None:
        raise ValueError(f"estimator.kind: {kind}: has no compiled form")
    silent = {name: constant(f"no_{name}", np.zeros(PAYLOAD)) for name in SENSORS if name not in messages}
    said = {name: (silent | messages)[name].name for name in SENSORS}
    own = own_estimator_box("filter", part.compiled, belief, initial_estimate(belief, r_0))
    parts, at = {}, 0
    for name, size in belief.measurement.sizes.items():
        parts[name], at = (at, size), at + size
    handler = replace(constant("handler", np.zeros(at)), parts=parts)
    return [own.reading(**said, control="servo"), handler, *silent.values()]
