"""The DJI Matrice 100 as the paper's authors flew it."""

import math

from pydantic import NonNegativeFloat, model_validator

from ortilo_drake.model.typed_yaml import Frozen, Positive

GRAVITY = 9.81  # m/s^2


class Vehicle(Frozen):
    """Rigid-body and rotor parameters of a quadrotor in X configuration.

    The defaults are the M100 of the authors' published simulation world and node parameters (repository
    loizoshad/ORTINa); their printed A and B follow from them by exact zero-order-hold discretisation.

    Attributes:
        mass: m [kg].
        inertia: principal moments I_x, I_y, I_z [kg m^2] in B.
        arm_length: distance of each rotor axis from the centre of mass [m].
        rotor_lift: thrust per squared rotor speed [N s^2/rad^2].
        rotor_drag: torque about the rotor axis per squared rotor speed [N m s^2/rad^2].
        rotor_time_constant: first-order lag of a rotor speeding up, slowing down [s].
        rotor_max_speed: largest rotor speed [rad/s].
        radius: horizontal radius of the smallest cylinder around airframe and propellers [m]; ours, from the
            M100's 0.65 m diagonal wheelbase and its 13 inch propellers.
    """

    mass: Positive = 2.7
    inertia: tuple[Positive, Positive, Positive] = (0.1547563, 0.1658929, 0.2077)
    arm_length: Positive = 0.17
    rotor_lift: Positive = 1.858582798e-5
    rotor_drag: Positive = 7.905545266e-7
    rotor_time_constant: tuple[Positive, Positive] = (0.0125, 0.025)
    rotor_max_speed: Positive = 838.0
    radius: NonNegativeFloat = 0.49

    @model_validator(mode="after")
    def _can_hover(self) -> "Vehicle":
        if self.hover_rotor_speed >= self.rotor_max_speed:
            raise ValueError(
                f"rotor_max_speed: {self.rotor_max_speed} cannot lift mass {self.mass}, "
                f"hover needs {self.hover_rotor_speed:.1f} rad/s"
            )
        return self

    @property
    def hover_thrust(self) -> float:
        """Total thrust m g [N] that holds the vehicle still."""
        return self.mass * GRAVITY

    @property
    def hover_rotor_speed(self) -> float:
        """Speed [rad/s] of each rotor at hover."""
        return math.sqrt(self.hover_thrust / (4.0 * self.rotor_lift))


M100 = Vehicle()
