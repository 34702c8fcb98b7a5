"""Vehicles with one number in a wrong unit are named by that number; published vehicles are not doubted."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100, Vehicle, load_vehicle
from ortilo_drake.model.vehicle_units import vehicle_units
from ortilo_drake.scenario import load_scenario, scenario_names
from ortilo_drake.studies.cautions.cautions import cautions

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
POUND = 0.45359237  # kg
WRONG = [  # factors on the numbers that are wrong, the field that is named first, and what it is asked
    ({"rotor_drag": 1e3}, ""),
    ({"rotor_drag": RPM**2}, "is it per rpm²?"),
    ({"rotor_lift": 1e3 / 9.81}, "is it in gram-force?"),
    ({"rotor_lift": RPM**2}, "is it per rpm²?"),
    ({"rotor_lift": RPM**2, "rotor_drag": RPM**2}, "are they per rpm²?"),
    ({"rotor_lift": RPM**2, "rotor_drag": RPM**2, "rotor_max_speed": 1.0 / RPM}, "are they per rpm² and in rpm?"),
    ({"rotor_max_speed": 1.0 / RPM}, "is it in rpm?"),
    ({"rotor_max_speed": 0.5 / np.pi}, "is it in rev/s?"),
    ({"rotor_time_constant": 1e3}, "is it in ms?"),
    ({"mass": 1e3}, "is it in g?"),
    ({"arm_length": 0.1}, ""),
    ({"arm_length": 10.0}, ""),
    ({"arm_length": 100.0}, "is it in cm?"),
    ({"arm_length": 1.0 / 0.0254}, "is it in inches?"),
    ({"arm_length": 1e3}, "is it in mm?"),
    ({"arm_length": 1e3, "radius": 1e3}, "are they in mm?"),
    ({"arm_length": 100.0, "radius": 100.0}, "are they in cm?"),
    ({"radius": 100.0}, "is it in cm?"),
    ({"radius": 1.0 / 0.0254}, "is it in inches?"),
    ({"radius": 1e3}, "is it in mm?"),
    ({"inertia": 0.01}, ""),
    ({"inertia": 1e2}, None),  # some have 1e3 as well within what is usual: moments in g m²
    ({"inertia": 1e3}, "is it in g m²?"),
    ({"inertia": 1e4}, "is it in kg cm²?"),
    ({"inertia": 1e6}, "is it in kg mm²?"),
    ({"inertia": 1e7}, "is it in g cm²?"),
    ({"inertia": 1e9}, "is it in g mm²?"),
]


def times(vehicle: Vehicle, factors: dict[str, float]) -> Vehicle:
    """The vehicle with fields multiplied, each arm's length where it has arms; unchecked, since it may not hover."""
    values: dict[str, Any] = {}
    for name, by in factors.items():
        value = getattr(vehicle, name)
        if name == "arm_length" and vehicle.arms is not None:
            values["arms"] = tuple(arm.model_copy(update={"length": arm.length * by}) for arm in vehicle.arms)
        else:
            values[name] = tuple(by * one for one in value) if isinstance(value, tuple) else by * value
    return vehicle.model_copy(update=values)


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_published_vehicle_is_not_doubted(name: str) -> None:
    assert vehicle_units(PUBLISHED[name]) == []


@pytest.mark.parametrize("name", scenario_names())
def test_no_ready_made_scenario_is_doubted(name: str) -> None:
    assert cautions(load_scenario(name)) == []


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize(("factors", "question"), WRONG, ids=str)
def test_the_number_that_is_wrong_is_named(name: str, factors: dict[str, float], question: str | None) -> None:
    vehicle = times(PUBLISHED[name], factors)
    (line,) = vehicle_units(vehicle)
    field = next(iter(factors))
    named = "arms" if field == "arm_length" and vehicle.arms is not None else field
    assert line.startswith(f"vehicle.{named}: ")
    assert "usual is" in line
    if question is None:
        return
    verb, _, mistake = question.rstrip("?").partition(" in ")
    assert line.endswith("?") == bool(question)
    assert verb in line.split("; ")[-1]
    assert (f" in {mistake}" if mistake else verb) in line.split("; ")[-1]  # lengths may be in cm or in inches alike


