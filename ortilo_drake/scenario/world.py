"""The simulated physics apart from the sensors."""

from typing import Annotated, Literal

from pydantic import Field, NonNegativeFloat, model_validator

from ortilo_drake.model.typed_yaml import Frozen


class IdealRotors(Frozen):
    """The control acts on the body at once and without limit, as in the paper's model.

    Attributes:
        kind: 'ideal'.
    """

    kind: Literal["ideal"] = "ideal"


class FirstOrderRotors(Frozen):
    """Mixing to the speeds of the rotors, limits of speed, and a first-order lag with the vehicle's time constants.

    Attributes:
        kind: 'first_order'.
    """

    kind: Literal["first_order"]


class Disturbance(Frozen):
    """Force in W and torque in B, Gaussian, drawn anew every tick and held over it.

    Attributes:
        force_sd: standard deviation of the force per axis [N].
        torque_sd: standard deviation of the torque per axis [N m].
    """

    force_sd: NonNegativeFloat = 0.27
    torque_sd: NonNegativeFloat = 0.005


class World(Frozen):
    """The simulated physics apart from the sensors.

    Attributes:
        kinematics: 'small_angle' is the paper's nonlinear model, 'rigid_body' has proper Euler-rate kinematics,
            'linear' is the paper's linearisation at hover.
        plant: 'sampled' steps the vehicle once a tick by the classical Runge-Kutta method, which for held inputs leaves
            the simulator nothing to integrate; 'continuous' has Drake integrate it. Rotors with a lag need the latter.
            Where a sensor is faster than the tick the plant is always integrated, from sample to sample.
        rotors: between the control and the body.
        disturbance: what pushes the vehicle about.
    """

    kinematics: Literal["linear", "small_angle", "rigid_body"] = "small_angle"
    plant: Literal["sampled", "continuous"] = "sampled"
    rotors: Annotated[IdealRotors | FirstOrderRotors, Field(discriminator="kind")] = IdealRotors()
    disturbance: Disturbance = Disturbance()

    @model_validator(mode="after")
    def _lag_is_integrated(self) -> "World":
        if self.rotors.kind == "first_order" and self.plant == "sampled":
            raise ValueError(".plant: 'sampled': rotors of kind 'first_order' need 'continuous'")
        return self
