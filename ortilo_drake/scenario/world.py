"""Settings of the simulated physics, of the failsafe, and of the treatment of late commands."""

import math
from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, model_validator

from ortilo_drake.model.typed_yaml import Frozen, Positive
from ortilo_drake.model.white_noise import USUAL_ROOT, white_sd


class Commands(Frozen):
    """How filter and servo account for the delay and loss of commands on their way to the rotors."""

    filter: Literal["sent", "acted"] = "sent"
    """'sent' is the paper's filter: it predicts as if each command acted at its own tick. 'acted' predicts with the
    commands that acted, at the times at which the world reports that they acted, and corrects past ticks when a report
    comes late; only with estimator.delay 'replay'."""
    servo: Literal["present", "predicted", "augmented"] = "present"
    """'present' uses the state of the tick. 'predicted' uses the state and the reference predicted for the time at
    which the command will act, given the commands on their way. 'augmented' uses the state of the tick and the commands
    on their way, with the LQ gain of a plant that has these commands as states."""
    delay: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """time from the tick of a command until it acts [s]. null uses the delays that the world reports; 'augmented' needs
    a number, because its gain is computed before the flight."""

    @property
    def are_reported(self) -> bool:
        """True if the world reports which commands acted."""
        return self.filter == "acted" or (self.servo == "predicted" and self.delay is None)

    @property
    def are_kept(self) -> bool:
        """True if the onboard half keeps its commands."""
        return self.filter == "acted" or self.servo == "predicted"


Frequency = Annotated[float, Field(gt=0.0, le=20.0)]


class Failsafe(Frozen):
    """The flight controller's hold and landing while no command arrives."""

    timeout: Positive = 0.2
    """largest age of a command that still counts [s]."""
    hold_for: NonNegativeFloat = 5.0
    """time without a command, from the start of the hold, after which the vehicle descends [s]."""
    descent_rate: Positive = 0.3
    """vertical speed of the descent [m/s]."""
    landing_height: NonNegativeFloat = 0.15
    """z in W of the centre of mass while the vehicle stands on its legs [m]; our own value."""
    max_tilt: Annotated[float, Field(gt=0.0, le=math.pi / 4.0)] = math.radians(20.0)
    """largest roll or pitch commanded to brake [rad]."""
    braking_frequency: Frequency = 3.0
    """p: the horizontal velocity has a triple pole at -p [rad/s]."""
    altitude_frequency: Frequency = 2.0
    """w_z: the altitude has a double pole at -w_z [rad/s]."""
    yaw_frequency: Frequency = 2.0
    """w_psi: the yaw has a double pole at -w_psi [rad/s]."""


DragCoefficient = Annotated[float, Field(ge=0.0, le=10.0)]


class IdealRotors(Frozen):
    """The control acts on the body at once and without limit, as in the paper's model."""

    kind: Literal["ideal"] = "ideal"


class FirstOrderRotors(Frozen):
    """The control is mixed to rotor speeds, which are limited and lag by the vehicle's first-order time constants."""

    kind: Literal["first_order"]


class Disturbance(Frozen):
    """White Gaussian force in W and torque in B, drawn each tick h and held over it, with sd density / sqrt(h)."""

    force_density: NonNegativeFloat = 0.27 * USUAL_ROOT
    """noise density of the force per axis [N/sqrt(Hz)]; the default is 0.27 N in a tick of 1/30 s."""
    torque_density: NonNegativeFloat = 0.005 * USUAL_ROOT
    """noise density of the torque per axis [N m/sqrt(Hz)]; the default is 0.005 N m in a tick of 1/30 s."""

    def sds(self, h: float) -> tuple[float, float]:
        """Return the standard deviations of force [N] and torque [N m] in a tick of h [s]."""
        return white_sd(self.force_density, h), white_sd(self.torque_density, h)


class World(Frozen):
    """The simulated physics apart from the sensors."""

    kinematics: Literal["linear", "small_angle", "rigid_body"] = "small_angle"
    """'small_angle' is the paper's nonlinear model, 'rigid_body' has proper Euler-rate kinematics, 'linear' is the
    paper's linearisation at hover."""
    plant: Literal["sampled", "continuous"] = "sampled"
    """'sampled' steps the vehicle once a tick by the classical Runge-Kutta method with the inputs held; Drake's
    simulator then has nothing to integrate. With 'continuous' Drake integrates the vehicle. Rotors with a lag need
    'continuous'. If a sensor is faster than the tick, the plant is always integrated, from sample to sample."""
    rotors: Annotated[IdealRotors | FirstOrderRotors, Field(discriminator="kind")] = IdealRotors()
    """model of the rotors between the control and the body."""
    disturbance: Disturbance = Disturbance()
    """random forces and torques on the vehicle."""
    drag: tuple[DragCoefficient, DragCoefficient, DragCoefficient] = (0.0, 0.0, 0.0)
    """drag coefficients of the rotors in still air, force over velocity along x, y and z of B [N s/m]."""

    @model_validator(mode="after")
    def _lag_is_integrated(self) -> "World":
        if self.rotors.kind == "first_order" and self.plant == "sampled":
            raise ValueError(".plant: 'sampled': rotors of kind 'first_order' need 'continuous'")
        return self
