"""Single parts, each beside an independent source, and put together for a vehicle that is no M100."""

from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, ZeroOrderHold
from scipy.signal import cont2discrete
from scipy.stats import binom, chi2

import ortilo_drake as od
from ortilo_drake.diagrams.single_parts import suiting_rates

H = 0.02
SMALL = od.Vehicle(mass=1.2, inertia=(0.012, 0.013, 0.022))
ANCHORS = [[0.0, 0.0, 0.2], [8.0, 0.0, 2.5], [8.0, 6.0, 0.2], [0.0, 6.0, 2.5], [4.0, 0.0, 2.8]]
PLACE = np.array([3.0, 2.0, 1.0])
X_0 = np.concatenate([PLACE, np.zeros(9)])


def said(system: Any, port: str, time: float = 0.0, **inputs: np.ndarray) -> np.ndarray:
    context = system.CreateDefaultContext()
    context.SetTime(time)
    for name, values in inputs.items():
        system.GetInputPort(name).FixValue(context, values)
    return np.array(system.GetOutputPort(port).Eval(context))


def test_the_servo_is_drakes_regulator_of_that_vehicle_at_hover() -> None:
    servo = od.make_servo(SMALL, H, servo__weights__position=[20.0] * 3)
    m, g, moments = SMALL.mass, 9.81, np.array(SMALL.inertia)
    A, B = np.zeros((12, 12)), np.zeros((12, 4))
    A[:6, 6:], A[6, 4], A[7, 3] = np.eye(6), g, -g
    B[8, 0], B[9:, 1:] = 1.0 / m, np.diag(1.0 / moments)
    Phi, Gamma, *_ = cont2discrete((A, B, np.eye(12), np.zeros((12, 4))), H)
    E = np.eye(3, 12)
    Phi_bar = np.block([[Phi, np.zeros((12, 3))], [-E, np.eye(3)]])
    Q = np.diag(np.repeat([20.0, 1.0, 1.0, 0.1, 3e-4], 3))  # the defaults, but for the positions
    R = np.diag([0.02, 1.0, 1.0, 1.0])
    L, _ = DiscreteTimeLinearQuadraticRegulator(Phi_bar, np.vstack([Gamma, np.zeros((3, 4))]), Q, R)
    estimate = np.random.default_rng(0).normal(size=15)
    u = said(servo, "control", estimate=estimate, reference=np.zeros(9))
    np.testing.assert_allclose(u, [m * g, 0.0, 0.0, 0.0] - L @ estimate, rtol=1e-6, atol=1e-8)


def test_the_ranges_of_a_sensor_are_distances_with_its_noise_and_its_losses() -> None:
    uwb = od.make_sensor(
        "uwb", ANCHORS, H, seed=3, link__rate=None, link__loss=0.3, noise={"kind": "constant", "sd": 0.1}
    )
    messages = np.array([said(uwb, "uwb", k * H, state=X_0) for k in range(600)])
    arrived = messages[:, 0] == 1.0
    assert binom.ppf(1e-4, 600, 0.7) < arrived.sum() < binom.ppf(1.0 - 1e-4, 600, 0.7)
    assert not messages[~arrived].any()
    np.testing.assert_allclose(messages[arrived, 1], H * np.flatnonzero(arrived), atol=1e-12)
    z = (messages[arrived, 2:7] - np.linalg.norm(np.array(ANCHORS) - PLACE, axis=1)) / 0.1
    assert chi2.ppf(1e-4, z.size) < (z**2).sum() < chi2.ppf(1.0 - 1e-4, z.size)


def test_the_plant_falls_and_an_imu_at_rest_feels_gravity() -> None:
    falling = od.make_plant(SMALL)
    np.testing.assert_allclose(said(falling, "acceleration", control=np.zeros(4)), [0.0, 0.0, -9.81])
    imu = od.make_sensor("imu", specific_force_density=0.0)
    message = said(imu, "imu", state=X_0, acceleration=np.zeros(3))
    np.testing.assert_allclose(message[8:], [0.0, 0.0, 9.81])


