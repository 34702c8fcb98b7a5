"""The linear loop without noise, flown by Drake, against a plain matrix recursion: rule 4 of the design, sampling."""

from collections.abc import Callable

import numpy as np
import pytest
from pydrake.systems.analysis import ApplySimulatorConfig, Simulator, SimulatorConfig
from pydrake.systems.framework import Diagram, DiagramBuilder
from pydrake.systems.primitives import (
    AffineSystem,
    ConstantVectorSource,
    Multiplexer,
    TrajectorySource,
    VectorLogSink,
    ZeroOrderHold,
)
from pydrake.trajectories import PiecewisePolynomial
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

from ortilo_drake.loop.diagram import add_wiring
from ortilo_drake.loop.element import bundle, constant, outside
from ortilo_drake.loop.wiring import Wiring
from ortilo_drake.model.hover import disturbance_W, hover_A, hover_B
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.estimator.filter_element import filter_box
from ortilo_drake.onboard.estimator.filter_model import filter_model, initial_covariance
from ortilo_drake.onboard.estimator.measurement_handler import handler_box, incoming_of
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.onboard.servo.lq_servo import servo_box
from ortilo_drake.scenario import IntermittentFilter as FilterSettings
from ortilo_drake.scenario import LqServo as ServoSettings
from ortilo_drake.scenario import Noise
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_

H = 1.0 / 30.0
TICKS = 400
VARIANCES = Noise(uwb=(0.01, 0.02, 0.03), camera=(0.02, 0.01, 0.04), imu=(1e-4, 2e-4, 3e-4))
FILTER = FilterSettings(V=VARIANCES)
MEASUREMENT = make_measurement()
HOVER = np.array([2.7 * 9.81, 0.0, 0.0, 0.0])
X_0 = np.array([0.1, -0.2, 0.15, 0.02, -0.03, 0.05, 0.1, 0.0, -0.1, 0.01, 0.02, -0.01])
R_1 = np.array([0.8, -0.5, 0.4])  # the reference steps there from 0
STEP = 31
SETTINGS = [("error", "estimate"), ("error", "hold"), ("paper", "literal"), ("paper", "hold")]
LOGGED = {"state": 12, "estimate": 15, "covariance": 225, "control": 4}
MESSAGES = {"uwb": 14, "camera": 14, "imu": 11}


def all_on() -> np.ndarray:
    return np.ones((TICKS + 1, 3))


def intermittent() -> np.ndarray:
    """UWB on every third tick with a gap, the camera by chance, the IMU nearly always."""
    delta = (np.random.default_rng(41).random((TICKS + 1, 3)) < [1.0, 0.4, 0.95]).astype(float)
    delta[:, 0] *= np.arange(TICKS + 1) % 3 == 0
    delta[120:150, :2] = 0.0
    return delta


def per_tick(values: np.ndarray) -> PiecewisePolynomial:
    """A signal with values[k] about t_k: it changes between two ticks, where nobody looks."""
    breaks = (np.arange(len(values) + 1) - 0.5) * H
    return PiecewisePolynomial.ZeroOrderHold(breaks, np.vstack([values, values[-1:]]).T)


def reference() -> np.ndarray:
    r = np.zeros((TICKS + 1, 9))
    r[STEP:, :3] = R_1
    return r


def make_loop(form: str, integrator: str, delta: np.ndarray) -> Diagram:
    """The 'linear' plant, a hold, exact measurements C x as messages, and the elements of the onboard half."""
    builder = DiagramBuilder()
    plant = builder.AddSystem(QuadrotorPlant_[float](vehicle=M100, kinematics="linear"))
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(H, 4))
    planner = builder.AddSystem(TrajectorySource(per_tick(reference())))
    sources = {"reference": planner.get_output_port()}
    for j, (name, size) in enumerate(MESSAGES.items()):
        # message = [flag, stamp and payload], the payload's first three entries are x[first : first + 3].
        D = np.zeros((size - 1, 12))
        first = 3 if name == "imu" else 0
        D[1:4, first : first + 3] = np.eye(3)
        empty = np.zeros((0, 0))
        payload = AffineSystem(empty, np.zeros((0, 12)), np.zeros(0), np.zeros((size - 1, 0)), D, np.zeros(size - 1))
        sensor = builder.AddNamedSystem(name, payload)
        flag = builder.AddNamedSystem(f"{name}_flag", TrajectorySource(per_tick(delta[:, j : j + 1])))
        message = builder.AddNamedSystem(f"{name}_message", Multiplexer([1, size - 1]))
        builder.Connect(plant.GetOutputPort("state"), sensor.get_input_port())
        builder.Connect(flag.get_output_port(), message.get_input_port(0))
        builder.Connect(sensor.get_output_port(), message.get_input_port(1))
        sources[name] = message.get_output_port()
    asked = {"belief": "filter", "control": "servo"}
    onboard = add_wiring(builder, onboard_wiring(form, integrator), asked, H, sources).outputs
    calm = builder.AddSystem(ConstantVectorSource(np.zeros(6)))
    log = builder.AddNamedSystem("log", VectorLogSink(256, H))
    logged = builder.AddNamedSystem("logged", Multiplexer([12, 240, 4]))
    builder.Connect(calm.get_output_port(), plant.GetInputPort("disturbance"))
    builder.Connect(hold.get_output_port(), plant.GetInputPort("control"))
    builder.Connect(onboard["control"], hold.get_input_port())
    for k, source in enumerate((plant.GetOutputPort("state"), onboard["belief"], onboard["control"])):
        builder.Connect(source, logged.get_input_port(k))
    builder.Connect(logged.get_output_port(), log.get_input_port())
    return builder.Build()


