"""The vehicle's own numbers: what they say together, and what no vehicle can be."""

import pytest
from pydantic import ValidationError

from ortilo_drake.model.vehicle import M100, Vehicle


def test_at_hover_four_rotors_carry_the_weight() -> None:
    assert M100.hover_thrust == pytest.approx(2.7 * 9.81, rel=1e-3)
    assert 4.0 * M100.rotor_lift * M100.hover_rotor_speed**2 == pytest.approx(M100.hover_thrust, rel=1e-12)


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
        assert Vehicle(mass=share * most).hover_rotor_speed < M100.rotor_max_speed
    else:
        with pytest.raises(ValidationError, match=r"rotor_max_speed: 838\.0 cannot lift mass"):
            Vehicle(mass=share * most)
