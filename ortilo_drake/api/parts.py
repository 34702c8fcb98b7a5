"""Parts of one's own, registered so that scenarios may name them."""

from __future__ import annotations  # help() shows types by their names

from collections.abc import Callable
from typing import Any

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.loop.element import Box
from ortilo_drake.model.parts import Part, register_part
from ortilo_drake.model.typed_yaml import Frozen
from ortilo_drake.onboard.detector.detector import Boxes
from ortilo_drake.onboard.planner.planned import Planned
from ortilo_drake.scenario import Belief, IntermittentFilter
from ortilo_drake.scenario.faults import Fault


def register_estimator(
    kind: str,
    settings: type[Frozen],
    make: Callable[[Belief, np.ndarray], System] | None = None,
    box: Callable[[Belief, np.ndarray], Box] | None = None,
    linear: Callable[[Belief], IntermittentFilter] | None = None,
) -> None:
    """Let scenarios name an estimator: `estimator: {kind: mine, ...}`.

    Args:
        kind: its name there.
        settings: its group of a scenario, a frozen model with the field `kind: Literal[...]`.
        make: (scenario, first estimate xbar_0 (15)) -> System, see diagrams/onboard.py.
        box: the same as an element, see diagrams/wiring/own_part.py.
        linear: Belief -> the paper's filter that it is about hover: W, V, and what it reads of the imu. With it the
            linear theory (`ortilo analyze`, tube, maps, margins, floor) covers it; without it they refuse it.

    Raises:
        InputError: if the settings have no kind, or neither make nor box is given.
    """
    register_part("estimator", Part(kind, settings, make, box, linear=linear))


def register_servo(
    kind: str,
    settings: type[Frozen],
    make: Callable[[Belief], System] | None = None,
    box: Callable[[Belief], Box] | None = None,
    gain: Callable[[Belief], np.ndarray] | None = None,
) -> None:
    """Let scenarios name a servo: `servo: {kind: mine, ...}`; other arguments and errors as register_estimator.

    Args:
        kind: as register_estimator.
        settings: as register_estimator.
        make: Belief -> System.
        box: Belief -> Box.
        gain: Belief -> L (4, 15) about hover at the heading that is held, u = -L [x - x_ref; i] + u_ff, of a servo
            that does not read `force`. With it the linear theory (`ortilo analyze`, tube, maps, margins) knows the
            servo; without it they say that it does not.
    """
    register_part("servo", Part(kind, settings, make, box, gain))


def register_planner(
    kind: str,
    settings: type[Frozen],
    make: Callable[[Belief], Planned] | None = None,
    box: Callable[[Belief], Box] | None = None,
) -> None:
    """Let scenarios name a planner: `planner: {kind: mine, ...}`; arguments and errors as register_estimator.

    It returns a Trajectory p_WB(t) (3 rows) [m], or a System or a Box whose output is the reference (9): its
    settings then have a field `duration` [s].
    """
    register_part("planner", Part(kind, settings, make, box))


def register_detector(
    kind: str,
    settings: type[Frozen],
    make: Callable[[Any, tuple[str, ...], tuple[int, int]], Callable[[np.ndarray], Boxes]],
) -> None:
    """Let scenarios name a detector: `detector: {kind: mine, ...}`. It looks at the pictures of a rendered camera.

    Args:
        kind: its name there.
        settings: its group of a scenario, a frozen model with the field `kind: Literal[...]`.
        make: (its settings, the room's classes, width and height of the picture [px]) -> function from a picture (RGB,
            (height, width, 3), uint8) to what it finds: labels (k), each the place of its class among the room's;
            scores (k), above 0 and at most 1; and boxes (k, 4), u_min, v_min, u_max, v_max [px], where the centre of
            the first pixel is (0, 0). Nothing else is done with them: it suppresses doubles itself.

    Raises:
        InputError: if the settings have no kind.
    """
    register_part("detector", Part(kind, settings, make))


def register_fault(kind: str, settings: type[Fault], box: Callable[[Any, int, float], Box]) -> None:
    """Let scenarios name a fault of a sensor's messages: `faults: [{kind: mine, start: 5.0, ...}]`.

    Args:
        kind: its name there.
        settings: its group of a scenario, a Fault with the fields `kind: Literal[...]` and `sensor`, whose messages
            change.
        box: (its settings, size of the message, tick h [s]) -> Box that says the message as it is while the fault
            lasts; it may read `message`, as it was, and `state` (12), the true one.

    Raises:
        InputError: if the settings have no such fields.
    """
    register_part("fault", Part(kind, settings, box=box))