@pytest.mark.parametrize("name", PUBLISHED)
def test_the_wrong_quantity_is_asked_for(name: str) -> None:
    """The torque as a ratio to the thrust; the thrust itself; moments whose smallest is I_z, which no flat body has."""
    right = PUBLISHED[name]
    ratio = right.model_copy(update={"rotor_drag": right.rotor_drag / right.rotor_lift})
    assert [line.split("; ")[-1] for line in vehicle_units(ratio)] == ["is it the ratio of torque to thrust, in m?"]
    newton = right.model_copy(update={"rotor_lift": right.rotor_lift * right.rotor_max_speed**2})
    assert [line.split("; ")[-1] for line in vehicle_units(newton)] == ["is it the thrust at full speed, in N?"]
    I_x, I_y, I_z = right.inertia
    turned = right.model_copy(update={"inertia": (I_z, I_y, I_x)})
    asked = ["is it in another order than I_x, I_y, I_z?"]
    assert [line.split("; ")[-1] for line in vehicle_units(turned)] == ([] if I_x > 0.75 * I_z else asked)


@pytest.mark.parametrize("name", sorted(PUBLISHED.keys() - {"M100", "yours", "Firefly"}))
def test_a_diameter_and_a_wheelbase_are_asked_for(name: str) -> None:
    """Of the M100's published arm, 0.35 of its radius, the double is likely; the Firefly's is 0.68 of it."""
    (wide,), (long,) = (vehicle_units(times(PUBLISHED[name], {key: 2.0})) for key in ("radius", "arm_length"))
    assert wide.endswith("; is it the diameter?")
    assert long.endswith("; is it the whole wheelbase, or radius that of the frame without propellers?")


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_mass_in_pounds_is_asked_for_where_the_rotors_cannot_lift_it(name: str) -> None:
    vehicle = times(PUBLISHED[name], {"mass": 1.0 / POUND})
    heavy = vehicle.largest_thrust < 1.2 * vehicle.hover_thrust
    assert [line.split("; ")[-1] for line in vehicle_units(vehicle)] == ["is it in lb?"] * heavy


def test_two_wrong_numbers_are_named_in_a_line_each() -> None:
    vehicle = times(PUBLISHED["yours"], {"rotor_drag": 1e3, "inertia": 0.01})
    assert sorted(line.split(":")[0] for line in vehicle_units(vehicle)) == ["vehicle.inertia", "vehicle.rotor_drag"]


@pytest.mark.parametrize("name", PUBLISHED)
def test_lift_and_drag_are_asked_for_if_swapped(name: str) -> None:
    vehicle = PUBLISHED[name]
    swapped = {"rotor_lift": vehicle.rotor_drag, "rotor_drag": vehicle.rotor_lift}
    (line,) = vehicle_units(vehicle.model_copy(update=swapped))
    assert line.startswith("vehicle.rotor_lift: ")
    assert ", rotor_drag: " in line
    assert line.endswith("; are they swapped?")


def test_of_one_number_for_both_lags_it_is_said_which_two_they_are() -> None:
    with pytest.raises(
        InputError, match=r"rotor_time_constant: 0\.05: must be a list, \[speeding up, slowing down\] in s"
    ):
        Vehicle(rotor_time_constant=0.05)  # type: ignore[arg-type]


def test_what_was_left_out_is_named_as_the_m100s() -> None:
    small = PUBLISHED["Crazyflie"].model_dump(exclude={"inertia", "radius", "arms"})
    inertia, radius = vehicle_units(Vehicle(**small))
    assert inertia.startswith("vehicle.inertia: 0.1548, 0.1659, 0.2077 kg m²: ")
    assert inertia.endswith("it is the M100's, is it yours?")
    assert radius.startswith("vehicle: the arm is 0.0878 of the radius")
    assert radius.endswith("The M100's are: inertia, rotor_time_constant, radius")


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
