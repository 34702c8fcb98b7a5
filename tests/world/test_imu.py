"""The IMU: rest, Drake's own sensors and body rates, Newton's law, and the noise's statistics."""

from typing import Any

import numpy as np
import pytest
from drake_box import PlayedBox
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.geometry import Box, HalfSpace
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, CoulombFriction, ExternallyAppliedSpatialForce
from pydrake.multibody.tree import SpatialInertia, UnitInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import Accelerometer, Gyroscope
from scipy import stats
from scipy.signal import welch

from ortilo_drake.diagrams.imu import make_imu
from ortilo_drake.model.vehicle import GRAVITY, M100
from ortilo_drake.model.white_noise import USUAL_PERIOD, USUAL_ROOT, white_sd, white_variances
from ortilo_drake.onboard.estimator.filter_model import process_noise
from ortilo_drake.scenario import Disturbance, Imu, load_scenario
from ortilo_drake.scenario import Imu as Settings
from ortilo_drake.world.sensors.imu import imu_box
from ortilo_drake.world.vehicle.disturbance import disturbance_box
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_

H = 1.0 / 30.0
ONE_SECOND = 30
ROOT = np.sqrt(H)


def imu(settings: Settings, seed: int = 0) -> PlayedBox:
    inputs = {"sent": np.zeros(1), "state": np.zeros(12), "acceleration": np.zeros(3)}
    return PlayedBox(imu_box(settings, H, whole=True), H, seed, **inputs)


NO_NOISE = Settings(angle_density=0.0, rate_density=0.0, specific_force_density=0.0)
EXACT = imu(NO_NOISE)


def exact(x: np.ndarray, v_dot: np.ndarray) -> np.ndarray:
    return EXACT.say(ONE_SECOND, state=x, acceleration=v_dot)


@pytest.mark.parametrize("yaw", [0.0, 0.4, -2.0])
def test_at_rest_it_feels_gravity_upwards_and_no_rotation(yaw: float) -> None:
    x = np.zeros(12)
    x[5] = yaw
    expected = [1.0, 1.0, 0.0, 0.0, yaw, 0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY]
    np.testing.assert_allclose(exact(x, np.zeros(3)), expected, atol=1e-14)


def test_in_free_fall_it_feels_nothing() -> None:
    np.testing.assert_array_equal(exact(np.zeros(12), np.array([0.0, 0.0, -GRAVITY]))[8:], np.zeros(3))


@pytest.mark.long
@given(
    arrays(float, 12, elements=st.floats(-1.2, 1.2)),
    arrays(float, 4, elements=st.floats(-40.0, 40.0)),
    arrays(float, 6, elements=st.floats(-3.0, 3.0)),
)
def test_in_flight_it_measures_rates_by_drake_and_newtons_force_over_mass(
    x: np.ndarray, u: np.ndarray, d: np.ndarray
) -> None:
    plant = QuadrotorPlant_[float](M100, "rigid_body")
    context = plant.CreateDefaultContext()
    plant.SetState(context, x)
    plant.GetInputPort("control").FixValue(context, u)
    plant.GetInputPort("disturbance").FixValue(context, d)
    message = exact(x, plant.GetOutputPort("acceleration").Eval(context))
    attitude = RollPitchYaw(x[3:6])
    np.testing.assert_array_equal(message[2:5], x[3:6])
    np.testing.assert_allclose(message[5:8], attitude.CalcAngularVelocityInChildFromRpyDt(x[9:12]), atol=1e-13)
    f_B = ([0.0, 0.0, u[0]] + attitude.ToRotationMatrix().matrix().T @ d[:3]) / M100.mass
    np.testing.assert_allclose(message[8:11], f_B, atol=1e-12)


def a_body_with_drakes_sensors(time_step: float, floor: bool) -> tuple[Any, Any, Any, Any]:
    """Return a Diagram of a free body, a box, with Drake's accelerometer and gyroscope; its plant, and the two."""
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -GRAVITY])
    inertia = UnitInertia(*(np.array(M100.inertia) / M100.mass))
    body = plant.AddRigidBody("body", SpatialInertia(M100.mass, np.zeros(3), inertia))
    if floor:
        friction = CoulombFriction(0.9, 0.8)
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "floor", friction)
        plant.RegisterCollisionGeometry(body, RigidTransform(), Box(0.6, 0.6, 0.2), "feet", friction)
    plant.Finalize()
    sensors = []
    for Sensor in (Accelerometer, Gyroscope):
        given_too = [plant.gravity_field().gravity_vector()] if Sensor is Accelerometer else []
        sensor = builder.AddSystem(Sensor(body, RigidTransform(), *given_too))
        builder.Connect(plant.get_body_poses_output_port(), sensor.get_body_poses_input_port())
        builder.Connect(plant.get_body_spatial_velocities_output_port(), sensor.get_body_velocities_input_port())
        if Sensor is Accelerometer:
            builder.Connect(
                plant.get_body_spatial_accelerations_output_port(), sensor.get_body_accelerations_input_port()
            )
        sensors.append(sensor)
    return builder.Build(), plant, *sensors