def hover(seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return state, estimate and covariance at every tick of the parts wired as docs/how_to/single_parts.md says."""
    builder = DiagramBuilder()
    plant, uwb, imu, estimator, servo, hold, reference = map(
        builder.AddSystem,
        (
            od.make_plant(SMALL, time_step=H, x_0=X_0),
            od.make_sensor("uwb", ANCHORS, H),
            od.make_sensor("imu", h=H),
            od.make_estimator(SMALL, ANCHORS, h=H, x_0=X_0, scenario="nominal_imu_uwb"),
            od.make_servo(SMALL, H),
            ZeroOrderHold(H, 4),
            ConstantVectorSource([*PLACE, *np.zeros(6)]),
        ),
    )
    for port, *readers in (
        (plant.GetOutputPort("state"), uwb.GetInputPort("state"), imu.GetInputPort("state")),
        (plant.GetOutputPort("acceleration"), imu.GetInputPort("acceleration")),
        (uwb.GetOutputPort("uwb"), estimator.GetInputPort("uwb")),
        (imu.GetOutputPort("imu"), estimator.GetInputPort("imu")),
        (estimator.GetOutputPort("estimate"), servo.GetInputPort("estimate")),
        (reference.get_output_port(), servo.GetInputPort("reference"), estimator.GetInputPort("reference")),
        (servo.GetOutputPort("control"), hold.get_input_port(), estimator.GetInputPort("control")),
        (hold.get_output_port(), plant.GetInputPort("control")),
    ):
        for reader in readers:
            builder.Connect(port, reader)
    shown = (plant.GetOutputPort("state"), estimator.GetOutputPort("estimate"), estimator.GetOutputPort("covariance"))
    logs = [LogVectorOutput(port, builder, publish_period=H) for port in shown]
    simulator = Simulator(builder.Build())
    at_hover = [SMALL.hover_thrust, 0.0, 0.0, 0.0]
    hold.SetVectorState(hold.GetMyMutableContextFromRoot(simulator.get_mutable_context()), at_hover)
    simulator.AdvanceTo(seconds)
    x, xhat, P = (log.FindLog(simulator.get_context()).data().T for log in logs)
    return x, xhat, P.reshape(-1, 15, 15)


@pytest.mark.long
def test_the_parts_together_hold_a_small_vehicle_and_know_how_well() -> None:
    x, xhat, P = hover(20.0)
    error = x - xhat[:, :12]
    assert np.abs(x[:, :3] - PLACE).max() < 0.3
    nees = np.mean([e @ np.linalg.solve(p[:12, :12], e) for e, p in zip(error[50:], P[50:], strict=True)])
    assert 1.0 < nees < 12.0 * 1.3  # 12 of a consistent filter; it believes in a disturbance that there is not


def test_every_part_can_be_cloned_and_differentiated() -> None:
    for part in (
        od.make_plant(SMALL),
        od.make_servo(SMALL, H),
        od.make_sensor("uwb", ANCHORS, H),
        od.make_sensor("imu"),
        od.make_sensor("camera"),
        od.make_sensor("altimeter"),
        od.make_estimator(SMALL, ANCHORS, h=H),
        od.make_body_state(1),
    ):
        sizes = [part.get_output_port(i).size() for i in range(part.num_output_ports())]
        for other in (part.Clone(), part.ToAutoDiffXd()):
            assert [other.get_output_port(i).size() for i in range(other.num_output_ports())] == sizes
            assert other.num_input_ports() == part.num_input_ports()


def test_a_tick_that_suits_the_usual_rates_leaves_them_and_another_takes_the_nearest() -> None:
    all_three = ("uwb", "camera", "imu")
    for h, hz in ((1.0 / 30.0, 10.0), (0.02, 10.0), (0.04, 12.5), (0.07, 1.0 / 0.07)):
        assert suiting_rates("imu_uwb", h, all_three) == {"uwb__link__rate": hz, "camera__link__rate": hz}
    assert suiting_rates("imu_uwb", 0.2) == {}


@pytest.mark.parametrize("h", [0.03, 1.0 / 128.0])
def test_any_tick_will_do_also_one_of_which_the_usual_10_hz_are_no_whole_number(h: float) -> None:
    x = np.concatenate([[0.1, -0.2, 0.3], np.zeros(12)])
    assert np.all(np.isfinite(said(od.make_servo(SMALL, h), "control", estimate=x, reference=np.zeros(9))))
    assert said(od.make_estimator(SMALL, ANCHORS, h=h, x_0=X_0), "estimate")[:3] == pytest.approx(PLACE)
    assert said(od.make_sensor("uwb", ANCHORS, h, link__rate=None), "uwb", state=X_0)[0] == 1.0


@pytest.mark.parametrize(
    ("make", "line"),
    [
        (lambda: od.make_sensor("uwbb"), "name: 'uwbb': must be one of uwb, camera, imu"),
        (lambda: od.make_sensor("uwb", link__loss=3.0), "uwb.link.loss.probability: 3"),
        (lambda: od.make_sensor("imu", link__rate=120.0), "imu.link.rate: 120: must be at most 1 / h = 30 Hz"),
        (lambda: od.make_estimator(room=[[1.0, 2.0, 3.0]]), r"room: has the shape \(1, 3\)"),
        (lambda: od.make_estimator(x_0=[1.0]), "x_0: must be 12 finite numbers"),
        (lambda: od.make_estimator(sensors=("uwb", "sonar")), "sensors.1: 'sonar'"),
        (lambda: od.make_servo(h=-1.0), "h: -1.0: must be 0.001 to 0.2 s"),
        (lambda: od.make_servo(h="a"), "h: 'a': must be 0.001 to 0.2 s"),
        (lambda: od.make_servo(1.2), r"vehicle: 1\.2: must be a Vehicle"),  # type: ignore[arg-type]
        (lambda: od.make_plant(1.2), r"vehicle: 1\.2: must be a Vehicle"),  # type: ignore[arg-type]
        (lambda: od.make_estimator(sensors="uwb"), r"sensors: 'uwb': must be several, as \('uwb',\)"),
        (lambda: od.make_sensor("uwb", h=0.03, link={"rate": 7.0}), r"uwb\.link\.rate: 7\.0: must divide control_rate"),
        (lambda: od.make_sensor("uwb", h=0.03), r"link__rate: must be given with h = 0\.03 s, .* 10 Hz do not suit"),
        (lambda: od.make_plant(kinematics="planar"), "kinematics: 'planar': must be one of"),
        (lambda: od.make_plant(time_step=-1.0), "time_step: -1.0: must be 0 or positive"),
    ],
)
def test_what_is_wrong_is_told_in_a_line(make: Any, line: str) -> None:
    with pytest.raises(od.InputError, match=line) as told:
        make()
    assert "\n" not in str(told.value)
