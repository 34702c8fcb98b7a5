"""Vehicles that disturbance, belief or gain do not fit: told before the flight, with settings under which they fly."""

import re

import numpy as np
import pytest

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.hover import discretize, hover_A, hover_B, hover_B_d
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import load_scenario, scenario_names
from ortilo_drake.studies.cautions.cautions import stationary, vehicle_fit

SMALL = (  # a quadrotor of 30 g with arms of 4 cm
    "vehicle={mass: 0.03, inertia: [1.5e-5, 1.5e-5, 2.0e-5], arm_length: 0.04, rotor_lift: 2.3e-8, rotor_drag: 7.8e-10,"
    " rotor_time_constant: [0.03, 0.03], rotor_max_speed: 2500.0, radius: 0.07}"
)
SHORT = ("planner={kind: waypoints, points: [[0, 0, 1.5], [0.6, 0, 1.5]]}", "camera.kind=projected")
HEXAROTOR = "vehicle=examples/hexarotor.yaml"
SLUGGISH = "vehicle.rotor_time_constant=[0.1, 0.1]"


def mends(lines: list[str]) -> tuple[str, ...]:
    return tuple(mend for line in lines for mend in re.findall(r"--set ([^ ]+=(?:\[[^\]]*\]|[^ ]+))", line))


@pytest.mark.parametrize("vehicle", [(), (HEXAROTOR,)], ids=["m100", "hexarotor"])
@pytest.mark.parametrize("name", scenario_names())
def test_the_vehicles_that_come_with_us_fit_every_scenario(name: str, vehicle: tuple[str, ...]) -> None:
    assert vehicle_fit(load_scenario(name, vehicle)) == []


@pytest.mark.family
@pytest.mark.parametrize(
    ("name", "misfit", "fields"),
    [
        ("rotors", (SMALL,), ["world.disturbance", "estimator.W"]),
        ("tight_imu_uwb", (SMALL,), ["world.disturbance"]),
        ("nominal_imu_uwb", ("world.disturbance.force_density=2.19",), ["world.disturbance"]),
        ("rotors", (SLUGGISH,), ["vehicle.rotor_time_constant"]),
    ],
)
def test_what_does_not_fit_is_told_and_flies_as_it_is_told(
    name: str, misfit: tuple[str, ...], fields: list[str]
) -> None:
    """The flight as it is set is lost, or soon will be; with the settings that the lines name it reaches its end."""
    lines = vehicle_fit(load_scenario(name, misfit))
    assert [line.split(":")[0] for line in lines] == fields
    mended = (*misfit, *mends(lines))
    assert vehicle_fit(load_scenario(name, mended)) == []
    assert fly(load_scenario(name, (*SHORT, *mended))).attrs["lost"] == "null"
    if misfit == (SMALL,):
        assert fly(load_scenario(name, (*SHORT, *misfit))).attrs["lost"] != "null"


def test_rotors_that_hardly_lift_are_told() -> None:
    (line,) = vehicle_fit(load_scenario("rotors", ("vehicle.rotor_max_speed=598",)))
    assert line.startswith("vehicle.rotor_max_speed: 598 rad/s lifts 26.6 N, the weight is 26.5 N")


def test_the_tilt_is_that_of_the_loop_flown_tick_by_tick() -> None:
    """A hundred vehicles side by side, under drawn forces and torques, for as long as the loop remembers."""
    scenario = load_scenario("nominal_imu_uwb", ("servo.yaw=0.8",))
    vehicle, h, disturbance = scenario.vehicle, scenario.h, scenario.world.disturbance
    Phi, Gamma = discretize(hover_A(0.8), hover_B(vehicle), h)
    _, Gamma_d = discretize(hover_A(0.8), hover_B_d(vehicle), h)
    L = servo_gain(vehicle, scenario.servo.weights, h, 0.8)
    rng, x, i = np.random.default_rng(4), np.zeros((12, 2000)), np.zeros((3, 2000))
    sd = np.repeat(disturbance.sds(h), 3)[:, np.newaxis]
    for _ in range(1200):
        u = -L @ np.vstack([x, i])
        i = i - x[:3]
        x = Phi @ x + Gamma @ u + Gamma_d @ (sd * rng.normal(size=(6, 2000)))
    X, U = stationary(scenario, disturbance)
    np.testing.assert_allclose(np.diag(X)[:12], x.var(axis=1), rtol=0.15)
    np.testing.assert_allclose(np.diag(U), (L @ np.vstack([x, i])).var(axis=1), rtol=0.15)