def said_beside_drakes(diagram: Any, plant: Any, accelerometer: Any, gyroscope: Any, context: Any) -> tuple[Any, Any]:
    """Return w_WB_B and f_B by an IMU that is given the body's motion, and by Drake's sensors."""
    body, its = plant.GetBodyByName("body"), plant.GetMyContextFromRoot(context)
    X_WB, V_WB = plant.EvalBodyPoseInWorld(its, body), plant.EvalBodySpatialVelocityInWorld(its, body)
    attitude = RollPitchYaw(X_WB.rotation())
    rates = attitude.CalcRpyDtFromAngularVelocityInParent(V_WB.rotational())
    x = np.concatenate([X_WB.translation(), attitude.vector(), V_WB.translational(), rates])
    v_dot = plant.get_body_spatial_accelerations_output_port().Eval(its)[int(body.index())].translational()
    imu = make_imu(NO_NOISE)
    own = imu.CreateDefaultContext()
    imu.GetInputPort("state").FixValue(own, x)
    imu.GetInputPort("acceleration").FixValue(own, v_dot)
    drakes = [its.get_output_port().Eval(its.GetMyContextFromRoot(context)) for its in (gyroscope, accelerometer)]
    return imu.get_output_port().Eval(own)[5:], np.concatenate(drakes)


def test_a_body_that_is_pushed_and_turns_is_measured_as_by_drakes_sensors() -> None:
    diagram, plant, *sensors = a_body_with_drakes_sensors(time_step=0.0, floor=False)
    rng = np.random.default_rng(4)
    for _ in range(10):
        context = diagram.CreateDefaultContext()
        its, body = plant.GetMyMutableContextFromRoot(context), plant.GetBodyByName("body")
        attitude = RollPitchYaw(rng.uniform(-1.2, 1.2, 3)).ToRotationMatrix()
        plant.SetFloatingBaseBodyPoseInWorldFrame(its, body, RigidTransform(attitude, rng.normal(size=3)))
        plant.SetVelocities(its, rng.normal(size=6))
        push = ExternallyAppliedSpatialForce()
        push.body_index, push.F_Bq_W = body.index(), SpatialForce(rng.normal(size=3), 20.0 * rng.normal(size=3))
        plant.get_applied_spatial_force_input_port().FixValue(its, [push])
        np.testing.assert_allclose(*said_beside_drakes(diagram, plant, *sensors, context), rtol=0.0, atol=1e-12)


