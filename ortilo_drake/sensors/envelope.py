"""Limits of the motion of a scenario's vehicle in its room; the limits of the sensors follow from them.

The largest command gives the largest accelerations. The accelerations and the room give the largest velocities, and
the largest positions and attitudes before the flight counts as lost (flight/lost.py):

    a = f / m + g,  v = sqrt(2 a L),  alpha_i = tau_i / I_i,  w = sqrt(2 alpha 2 pi) + alpha h

with L the room's diagonal: v is the speed after crossing the room, w the rate after a full turn, from rest and with the
largest command. Noise counts with SIGMAS standard deviations.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from ortilo_drake.model.room import Room
from ortilo_drake.model.vehicle import GRAVITY, MAX_TILT, Vehicle, mixing_matrix
from ortilo_drake.scenario import Scenario

ASKED: Final = 8.0  # a servo may command this many times the rotors' largest u, which ideal rotors provide
SIGMAS: Final = 10.0


class Envelope(NamedTuple):
    """The limits of a vehicle's motion."""

    u: np.ndarray
    """largest magnitude of a command [N, N m] (4)."""
    size: float
    """diagonal of the room [m]."""
    force: float
    """largest specific force [m/s^2]."""
    speed: float
    """largest speed [m/s]."""
    rate: float
    """largest body rate [rad/s]."""
    angles: np.ndarray
    """largest magnitudes of roll, pitch and yaw [rad] (3)."""


def largest_command(vehicle: Vehicle) -> np.ndarray:
    """Return the largest magnitude of u (4) that a servo may command [N, N m]."""
    by_rotor = mixing_matrix(vehicle) * vehicle.rotor_max_speed**2
    either_way = [np.maximum(sign * by_rotor, 0.0).sum(axis=1) for sign in (1.0, -1.0)]
    return ASKED * np.maximum(*either_way)


def envelope_of(scenario: Scenario, room: Room) -> Envelope:
    """Return the limits of the motion of the scenario's vehicle in its room."""
    vehicle, h = scenario.vehicle, scenario.h
    size = float(np.linalg.norm(np.array(room.interior.max) - np.array(room.interior.min)))
    u, (force_sd, torque_sd) = largest_command(vehicle), scenario.world.disturbance.sds(h)
    force = (u[0] + SIGMAS * force_sd) / vehicle.mass
    speed = math.sqrt(2.0 * (force + GRAVITY) * size)
    alpha = float(np.max((u[1:] + SIGMAS * torque_sd) / vehicle.inertia))
    rate = math.sqrt(2.0 * alpha * 2.0 * math.pi) + alpha * h
    tilt = MAX_TILT + rate * h
    return Envelope(u, size, force, speed, rate, np.array([tilt, tilt, abs(scenario.yaw) + 2.0 * math.pi + rate * h]))
