"""Functions that register your own parts, so that scenarios may name them."""

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
        kind: the estimator's name in a scenario.
        settings: the estimator's group in a scenario, a frozen model with the field `kind: Literal[...]`.
        make: (Belief, first estimate xbar_0 (15)) -> System, see diagrams/onboard.py.
        box: (Belief, first estimate xbar_0 (15)) -> Box of an element, see diagrams/wiring/own_part.py.
        linear: Belief -> the paper's filter that the estimator equals about hover: W, V, and what it reads of the imu.
            Only with `linear` the linear theory (`ortilo analyze`, tube, maps, margins, floor) covers the estimator.

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
    """Let scenarios name a servo: `servo: {kind: mine, ...}`; errors as in register_estimator.

    Args:
        kind: as in register_estimator.
        settings: as in register_estimator.
        make: Belief -> System.
        box: Belief -> Box.
        gain: Belief -> L (4, 15) about hover at the heading that is held, u = -L [x - x_ref; i] + u_ff, for a servo
            that does not read `force`. Only with `gain` the linear theory (`ortilo analyze`, tube, maps, margins)
            covers the servo.
    """
    register_part("servo", Part(kind, settings, make, box, gain))


def register_planner(
    kind: str,
    settings: type[Frozen],
    make: Callable[[Belief], Planned] | None = None,
    box: Callable[[Belief], Box] | None = None,
) -> None:
    """Let scenarios name a planner: `planner: {kind: mine, ...}`; `kind`, `settings`, errors as in register_estimator.

    `make` returns a Trajectory p_WB(t) (3 rows) [m], or a System whose output is the reference (9); `box` returns a Box
    whose output is the reference. With a System or a Box the settings must have a field `duration` [s].
    """
    register_part("planner", Part(kind, settings, make, box))


def register_detector(
    kind: str,
    settings: type[Frozen],
    make: Callable[[Any, tuple[str, ...], tuple[int, int]], Callable[[np.ndarray], Boxes]],
) -> None:
    """Let scenarios name a detector: `detector: {kind: mine, ...}`. It reads the pictures of a rendered camera.

    Args:
        kind: the detector's name in a scenario.
        settings: the detector's group in a scenario, a frozen model with the field `kind: Literal[...]`.
        make: (settings, classes of the room, (width, height) of the picture [px]) -> function from a picture (RGB,
            (height, width, 3), uint8) to detections: labels (k), each an index into the classes; scores (k), above 0
            and at most 1; and boxes (k, 4), u_min, v_min, u_max, v_max [px], where the centre of the first pixel is
            (0, 0). The detections are used as they are: the detector itself must suppress duplicates.

    Raises:
        InputError: if the settings have no kind.
    """
    register_part("detector", Part(kind, settings, make))


def register_fault(kind: str, settings: type[Fault], box: Callable[[Any, int, float], Box]) -> None:
    """Let scenarios name a fault of a sensor's messages: `faults: [{kind: mine, start: 5.0, ...}]`.

    Args:
        kind: the fault's name in a scenario.
        settings: the fault's group in a scenario, a Fault with the fields `kind: Literal[...]` and `sensor`; the fault
            changes the messages of this sensor.
        box: (settings, size of the message, length h of a tick [s]) -> Box whose output is the changed message while
            the fault lasts; the Box may read `message`, the unchanged one, and the true `state` (12).

    Raises:
        InputError: if the settings lack one of these fields.
    """
    register_part("fault", Part(kind, settings, box=box))