def test_on_the_floor_with_its_rotors_off_it_feels_the_floor_as_drakes_accelerometer_does() -> None:
    diagram, plant, *sensors = a_body_with_drakes_sensors(time_step=0.001, floor=True)
    simulator = Simulator(diagram)
    its, body = plant.GetMyMutableContextFromRoot(simulator.get_mutable_context()), plant.GetBodyByName("body")
    plant.SetFloatingBaseBodyPoseInWorldFrame(its, body, RigidTransform([0.3, 0.2, 0.11]))
    simulator.AdvanceTo(2.0)
    said, drakes = said_beside_drakes(diagram, plant, *sensors, simulator.get_context())
    np.testing.assert_allclose(said, drakes, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(said, [0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY], rtol=0.0, atol=1e-3)


@pytest.mark.long
def test_noise_is_white_gaussian_of_the_given_deviations() -> None:
    n = 6000
    settings = Settings(angle_density=0.01 * ROOT, rate_density=0.02 * ROOT, specific_force_density=0.05 * ROOT)
    noisy, noise = imu(settings, seed=7), np.empty((n, 9))
    for k in range(n):
        message = noisy.say(k)
        assert message[0] == 1.0
        assert message[1] == k * H
        noise[k] = message[2:]
    noise[:, 8] -= GRAVITY
    unit = noise / np.repeat([0.01, 0.02, 0.05], 3)
    for axis in unit.T:
        assert stats.kstest(axis, "norm").pvalue > 1e-3
    # Neither correlated between outputs nor from tick to tick (5 standard errors).
    assert np.max(np.abs(np.corrcoef(unit.T) - np.eye(9))) < 5 / np.sqrt(n)
    assert np.max(np.abs(unit[1:].T @ unit[:-1] / n)) < 5 / np.sqrt(n)


def test_noise_belongs_to_the_seed() -> None:
    messages = [
        imu(Settings(angle_density=1.0, rate_density=1.0, specific_force_density=1.0), seed).say(60)
        for seed in (1, 1, 2)
    ]
    np.testing.assert_array_equal(messages[0], messages[1])
    assert np.all(messages[0][2:] != messages[2][2:])


RATES = (20.0, 30.0, 120.0)
DURATION, SEGMENT = 240.0, 4.0  # s
DISTURBANCE, IMU = Disturbance(), Imu()
DENSITIES = np.repeat([DISTURBANCE.force_density, DISTURBANCE.torque_density], 3)
IMU_DENSITIES = np.repeat([IMU.angle_density, IMU.rate_density, IMU.specific_force_density], 3)


def disturbance_at(rate: float) -> np.ndarray:
    """Return what pushes the vehicle in each tick, of densities of 1 (n, 6)."""
    box = PlayedBox(disturbance_box(DISTURBANCE, 1.0 / rate), 1.0 / rate, seed=5)
    return np.array([box.say(k) for k in range(int(DURATION * rate))]) / DENSITIES


def imu_noise_at(rate: float) -> np.ndarray:
    """Return the noise of an imu at rest in each tick, of densities of 1 (n, 9)."""
    inputs = {"sent": np.zeros(1), "state": np.zeros(12), "acceleration": np.array([0.0, 0.0, -9.81])}
    box = PlayedBox(imu_box(IMU, 1.0 / rate, whole=True), 1.0 / rate, 5, **inputs)
    return np.array([box.say(k)[2:] for k in range(int(DURATION * rate))]) / IMU_DENSITIES


@pytest.mark.family
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("noise_at", [disturbance_at, imu_noise_at])
def test_the_two_sided_spectrum_is_the_density_squared_at_every_control_rate(noise_at: object, rate: float) -> None:
    noise = noise_at(rate)  # type: ignore[operator]
    found, spectrum = welch(noise, rate, "boxcar", int(SEGMENT * rate), 0, detrend=False, return_onesided=False, axis=0)
    below = (found > 0.0) & (found < 9.0)  # what all rates can show
    assert below.sum() == 35
    # Segments that do not overlap are independent, and so are their frequencies: a mean of chi-squares of 2 degrees.
    averaged = below.sum() * DURATION / SEGMENT
    low, high = stats.chi2.ppf([1e-5, 1.0 - 1e-5], 2 * averaged) / (2 * averaged)
    mean = spectrum[below].mean(axis=0)
    assert ((low < mean) & (mean < high)).all(), mean


@pytest.mark.family
@pytest.mark.parametrize("rate", RATES)
def test_the_momentum_given_in_a_tenth_of_a_second_is_as_large_at_every_control_rate(rate: float) -> None:
    """Means over T have the variance D^2 / T."""
    per = round(rate * 0.1)
    means = disturbance_at(rate).reshape(-1, per, 6).mean(axis=1)
    n = means.size
    low, high = stats.chi2.ppf([1e-5, 1.0 - 1e-5], n)
    assert low < (means**2).sum() * 0.1 < high


@pytest.mark.parametrize("rate", RATES)
def test_the_filter_believes_in_the_same_white_force_at_every_control_rate(rate: float) -> None:
    """A force of density D held over each tick h gives v_z the variance D^2 h / m^2 a tick, the same a second."""
    scenario = load_scenario("nominal_imu_uwb", (f"control_rate={rate}",))
    W, h = process_noise(scenario.estimator, scenario.vehicle, scenario.h), scenario.h
    expected = (scenario.world.disturbance.force_density / scenario.vehicle.mass) ** 2
    np.testing.assert_allclose(W[8, 8] / h, expected, rtol=1e-12)
    expected = (scenario.world.disturbance.torque_density / np.array(scenario.vehicle.inertia)) ** 2
    np.testing.assert_allclose(np.diag(W)[9:12] / h, expected, rtol=1e-12)


def test_a_diagonal_process_noise_and_the_noise_of_measurements_follow_the_tick() -> None:
    h, twice = (load_scenario("paper_imu_uwb", (f"control_rate={rate}",)) for rate in (30.0, 60.0))
    np.testing.assert_allclose(
        process_noise(twice.estimator, twice.vehicle, twice.h), process_noise(h.estimator, h.vehicle, h.h) / 2.0
    )
    np.testing.assert_allclose(white_variances((1.0, 2.0), USUAL_PERIOD / 4.0), [4.0, 8.0])


@pytest.mark.parametrize("sd", [0.27, 0.005, 0.01, 0.001, 0.05])
def test_at_30_hz_the_usual_densities_are_the_usual_deviations_to_the_last_bit(sd: float) -> None:
    assert white_sd(sd * USUAL_ROOT, 1.0 / 30.0) == sd
