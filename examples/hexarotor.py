"""Fly a vehicle of your own: the hexarotor of hexarotor.yaml through the authors' room.

    python examples/hexarotor.py

Scenario `rotors` has what such a vehicle needs: a rigid body under rotors with limits and a lag. The servo's gain and
the filter's model follow from the vehicle's mass and inertia; the weights and the noise stay those of the M100.
"""

from pathlib import Path

import numpy as np

import ortilo_drake as od

VEHICLE = Path(__file__).with_name("hexarotor.yaml")


def fly(**settings: object) -> od.Flight:
    """Return a flight of the hexarotor; settings as those of od.fly."""
    return od.fly("rotors", vehicle=VEHICLE, **settings)


def main(**settings: object) -> None:
    """Fly, and print the verdict and the error."""
    flight = fly(**settings)
    vehicle = flight.scenario.vehicle
    print(f"{vehicle.rotor_count} rotors, at hover {vehicle.hover_rotor_speeds.max():.0f} rad/s each")
    missed = np.linalg.norm(flight.data["truth"].values[-1, :3] - flight.data["reference"].values[-1])
    print(f"lost: {flight.lost['cause']}" if flight.lost else f"arrived, {missed:.2f} m from its goal")
    error = np.sqrt((flight.error**2).sum("axis").mean().item())
    print(f"error of the estimated position, RMS: {error:.3f} m")


if __name__ == "__main__":
    main()
