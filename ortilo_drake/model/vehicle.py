"""The parameters of a multirotor; by default those of the DJI Matrice 100 that the paper's authors flew."""

import math
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, NonNegativeFloat, model_validator

from ortilo_drake.model.input_files import exists
from ortilo_drake.model.typed_yaml import Frozen, InputError, Positive, load_yaml

GRAVITY = 9.81  # m/s^2
MAX_TILT = np.pi / 3  # a vehicle with a larger tilt counts as tumbling [rad]
MAX_ROTORS = 64
STEERABLE = 1e-6  # smallest singular value of a steerable layout of arms, as a share of the largest one
Lag = Annotated[float, Field(ge=1e-4)]  # shorter lags have no effect, and take long to integrate [s]


def _both(lags: Any) -> Any:
    """Refuse one number for both lags, because speeding up and slowing down differ on most vehicles."""
    if isinstance(lags, int | float):
        raise ValueError(f"{lags!r}: must be a list, [speeding up, slowing down] in s")
    return tuple(lags) if isinstance(lags, list) else lags  # pydantic does not convert a validator's list to a tuple


class Arm(Frozen):
    """An arm in the plane through the centre of mass, with a rotor at its end that thrusts along B's z."""

    angle: Annotated[float, Field(ge=-2.0 * math.pi, le=2.0 * math.pi)]
    """angle from B's x axis (ahead), counter-clockwise seen from above [rad]."""
    length: Positive
    """distance of the rotor's axis from the centre of mass [m]."""
    spin: Literal[-1, 1]
    """sign of the rotor's drag torque about B's z: +1 if the rotor turns clockwise seen from above, -1 if
    counter-clockwise."""


class Vehicle(Frozen):
    """Rigid-body and rotor parameters of a multirotor with equal rotors.

    The defaults are the M100's in the authors' published simulation world and node parameters (repository
    loizoshad/ORTINa). The authors' printed A and B follow from them by exact zero-order-hold discretisation.
    """

    mass: Positive = 2.7
    """m [kg]."""
    inertia: tuple[Positive, Positive, Positive] = (0.1547563, 0.1658929, 0.2077)
    """principal moments I_x, I_y, I_z [kg m^2] in B."""
    arm_length: Positive = 0.17
    """distance of each rotor axis from the centre of mass [m], for a quadrotor in X configuration; give either this
    field or `arms`."""
    arms: Annotated[tuple[Arm, ...], Field(min_length=4, max_length=MAX_ROTORS)] | None = None
    """arms of the rotors, at least four; by default the X configuration: front left, front right, rear right, rear
    left, with spin +1, -1, +1, -1."""
    rotor_lift: Positive = 1.858582798e-5
    """thrust per squared rotor speed [N s^2/rad^2]."""
    rotor_drag: Positive = 7.905545266e-7
    """torque about the rotor axis per squared rotor speed [N m s^2/rad^2]."""
    rotor_time_constant: Annotated[tuple[Lag, Lag], BeforeValidator(_both)] = (0.0125, 0.025)
    """first-order lags of a rotor when it speeds up and when it slows down [s]."""
    rotor_max_speed: Positive = 838.0
    """largest rotor speed [rad/s]."""
    radius: NonNegativeFloat = 0.49
    """horizontal radius of the smallest cylinder around airframe and propellers [m]; the default is our estimate from
    the M100's 0.65 m diagonal wheelbase and 13 inch propellers."""

    @model_validator(mode="after")
    def _has_one_layout(self) -> "Vehicle":
        if self.arms is not None and self.arm_length != type(self).model_fields["arm_length"].default:
            raise ValueError(
                f"arm_length: {self.arm_length}: is that of a quadrotor in X configuration: must be left out "
                "where arms are given, each with its own length"
            )
        return self

    @model_validator(mode="after")
    def _can_hover(self) -> "Vehicle":
        rank = np.linalg.matrix_rank(mixing_matrix(self) / _row_units(self), rtol=STEERABLE)
        if rank < 4:
            raise ValueError(
                f"arms: {self.rotor_count} rotors of these angles, lengths and spins have rank {rank} in thrust, roll, "
                "pitch and yaw: must be 4, to make each without the others"
            )
        shares = _hover_shares(self)
        if shares.min() <= 0.0:
            raise ValueError(
                f"arms.{shares.argmin()}: at hover this rotor would not lift: "
                "the centre of mass must lie well between the rotors"
            )
        if self.hover_rotor_speeds.max() >= self.rotor_max_speed:
            from ortilo_drake.model.vehicle_units import vehicle_units  # which imports this module

            speeds = f"hover needs {self.hover_rotor_speeds.max():.1f} rad/s"
            if self.hover_thrust < self.largest_thrust:
                raise ValueError(
                    f"arms: one rotor carries too much: {speeds} of it, rotor_max_speed is {self.rotor_max_speed:g}"
                )
            line, _, question = vehicle_units(self)[0].removeprefix("vehicle.").rpartition("; ")
            asked = f"; {question}" if question.startswith(("is it ", "are they ")) else ""
            if asked and not line.startswith("mass: "):
                raise ValueError(line + asked)
            fields = type(self).model_fields
            kept = [key for key in ("rotor_lift", "rotor_max_speed") if getattr(self, key) == fields[key].default]
            if len(kept) == 1:
                asked = f"; {kept[0]} is the M100's, is it yours?"
            raise ValueError(
                f"mass: {self.mass} kg is more than the rotors lift, {self.largest_thrust / GRAVITY:.3g} kg at "
                f"rotor_max_speed {self.rotor_max_speed}, {speeds}{asked}"
            )
        return self

    @property
    def hover_thrust(self) -> float:
        """Total thrust m g at hover [N]."""
        return self.mass * GRAVITY

    @property
    def rotor_count(self) -> int:
        """The number n of rotors."""
        return 4 if self.arms is None else len(self.arms)

    @property
    def longest_arm(self) -> float:
        """The largest distance of a rotor's axis from the centre of mass [m]."""
        return float(np.hypot(*rotor_places(self)[:2]).max())

    @property
    def largest_thrust(self) -> float:
        """Total thrust of all rotors at full speed [N]."""
        return self.rotor_count * self.rotor_lift * self.rotor_max_speed**2

    @property
    def hover_rotor_speeds(self) -> np.ndarray:
        """Speeds of the rotors at hover (n) [rad/s]."""
        return np.sqrt(_hover_shares(self) * self.hover_thrust / self.rotor_lift)