def onboard_wiring(form: str, integrator: str) -> Wiring:
    """Handler, filter and servo."""
    messages = [outside(name, size) for name, size in MESSAGES.items()]
    V: dict[str, np.ndarray | None] = {name: np.diag(variances) for name, variances in VARIANCES}
    handler = handler_box(incoming_of(MEASUREMENT, MESSAGES, V, {}), MEASUREMENT.layout, False, H)
    model, P_0 = filter_model(FILTER, M100, integrator, H), initial_covariance(FILTER)
    kalman = filter_box(model, MEASUREMENT, M100.hover_thrust, np.concatenate((np.zeros(15), P_0.ravel())))
    measured = {name: f"handler.{name}" for name in MEASUREMENT.sizes}
    settings = ServoSettings(form=form)
    servo = servo_box(servo_gain(M100, settings.weights, H), M100.mass, settings)
    return Wiring(
        [
            *messages,
            outside("reference", 9),
            bundle("messages", messages),
            constant("none_opened", np.zeros(15)),
            constant("no_force", np.zeros(3)),
            handler.with_inputs(belief="filter"),
            kalman.with_inputs(**measured, control="servo", opening="none_opened"),
            servo.with_inputs(belief="filter", force="no_force"),
        ]
    )


def flown(form: str, integrator: str, delta: np.ndarray) -> dict[str, np.ndarray]:
    """The log of the diagram, one row a tick."""
    diagram = make_loop(form, integrator, delta)
    simulator = Simulator(diagram)
    ApplySimulatorConfig(
        SimulatorConfig(integration_scheme="runge_kutta5", max_step_size=H, use_error_control=False), simulator
    )
    context = simulator.get_mutable_context()
    plant = diagram.GetSubsystemByName("quadrotor")
    plant.GetMyMutableContextFromRoot(context).SetContinuousState(X_0)
    simulator.AdvanceTo((TICKS + 0.25) * H)
    log = diagram.GetSubsystemByName("log").FindLog(context)
    np.testing.assert_allclose(log.sample_times(), H * np.arange(TICKS + 1), atol=1e-12)
    return dict(zip(LOGGED, np.split(log.data().T, np.cumsum(list(LOGGED.values()))[:-1], axis=1), strict=True))


def recursion(form: str, integrator: str, delta: np.ndarray) -> dict[str, np.ndarray]:
    """The same loop as matrices, at the ticks: measure, control, log, then step vehicle and filter."""
    Phi, Gamma, *_ = cont2discrete((hover_A(), hover_B(M100), np.eye(12), np.zeros((12, 4))), H, method="zoh")
    C = np.kron([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], np.eye(3)) @ np.eye(6, 12)
    L = servo_gain(M100, ServoSettings().weights, H)
    W = disturbance_W(M100, H, 0.27, 0.005)
    V2 = np.diag([*VARIANCES.uwb, *VARIANCES.camera, *VARIANCES.imu])
    x, xbar = X_0, np.zeros(15)
    P = np.diag([*np.repeat(np.square(FILTER.initial_sd), 3), 0.0, 0.0, 0.0])
    rows = []
    for k, r in enumerate(reference()[:, :3]):
        x_ref = np.concatenate([r, np.zeros(12)]) if form == "error" else np.zeros(15)
        u = -L @ (xbar - x_ref)
        rows.append(np.concatenate([x, xbar, P.ravel(), u + HOVER]))
        there = np.repeat(delta[k], 3) > 0
        fixed = integrator != "estimate" and (there[0] or there[3])
        E = np.zeros((3, 9))
        if fixed:
            chosen = 0 if there[0] else 3
            E[:, chosen : chosen + 3] = np.eye(3)
        Phibar = block_diag(Phi, np.eye(3))
        Phibar[12:, :12] = -E @ C
        Hk, E, V = np.hstack([C, np.zeros((9, 3))])[there], E[:, there], V2[np.ix_(there, there)]
        cross = np.vstack([np.zeros((12, there.sum())), -E @ V])  # Ebar V12
        K = np.linalg.solve(Hk @ P @ Hk.T + V, (Phibar @ P @ Hk.T + cross).T).T
        F, G = Phibar - K @ Hk, K + np.vstack([np.zeros((12, there.sum())), E])
        P = F @ P @ F.T + block_diag(W, np.zeros((3, 3))) + G @ V @ G.T
        step = Phibar @ xbar + np.concatenate([Gamma @ u, np.zeros(3)]) + K @ ((C @ x)[there] - Hk @ xbar)
        if integrator == "estimate":
            step[12:] += r - xbar[:3]
        elif integrator == "literal" or fixed:
            step[12:] += r
        x, xbar = Phi @ x + Gamma @ u, step
    return dict(zip(LOGGED, np.split(np.array(rows), np.cumsum(list(LOGGED.values()))[:-1], axis=1), strict=True))


@pytest.mark.family("error-hold-all_on")
@pytest.mark.parametrize("pattern", [all_on, intermittent])
@pytest.mark.parametrize(("form", "integrator"), SETTINGS)
def test_the_diagram_is_the_matrix_recursion(form: str, integrator: str, pattern: Callable[[], np.ndarray]) -> None:
    flight = flown(form, integrator, pattern())
    expected = recursion(form, integrator, pattern())
    for name, values in expected.items():
        largest = np.max(np.abs(values))
        assert np.max(np.abs(flight[name] - values)) < 1e-12 * largest, name
    # Something moved: the vehicle tilted, went most of the way of the step, and the estimate's error decayed.
    assert np.max(np.abs(flight["state"][STEP:, 3:5])) > 0.02
    assert np.linalg.norm(flight["state"][-1, :3] - R_1) < 0.35 * np.linalg.norm(R_1)
    wrong = np.linalg.norm(flight["estimate"][:, :12] - flight["state"], axis=1)
    assert wrong[-1] < 0.05 * wrong[0]
