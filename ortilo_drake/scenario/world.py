"""The simulated physics apart from the sensors."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, model_validator

from ortilo_drake.model.typed_yaml import Frozen
from ortilo_drake.model.white_noise import USUAL_ROOT, white_sd

DragCoefficient = Annotated[float, Field(ge=0.0, le=10.0)]


class IdealRotors(Frozen):
    """The control acts on the body at once and without limit, as in the paper's model."""

    kind: Literal["ideal"] = "ideal"


class FirstOrderRotors(Frozen):
    """Mixing to the speeds of the rotors, limits of speed, and a first-order lag with the vehicle's time constants."""

    kind: Literal["first_order"]


class Disturbance(Frozen):
    """Force in W and torque in B, Gaussian and white: drawn every tick h, held over it, of sd density / sqrt(h)."""

    force_density: NonNegativeFloat = 0.27 * USUAL_ROOT
    """of the force per axis [N/sqrt(Hz)]; the default is 0.27 N in a tick of 1/30 s."""
    torque_density: NonNegativeFloat = 0.005 * USUAL_ROOT
    """of the torque per axis [N m/sqrt(Hz)]; the default is 0.005 N m in a tick of 1/30 s."""

    def sds(self, h: float) -> tuple[float, float]:
        """Return the standard deviations of force [N] and torque [N m] in a tick [s]."""
        return white_sd(self.force_density, h), white_sd(self.torque_density, h)


class World(Frozen):
    """The simulated physics apart from the sensors."""

    kinematics: Literal["linear", "small_angle", "rigid_body"] = "small_angle"
    """'small_angle' is the paper's nonlinear model, 'rigid_body' has proper Euler-rate kinematics, 'linear' is the
    paper's linearisation at hover."""
    plant: Literal["sampled", "continuous"] = "sampled"
    """'sampled' steps the vehicle once a tick by the classical Runge-Kutta method, which for held inputs leaves the
    simulator nothing to integrate; 'continuous' has Drake integrate it. Rotors with a lag need the latter. Where a
    sensor is faster than the tick the plant is always integrated, from sample to sample."""
    rotors: Annotated[IdealRotors | FirstOrderRotors, Field(discriminator="kind")] = IdealRotors()
    """between the control and the body."""
    disturbance: Disturbance = Disturbance()
    """random forces and torques on the vehicle."""
    drag: tuple[DragCoefficient, DragCoefficient, DragCoefficient] = (0.0, 0.0, 0.0)
    """of the rotors in still air, force over velocity along x, y and z of B [N s/m]."""

    @model_validator(mode="after")
    def _lag_is_integrated(self) -> "World":
        if self.rotors.kind == "first_order" and self.plant == "sampled":
            raise ValueError(".plant: 'sampled': rotors of kind 'first_order' need 'continuous'")
        return self