def rotor_places(vehicle: Vehicle) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return x and y in B [m] and the spin of each rotor (n each)."""
    if vehicle.arms is None:  # closed form, equal to the last bit: cos and sin of 45 degrees round differently
        a = vehicle.arm_length / np.sqrt(2.0)
        return a * np.array([1, 1, -1, -1]), a * np.array([1, -1, -1, 1]), np.array([1, -1, 1, -1])
    angle, length, spin = np.array([(arm.angle, arm.length, arm.spin) for arm in vehicle.arms]).T
    return length * np.cos(angle), length * np.sin(angle), spin


def mixing_matrix(vehicle: Vehicle) -> np.ndarray:
    """Return the mixing matrix M (4 x n) with u = M [W_1^2 ... W_n^2], W_i the rotor speeds [rad/s].

    A rotor at (x, y) with lift k W^2 and drag c W^2 gives the thrust k W^2, the torques r x F = (y, -x) k W^2 about B's
    x and y, and the torque spin c W^2 about B's z.
    """
    k, c, (x, y, spin) = vehicle.rotor_lift, vehicle.rotor_drag, rotor_places(vehicle)
    return np.array([k * np.ones(len(x)), k * y, -k * x, c * spin])


def mixing_inverse(vehicle: Vehicle) -> np.ndarray:
    """Return the pseudoinverse M^+ (n x 4): M^+ u are the squared rotor speeds of least norm that give u."""
    M = mixing_matrix(vehicle)
    if vehicle.arms is None:  # differs from pinv in the last bit, which published flights keep
        return np.linalg.inv(M)
    units = _row_units(vehicle)
    return np.linalg.pinv(M / units) / units.T


def _row_units(vehicle: Vehicle) -> np.ndarray:
    """Return a scale for each row of M (4 x 1), so that the rank of M does not depend on units or size."""
    lift, longest = vehicle.rotor_lift, vehicle.longest_arm
    return np.array([[lift], [lift * longest], [lift * longest], [vehicle.rotor_drag]])


def _hover_shares(vehicle: Vehicle) -> np.ndarray:
    """Return the share of the weight that each rotor carries at hover (n)."""
    shares, n = mixing_inverse(vehicle)[:, 0] * vehicle.rotor_lift, vehicle.rotor_count
    return np.where(np.isclose(shares, 1.0 / n, rtol=1e-12, atol=0.0), 1.0 / n, shares)  # equal up to rounding


M100 = Vehicle()


def load_vehicle(path: Path) -> Vehicle:
    """Return the vehicle of a file with the fields of Vehicle; a field that is left out has the M100's value.

    InputError names file, field, value and the allowed values.
    """
    if not exists(path):
        raise InputError(f"vehicle: {str(path)[:200]!r}: no such vehicle file")
    return load_yaml(Vehicle, path)
