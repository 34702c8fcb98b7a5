"""Rotors: mixing from the rotors' places, limits, and the lag's closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.vehicle import M100, Arm, Vehicle, mixing_inverse, mixing_matrix
from ortilo_drake.scenario import load_scenario
from ortilo_drake.world.vehicle.rotors import Rotors_, commanded_speeds, rotor_acceleration, wrench_of

M = mixing_matrix(M100)
M_INVERSE = mixing_inverse(M100)


@st.composite
def layouts(draw: st.DrawFn) -> Vehicle:
    """Four to eight rotors around the body, unevenly placed, next ones turning opposite ways."""
    n, off = draw(st.integers(4, 8)), draw(st.floats(-np.pi, 0.0))
    angles = [off + 2 * np.pi * i / n + draw(st.floats(-0.2, 0.2)) for i in range(n)]
    lengths = [draw(st.floats(0.2, 0.3)) for _ in range(n)]
    arms = [Arm(angle=a, length=r, spin=(-1) ** i) for i, (a, r) in enumerate(zip(angles, lengths, strict=True))]
    return Vehicle(mass=draw(st.floats(0.5, 2.5)), arms=tuple(arms))


def wrench_by_cross_products(vehicle: Vehicle, speeds: np.ndarray) -> np.ndarray:
    """The sum of the rotors' forces, of r x F, and of the torques of their drags."""
    found = np.zeros(4)
    for arm, speed in zip(vehicle.arms, speeds, strict=True):
        place = arm.length * np.exp(1j * arm.angle)
        F = np.array([0.0, 0.0, vehicle.rotor_lift * speed**2])
        torque = np.cross([place.real, place.imag, 0.0], F) + [0.0, 0.0, arm.spin * vehicle.rotor_drag * speed**2]
        found += [F[2], *torque]
    return found


@given(layouts(), st.randoms(use_true_random=False))
def test_rotors_of_any_layout_make_the_wrench_of_their_forces_and_drags(vehicle: Vehicle, random) -> None:
    speeds = np.array([random.uniform(0.0, 838.0) for _ in vehicle.arms])
    expected = wrench_by_cross_products(vehicle, speeds)
    np.testing.assert_allclose(wrench_of(speeds, mixing_matrix(vehicle)), expected, rtol=1e-12, atol=1e-12)


@given(layouts(), arrays(float, 4, elements=st.floats(-20.0, 20.0)))
def test_mixing_of_any_layout_makes_each_wrench_with_the_least_squared_speeds(vehicle: Vehicle, u: np.ndarray) -> None:
    M, M_inverse = mixing_matrix(vehicle), mixing_inverse(vehicle)
    np.testing.assert_allclose(M @ M_inverse, np.eye(4), rtol=0.0, atol=1e-10)
    units = np.array([1e-5, 1e-6, 1e-6, 1e-6])  # about M's own, without which least squares lose digits
    least, *_ = np.linalg.lstsq(M / units[:, np.newaxis], u / units)
    np.testing.assert_allclose(M_inverse @ u, least, rtol=1e-9, atol=1e-9 * np.abs(least).max())


@given(layouts())
def test_any_layout_hovers_at_rest(vehicle: Vehicle) -> None:
    rotors, hover = Rotors_[float](vehicle), np.array([vehicle.hover_thrust, 0.0, 0.0, 0.0])
    context = rotors.CreateDefaultContext()
    speeds = context.get_continuous_state_vector().CopyToVector()
    np.testing.assert_allclose(wrench_by_cross_products(vehicle, speeds), hover, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(rotors.get_output_port().Eval(context), hover, rtol=0.0, atol=1e-11)
    rotors.get_input_port().FixValue(context, hover)
    np.testing.assert_allclose(rotors.EvalTimeDerivatives(context).CopyToVector(), 0.0, atol=1e-7)


def test_a_vehicle_with_another_number_of_rotors_cannot_be_set() -> None:
    rotors = Rotors_[float](M100)
    octo = Vehicle(arms=tuple(Arm(angle=np.pi / 4 * i, length=0.3, spin=(-1) ** i) for i in range(8)))
    with pytest.raises(ValueError, match="arms: 8 rotors: this world has 4"):
        rotors.SetVehicle(rotors.CreateDefaultContext(), octo)


@given(arrays(float, 4, elements=st.floats(1.0, 800.0)))
def test_mixing_is_undone_by_its_inverse(speeds: np.ndarray) -> None:
    back = commanded_speeds(wrench_of(speeds, M), M_INVERSE, M100.rotor_max_speed)
    np.testing.assert_allclose(back, speeds, rtol=1e-7, atol=1e-4)


@given(arrays(float, 4, elements=st.floats(-500.0, 500.0)))
def test_commands_stay_within_the_rotors_limits(u: np.ndarray) -> None:
    speeds = commanded_speeds(u, M_INVERSE, M100.rotor_max_speed)
    squared = M_INVERSE @ u
    np.testing.assert_allclose(speeds, np.sqrt(np.clip(squared, 0.0, 838.0**2)), rtol=1e-12, atol=1e-6)


def test_largest_thrust_is_that_of_all_rotors_at_full_speed() -> None:
    speeds = commanded_speeds(np.array([1e4, 0.0, 0.0, 0.0]), M_INVERSE, M100.rotor_max_speed)
    largest = 4 * 1.858582798e-5 * 838.0**2
    np.testing.assert_allclose(wrench_of(speeds, M), [largest, 0.0, 0.0, 0.0], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("thrust", "tau"), [(40.0, 0.0125), (10.0, 0.025)], ids=["faster", "slower"])
def test_lag_is_the_exponential_of_its_own_direction(thrust: float, tau: float) -> None:
    rotors = Rotors_[float](M100)
    simulator = Simulator(rotors)
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme="runge_kutta5", accuracy=1e-10, max_step_size=0.01), simulator
    )
    rotors.get_input_port().FixValue(simulator.get_mutable_context(), [thrust, 0.0, 0.0, 0.0])
    first, last = M100.hover_rotor_speeds[0], np.sqrt(thrust / (4 * M100.rotor_lift))
    for t in (0.005, 0.0125, 0.03, 0.1):
        simulator.AdvanceTo(t)
        speeds = simulator.get_context().get_continuous_state_vector().CopyToVector()
        np.testing.assert_allclose(speeds, last + (first - last) * np.exp(-t / tau), rtol=1e-8)


def test_each_rotor_lags_in_its_own_direction() -> None:
    acceleration = rotor_acceleration(
        np.full(4, 500.0), np.array([600.0, 400.0, 500.0, 501.0]), np.array([0.0125, 0.025])
    )
    np.testing.assert_allclose(acceleration, [100.0 / 0.0125, -100.0 / 0.025, 0.0, 1.0 / 0.0125])


@pytest.mark.parametrize("tau", [1e-3, 1e-4])
def test_rotors_far_faster_than_a_tick_fly_as_rotors_without_lag(tau: float) -> None:
    settings = ("planner={kind: hover, point: [8, 1, 1.5], duration: 2.0}", "world.plant=continuous")
    ideal = fly(load_scenario("nominal_imu_uwb", settings))
    lag = ("world.rotors={kind: first_order}", f"vehicle.rotor_time_constant=[{tau}, {tau}]")
    fast = fly(load_scenario("nominal_imu_uwb", (*settings, *lag)))
    assert fast.attrs["lost"] == "null"
    np.testing.assert_allclose(fast["truth"].values[:, :3], ideal["truth"].values[:, :3], atol=20.0 * tau)
