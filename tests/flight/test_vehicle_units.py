"""Vehicles with one number in a wrong unit are named by that number; published vehicles are not doubted."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ortilo_drake.flight.cautions import cautions
from ortilo_drake.flight.vehicle_units import vehicle_units
from ortilo_drake.model.vehicle import M100, Vehicle, load_vehicle
from ortilo_drake.scenario import load_scenario, scenario_names

RPM = np.pi / 30.0
PUBLISHED = {
    "M100": M100,
    # RotorPy, rotorpy/vehicles/crazyflie_params.py and hummingbird_params.py; radius: an arm and a rotor's radius
    "Crazyflie": Vehicle(
        mass=0.03, inertia=(1.43e-5, 1.43e-5, 2.89e-5), arm_length=0.043, rotor_lift=2.3e-8, rotor_drag=7.8e-10,
        rotor_max_speed=2500.0, radius=0.066,
    ),
    "Hummingbird": Vehicle(
        mass=0.5, inertia=(3.65e-3, 3.68e-3, 7.03e-3), arm_length=0.17, rotor_lift=5.57e-6, rotor_drag=1.36e-7,
        rotor_max_speed=1500.0, radius=0.27,
    ),
    # RotorS, rotors_description/urdf/pelican.xacro, ardrone.xacro: body and four rotors
    "Pelican": Vehicle(
        mass=1.04, inertia=(0.01, 0.01, 0.02), arm_length=0.21, rotor_lift=9.9865e-6, rotor_drag=0.016 * 9.9865e-6,
        radius=0.338,
    ),
    "ARDrone": Vehicle(
        mass=1.52, inertia=(0.0347563, 0.0458929, 0.0977), arm_length=0.18, rotor_lift=8.54858e-6,
        rotor_drag=0.016 * 8.54858e-6, radius=0.28,
    ),
    "Firefly": load_vehicle(Path("examples/hexarotor.yaml")),
    # gym-pybullet-drones, assets/cf2x.urdf, whose kf and km are per rpm squared, at 2.25 times the weight
    "cf2x": Vehicle(
        mass=0.027, inertia=(1.4e-5, 1.4e-5, 2.17e-5), arm_length=0.0397, rotor_lift=3.16e-10 / RPM**2,
        rotor_drag=7.94e-12 / RPM**2, rotor_max_speed=21714.0 * RPM, radius=0.06,
    ),
    "yours": Vehicle(mass=1.2, inertia=(0.012, 0.013, 0.022), arm_length=0.17),  # of the guide; the rest is the M100's
}  # fmt: skip
WRONG = [  # field, factors on it and what goes with it, the unit that is asked for
    ("rotor_drag", {"rotor_drag": 1e3}, ""),
    ("rotor_drag", {"rotor_drag": 1.0 / 500.0}, ""),
    ("rotor_lift", {"rotor_lift": 100.0}, ""),
    ("rotor_max_speed", {"rotor_max_speed": 1.0 / RPM}, "rpm"),
    ("arm_length", {"arm_length": 0.1}, ""),
    ("arm_length", {"arm_length": 10.0}, ""),
    ("arm_length", {"arm_length": 1e3}, "mm"),
    ("inertia", {"inertia": 0.01}, ""),
    ("inertia", {"inertia": 100.0}, ""),
    ("inertia", {"inertia": 1e3}, ""),  # in g m²
    ("inertia", {"inertia": 1e7}, ""),  # in g cm²
    ("radius", {"radius": 1e3}, "mm"),
    ("rotor_lift", {"rotor_lift": RPM**2, "rotor_drag": RPM**2, "rotor_max_speed": 1.0 / RPM}, "N/rpm²"),
]


def times(vehicle: Vehicle, factors: dict[str, float]) -> Vehicle:
    """The vehicle with fields multiplied, each arm's length where it has arms."""
    values: dict[str, Any] = vehicle.model_dump(exclude_unset=True)
    for name, by in factors.items():
        if name == "arm_length" and vehicle.arms is not None:
            values["arms"] = tuple(arm.model_copy(update={"length": arm.length * by}) for arm in vehicle.arms)
        elif name == "inertia":
            values["inertia"] = tuple(moment * by for moment in vehicle.inertia)
        else:
            values[name] = getattr(vehicle, name) * by
    return Vehicle(**values)


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_published_vehicle_is_not_doubted(name: str) -> None:
    assert vehicle_units(PUBLISHED[name]) == []


@pytest.mark.parametrize("name", scenario_names())
def test_no_ready_made_scenario_is_doubted(name: str) -> None:
    assert cautions(load_scenario(name)) == []


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize(("field", "factors", "unit"), WRONG, ids=lambda one: str(one))
def test_the_number_that_is_wrong_is_named(name: str, field: str, factors: dict[str, float], unit: str) -> None:
    vehicle = times(PUBLISHED[name], factors)
    (line,) = vehicle_units(vehicle)
    named = "arms" if field == "arm_length" and vehicle.arms is not None else field
    assert line.startswith(f"vehicle.{named}: ")
    assert "usual is" in line
    if field != "inertia":  # of a moment that is far too large, three units are likely
        assert line.endswith(f"; is it in {unit}?") if unit else "is it in" not in line
    elif factors[field] > 1e6:
        assert line.endswith("; is it in g m², kg cm² or g cm²?")


def test_two_wrong_numbers_are_named_in_a_line_each() -> None:
    vehicle = times(PUBLISHED["yours"], {"rotor_drag": 1e3, "inertia": 0.01})
    assert sorted(line.split(":")[0] for line in vehicle_units(vehicle)) == ["vehicle.inertia", "vehicle.rotor_drag"]


def test_what_was_left_out_is_named_as_the_m100s() -> None:
    small = PUBLISHED["Crazyflie"].model_dump(exclude={"inertia", "radius", "arms"})
    inertia, radius = vehicle_units(Vehicle(**small))
    assert inertia.startswith("vehicle.inertia: 0.1548, 0.1659, 0.2077 kg m²: ")
    assert inertia.endswith("it is the M100's, is it yours?")
    assert radius.startswith("vehicle: the arm is 0.088 of the radius")
    assert radius.endswith("The M100's are: inertia, radius")


@pytest.mark.parametrize(("mass", "doubted"), [(4.4, False), (4.5, True)])
def test_rotors_that_lift_hardly_more_than_the_weight_are_told(mass: float, doubted: bool) -> None:
    """The M100's rotors lift 5.32 kg: 1.2 times 4.43 kg."""
    assert [line.split(":")[0] for line in vehicle_units(Vehicle(mass=mass))] == ["vehicle.mass"] * doubted


def test_a_thin_ring_has_the_largest_moment_within_its_radius() -> None:
    """I_z of a ring is m r²: the bound itself, which is not doubted."""
    assert vehicle_units(Vehicle(mass=2.0, inertia=(0.25, 0.25, 0.5), arm_length=0.5, radius=0.5)) == []


def test_of_a_wrong_inertia_neither_rotors_nor_weights_are_blamed() -> None:
    (line,) = cautions(load_scenario("rotors", ("vehicle.inertia=[1.2e-4, 1.3e-4, 2.2e-4]", "vehicle.mass=1.2")))
    assert line.startswith("vehicle.inertia: 0.00012, 0.00013, 0.00022 kg m²: ")
