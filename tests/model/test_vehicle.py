"""The vehicle's own numbers: what they say together, and what no vehicle can be."""

import math
import re

import numpy as np
import pytest

from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100, Arm, Vehicle, mixing_matrix, rotor_places


def test_at_hover_four_rotors_carry_the_weight() -> None:
    assert M100.hover_thrust == pytest.approx(2.7 * 9.81, rel=1e-3)
    assert set(M100.hover_rotor_speeds) == {math.sqrt(2.7 * 9.81 / (4.0 * M100.rotor_lift))}  # to the last bit


def test_the_m100_is_a_quadrotor_of_its_makers_size_that_can_fly() -> None:
    """DJI's data sheet: 650 mm from motor to motor, at most 3.6 kg, propellers of 13 inches."""
    assert M100.radius == pytest.approx(0.65 / 2.0 + 0.5 * 13.0 * 0.0254, abs=0.01)
    most = 4.0 * M100.rotor_lift * M100.rotor_max_speed**2 / 9.81
    assert 3.6 < most < 6.0
    assert M100.inertia[0] < M100.inertia[1] < M100.inertia[2] < M100.inertia[0] + M100.inertia[1]
    assert 0.0 < M100.rotor_time_constant[0] < M100.rotor_time_constant[1] < 0.1
    assert M100.rotor_drag / M100.rotor_lift == pytest.approx(0.0425, abs=0.005)  # [m]


@pytest.mark.parametrize(("share", "flies"), [(0.999, True), (1.001, False)])
def test_a_vehicle_too_heavy_for_its_rotors_is_refused(share: float, flies: bool) -> None:
    most = 4.0 * M100.rotor_lift * M100.rotor_max_speed**2 / (M100.hover_thrust / M100.mass)
    if flies:
        assert max(Vehicle(mass=share * most).hover_rotor_speeds) < M100.rotor_max_speed
    else:
        with pytest.raises(
            InputError, match=r"mass: 5\.3\d+ kg is more than the rotors lift, 5\.32 kg at rotor_max_speed 838\.0"
        ):
            Vehicle(mass=share * most)


@pytest.mark.parametrize(("mass", "asks"), [(6.0, "; is it in lb?"), (27.0, ""), (2700.0, "; is it in g?")])
def test_a_mass_that_the_rotors_cannot_lift_is_asked_for_its_unit(mass: float, asks: str) -> None:
    with pytest.raises(InputError, match=rf"hover needs [0-9.]+ rad/s{re.escape(asks)}$"):
        Vehicle(mass=mass)


@pytest.mark.parametrize(
    ("wrong", "blamed"),
    [
        ({"rotor_max_speed": 838.0 / math.tau}, r"rotor_max_speed: 133\.4 rad/s: .* is it in rev/s\?"),
        ({"rotor_lift": 1.858582798e-5 * (math.pi / 30.0) ** 2}, r"rotor_lift: 2\.038e-07 .* is it per rpm²\?"),
    ],
)
def test_of_rotors_too_weak_the_number_in_a_wrong_unit_is_blamed(wrong: dict[str, float], blamed: str) -> None:
    with pytest.raises(InputError, match=f"Vehicle: {blamed}$"):
        Vehicle(**wrong)


def test_of_rotors_too_weak_a_number_that_was_left_out_is_named() -> None:
    with pytest.raises(InputError, match=r"mass: 0\.55 kg is more .*; rotor_max_speed is the M100's, is it yours\?$"):
        Vehicle(mass=0.55, inertia=(0.0025, 0.0029, 0.0048), arm_length=0.125, rotor_lift=1.5e-6, rotor_drag=1.7e-8)


def test_of_arms_that_load_one_rotor_far_more_the_arms_are_blamed() -> None:
    """Two rotors 0.35 m behind the centre, two 0.12 m ahead: these carry 0.74 of the weight."""
    arms = tuple(
        Arm(angle=math.radians(at), length=length, spin=spin)
        for at, length, spin in ((45, 0.12, 1), (135, 0.35, -1), (225, 0.35, 1), (315, 0.12, -1))
    )
    ahead = 3.8 * 9.81 * 0.35 / 0.47 / 2.0  # N on each
    speed = math.sqrt(ahead / M100.rotor_lift)
    with pytest.raises(InputError, match=rf"arms: one rotor carries too much: hover needs {speed:.1f} rad/s of it"):
        Vehicle(mass=3.8, arms=arms)


def around(n: int, length: float = 0.3, angle: float = 2.0 * math.pi, spins: tuple[int, ...] = (1, -1)) -> Vehicle:
    """A vehicle of n rotors on an arc that begins ahead."""
    return Vehicle(
        arms=tuple(Arm(angle=angle * i / n, length=length, spin=spins[i % len(spins)]) for i in range(n)),
    )


@pytest.mark.parametrize("n", [4, 6, 8, 10])
def test_rotors_around_the_body_share_its_weight(n: int) -> None:
    speed = math.sqrt(2.7 * 9.81 / (n * M100.rotor_lift))
    np.testing.assert_allclose(around(n).hover_rotor_speeds, speed, rtol=1e-12)
    assert around(n).largest_thrust == pytest.approx(n * M100.rotor_lift * 838.0**2, rel=1e-12)


def test_the_default_is_an_x_of_four_arms() -> None:
    arms = [Arm(angle=math.radians(a), length=0.17, spin=s) for a, s in ((45, 1), (-45, -1), (-135, 1), (135, -1))]
    named = Vehicle(arms=tuple(arms))
    for ours, theirs in zip(rotor_places(M100), rotor_places(named), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-15)
    np.testing.assert_allclose(mixing_matrix(M100), mixing_matrix(named), rtol=1e-15)


def test_of_two_rotors_over_each_other_each_carries_half() -> None:
    pairs = [Arm(angle=math.pi / 2 * i, length=0.3, spin=s) for i in range(4) for s in (1, -1)]
    speed = math.sqrt(2.7 * 9.81 / (8 * M100.rotor_lift))
    np.testing.assert_allclose(Vehicle(arms=tuple(pairs)).hover_rotor_speeds, speed, rtol=1e-12)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: around(3), "at least 4 items"),
        (lambda: around(65), "at most 64 items"),
        (lambda: around(4, spins=(1,)), "arms: 4 rotors of these angles, lengths and spins have rank 3 in thrust"),
        (lambda: around(8, angle=0.0), "arms: 8 rotors .* rank 2 .*: must be 4"),
        (lambda: around(6, angle=math.pi / 2), r"arms.\d: at hover this rotor would not lift: the centre of mass must"),
        (lambda: Arm(angle=45.0, length=0.3, spin=1), r"at most 6\.28"),
        (lambda: Arm(angle=0.0, length=0.3, spin=0), "Arm: spin: 0 is not one of '-1', '1'"),
        (lambda: Vehicle(mass=-1.0), r"^Vehicle: mass: -1\.0: must be above 0$"),
        (lambda: Vehicle(inertia=(0.01, 0.01)), r"^Vehicle: inertia\.2: is missing$"),
        (lambda: around(4, length=0.0), "above 0"),
    ],
)
def test_a_layout_that_cannot_fly_is_refused(make, says: str) -> None:
    with pytest.raises(InputError, match=says):
        make()
