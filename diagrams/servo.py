"""The LQ servo by itself, as one system."""

import numpy as np
from pydrake.systems.framework import System

from ortilo_drake.diagrams.wiring.onboard import servo_boxes
from ortilo_drake.loop.element import constant, outside
from ortilo_drake.loop.shell import WiredSystem_
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.signals import N_XBAR, REFERENCE_SIZE, VELOCITY_SIZE
from ortilo_drake.scenario import Belief


def make_lq_servo(scenario: Belief, takes_force: bool = False) -> System:
    """Return the servo of a scenario whose commands act at once; it is memoryless.

    Ports: those of make_servo (single_parts.py), and
        velocity (8): velocity message; only where the scenario lends the servo the truth.

    Args:
        scenario: the scenario, of which the belief is all that is taken.
        takes_force: whether it is told the force.

    Raises:
        InputError: if there is no gain.
    """
    belief = scenario.belief
    inputs = [outside("estimate", N_XBAR), outside("reference", REFERENCE_SIZE)]
    inputs.append(outside("force", 3) if takes_force else constant("force", np.zeros(3)))
    inputs += [outside("velocity", VELOCITY_SIZE)] if belief.lends_velocities else []
    wiring = Wiring([*inputs, *servo_boxes(belief, "estimate", "force", {}, None, {})])
    return WiredSystem_[float]("lq_servo", wiring, {"control": ("servo",)}, belief.h)
