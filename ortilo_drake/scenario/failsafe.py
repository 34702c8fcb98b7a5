"""Settings of the failsafe: what the vehicle does on its own while no commands come, in real time."""

import math
from typing import Annotated

from pydantic import Field, NonNegativeFloat

from ortilo_drake.model.typed_yaml import Frozen, Positive

Frequency = Annotated[float, Field(gt=0.0, le=20.0)]


class Failsafe(Frozen):
    """The flight controller's hold and landing while no command comes."""

    timeout: Positive = 0.2
    """largest age of a command that still counts [s]."""
    hold_for: NonNegativeFloat = 5.0
    """time without a command after which the vehicle descends [s], counted from the hold's start."""
    descent_rate: Positive = 0.3
    """vertical speed of the descent [m/s]."""
    landing_height: NonNegativeFloat = 0.15
    """z of the centre of mass of the vehicle standing on its legs [m]; ours."""
    max_tilt: Annotated[float, Field(gt=0.0, le=math.pi / 4.0)] = math.radians(20.0)
    """largest roll or pitch asked for to brake [rad]."""
    braking_frequency: Frequency = 3.0
    """p, where the horizontal velocity has its triple pole [rad/s]."""
    altitude_frequency: Frequency = 2.0
    """w_z, where the altitude has its double pole [rad/s]."""
    yaw_frequency: Frequency = 2.0
    """w_psi, where the yaw has its double pole [rad/s]."""
