"""Drake's matrices against SciPy's, Drake's symbols and differences of the compiled equations."""

import json

import numpy as np
import pytest
from pydrake.symbolic import Evaluate, Expression, Jacobian, MakeVectorContinuousVariable
from scipy.linalg import solve_discrete_lyapunov
from scipy.signal import cont2discrete

from ortilo_drake.diagrams.linear_loop import make_linear_loop
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.equations import DYNAMICS, KINEMATICS, step
from ortilo_drake.model.hover import discretize, hover_A, hover_B, output_C
from ortilo_drake.model.vehicle import M100, mixing_matrix
from ortilo_drake.onboard.planner.planner import plan
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.scenario import InputError, Noise, Scenario, World, load_scenario
from ortilo_drake.scenario import IntermittentFilter as FilterSettings
from ortilo_drake.scenario import LqServo as ServoSettings
from ortilo_drake.studies.linearization.closed_forms import DIFFERENTIATED, differentiate_closed_loop, without_noise
from ortilo_drake.studies.linearization.linearization_report import (
    CONTROL_UNITS,
    STATE_UNITS,
    controllability_gramian,
    gramian,
    linearization_report,
    observability_gramian,
)
from ortilo_drake.studies.linearization.linearize import differentiate_tick, linearize
from ortilo_drake.studies.linearization.operating_point import LAGS, frozen_gain, operating_point, reference_at
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, hover_loop
from ortilo_drake.world.vehicle.quadrotor import QuadrotorPlant_
from ortilo_drake.world.vehicle.rotors import commanded_speeds, rotor_acceleration, wrench_of

H = 1.0 / 30.0
INERTIA = np.array(M100.inertia)
V = Noise(uwb=(0.01, 0.02, 0.03), camera=(0.02, 0.01, 0.04), imu=(1e-4, 2e-4, 3e-4))
ON_THE_WAY = np.array([3.0, -1.0, 1.5, 0.3, -0.1, 0.05, 0.6, -0.9, 0.4])  # r, r_dot, r_ddot


def flown(kinematics: str = "small_angle", **servo: object) -> Scenario:
    return Scenario(
        world=World(kinematics=kinematics, plant="sampled"),
        servo=ServoSettings(**servo),
        estimator=FilterSettings(V=V),
    )


def hover_matrices() -> tuple[np.ndarray, np.ndarray]:
    """The paper's A and B, entered by hand."""
    A, B = np.zeros((12, 12)), np.zeros((12, 4))
    A[:6, 6:] = np.eye(6)
    A[6, 4], A[7, 3] = 9.81, -9.81
    B[8:, :] = np.diag([1.0 / 2.7, 1.0 / 0.1547563, 1.0 / 0.1658929, 1.0 / 0.2077])
    return A, B


def differences(f: object, at: np.ndarray, size: float = 1e-5) -> np.ndarray:
    return np.column_stack([(f(at + d) - f(at - d)) / (2.0 * size) for d in size * np.eye(len(at))])


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_plant_and_sampled_plant_are_the_papers_matrices_and_scipys(kinematics: str) -> None:
    A, B = hover_matrices()
    plant = linearize(flown(kinematics), "plant")
    np.testing.assert_allclose(plant.A, A, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(plant.B, B, rtol=0.0, atol=1e-12)
    Phi, Gamma, *_ = cont2discrete((A, B, np.eye(12), np.zeros((12, 4))), H)
    sampled = linearize(flown(kinematics), "sampled_plant")
    np.testing.assert_allclose(sampled.A, Phi, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(sampled.B, Gamma, rtol=0.0, atol=1e-14)
    assert (plant.h, sampled.h) == (None, H)
    for system in (plant, sampled):
        np.testing.assert_array_equal(system.C, np.eye(12))
        assert not system.D.any()


def test_one_tick_of_autodiff_is_drakes_linearize() -> None:
    scenario = flown()
    at_drake = linearize(scenario, "sampled_plant")
    K, delta = frozen_gain(scenario)
    diagram = make_linear_loop(scenario, K, delta)
    context = diagram.CreateDefaultContext()
    context.SetDiscreteState(0, np.zeros(12))
    diagram.get_input_port().FixValue(context, np.zeros(9))
    A, _, C, _ = differentiate_tick(diagram, context)
    np.testing.assert_array_equal(A[:12, :12], at_drake.A)
    np.testing.assert_array_equal(C, np.eye(12, 27))


@pytest.mark.parametrize(("lag", "sign"), [("up", 1.0), ("down", -1.0)])
def test_rotors_follow_the_linearisation_on_their_side(lag: str, sign: float) -> None:
    """Commands that speed all rotors up, or slow all down, and speeds that lag behind them."""
    M = mixing_matrix(M100)
    M_inverse, tau = np.linalg.inv(M), np.array(M100.rotor_time_constant)
    hover, W_0 = np.array([M100.hover_thrust, 0.0, 0.0, 0.0]), M100.hover_rotor_speeds[0]
    system = linearize(flown(), "rotors_and_plant", lag=lag)
    rng = np.random.default_rng(5)
    for _ in range(20):
        speeds = 1e-3 * rng.uniform(0.0, 1.0, 4) * sign
        command = M @ ((W_0 + 1e-3 * rng.uniform(1.0, 2.0, 4) * sign) ** 2)
        W_dot = rotor_acceleration(W_0 + speeds, commanded_speeds(command, M_inverse, 838.0), tau)
        x_dot = DYNAMICS["small_angle"](np.zeros(12), wrench_of(W_0 + speeds, M), np.zeros(6), M100.mass, INERTIA)
        expected = system.A @ np.concatenate([np.zeros(12), speeds]) + system.B @ (command - hover)
        np.testing.assert_allclose(W_dot, expected[12:], rtol=1e-5, atol=1e-8)
        np.testing.assert_allclose(x_dot, expected[:12], rtol=1e-5, atol=1e-9)


def test_rotors_two_linearisations_differ_in_their_lag_alone() -> None:
    up, down = (linearize(flown(), "rotors_and_plant", lag=lag) for lag in LAGS)
    np.testing.assert_allclose(up.A[12:, 12:], -np.eye(4) / 0.0125, rtol=1e-13)
    np.testing.assert_allclose(down.A[12:, 12:], -np.eye(4) / 0.025, rtol=1e-13)
    np.testing.assert_array_equal(up.A[:12], down.A[:12])


@pytest.mark.parametrize("form", ["paper", "error"])
@pytest.mark.parametrize("velocities", ["estimate", "truth"])
def test_servo_is_the_slope_of_the_compiled_law(form: str, velocities: str) -> None:
    yaw = 0.7 if form == "error" else 0.0
    scenario = flown(form=form, velocities=velocities, yaw=yaw)
    L = servo_gain(M100, scenario.servo.weights, H, yaw)

    def u(inputs: np.ndarray) -> np.ndarray:
        xbar = inputs[:15].copy()
        if velocities == "truth":
            xbar[6:12] = inputs[24:]
        return servo_control(xbar, inputs[15:24], L, M100.mass, yaw, form == "error")

    servo = linearize(scenario, "servo", ON_THE_WAY)
    slope = differences(u, np.zeros(30 if velocities == "truth" else 24), 1.0)
    np.testing.assert_allclose(servo.D, slope, rtol=0.0, atol=1e-12)
    assert servo.D.shape == (len(servo.outputs), len(servo.inputs))
    assert servo.h is None


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_operating_point_accelerates_as_planned(kinematics: str) -> None:
    for yaw in (0.0, 0.1):
        x, u = operating_point(M100, kinematics, ON_THE_WAY, 0.0 if kinematics == "linear" else yaw)
        x_dot = DYNAMICS[kinematics](x, u, np.zeros(6), M100.mass, INERTIA)
        np.testing.assert_allclose(x_dot, [*ON_THE_WAY[3:6], 0, 0, 0, *ON_THE_WAY[6:], 0, 0, 0], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_plant_on_the_way_has_the_slopes_of_drakes_symbols(kinematics: str) -> None:
    yaw = 0.0 if kinematics == "linear" else 0.8
    scenario = flown(kinematics, yaw=yaw)
    x_0, u_0 = operating_point(M100, kinematics, ON_THE_WAY, yaw)
    plant = QuadrotorPlant_[float](vehicle=M100, kinematics=kinematics).ToScalarType[Expression]()
    context = plant.CreateDefaultContext()
    x, u = MakeVectorContinuousVariable(12, "x"), MakeVectorContinuousVariable(4, "u")
    context.SetContinuousState([Expression(v) for v in x])
    plant.GetInputPort("control").FixValue(context, [Expression(v) for v in u])
    with np.errstate(invalid="ignore"):  # Drake boxes an Expression's cell in a NaN
        x_dot = plant.EvalTimeDerivatives(context).CopyToVector()
    there = dict(zip([*x, *u], [*x_0, *u_0], strict=True))
    system = linearize(scenario, "plant", ON_THE_WAY)
    np.testing.assert_allclose(system.A, Evaluate(Jacobian(x_dot, x), there), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(system.B, Evaluate(Jacobian(x_dot, u), there), rtol=0.0, atol=1e-12)
    if kinematics != "linear":
        assert np.max(np.abs(system.A - hover_matrices()[0])) > 0.1  # it is not the hover model's


@pytest.mark.parametrize("kinematics", KINEMATICS)
def test_sampled_plant_on_the_way_has_the_slopes_of_the_compiled_step(kinematics: str) -> None:
    x, u = operating_point(M100, kinematics, ON_THE_WAY, 0.0)

    def after(z: np.ndarray) -> np.ndarray:
        return step(z[:12], z[12:], np.zeros(6), M100.mass, INERTIA, KINEMATICS.index(kinematics), H)

    system = linearize(flown(kinematics), "sampled_plant", ON_THE_WAY)
    slopes = differences(after, np.concatenate([x, u]))
    np.testing.assert_allclose(np.hstack([system.A, system.B]), slopes, rtol=0.0, atol=1e-9)


def test_closed_loop_on_the_way_has_the_slopes_of_its_tick() -> None:
    scenario = flown("rigid_body", yaw=0.05)
    frozen = frozen_gain(scenario)
    diagram = make_linear_loop(scenario, *frozen)
    context = diagram.CreateDefaultContext()

    def after(z: np.ndarray) -> np.ndarray:
        context.SetDiscreteState(0, z[:12])
        context.SetDiscreteState(1, z[12:27])
        diagram.get_input_port().FixValue(context, z[27:])
        values = diagram.EvalUniquePeriodicDiscreteUpdate(context)
        return np.concatenate([values.value(0), values.value(1)])

    x, _ = operating_point(M100, "rigid_body", ON_THE_WAY, 0.05)
    loop = linearize(scenario, "closed_loop", ON_THE_WAY, frozen=frozen)
    slopes = differences(after, np.concatenate([x, x, np.zeros(3), ON_THE_WAY]))
    np.testing.assert_allclose(np.hstack([loop.A, loop.B]), slopes, rtol=0.0, atol=1e-8)


@pytest.mark.long
def test_reference_comes_from_the_planned_path() -> None:
    scenario = load_scenario("nominal_imu_uwb")
    path = plan(scenario.planner, scenario.load_room(), M100)
    t, size = 8.0, 1e-4
    before, at, after = (path.value(t + dt)[:, 0] for dt in (-size, 0.0, size))
    reference = reference_at(path, t)
    np.testing.assert_array_equal(reference[:3], at)
    np.testing.assert_allclose(reference[3:6], (after - before) / (2 * size), atol=1e-6)
    np.testing.assert_allclose(reference[6:], (after - 2 * at + before) / size**2, atol=1e-5)
    assert linearize(scenario, "plant", reference).A.shape == (12, 12)


def test_what_cannot_be_linearised_is_refused() -> None:
    with pytest.raises(InputError, match="part: 'wing': must be one of plant, rotors_and_plant"):
        linearize(flown(), "wing")
    with pytest.raises(InputError, match="lag: 'both': must be one of up, down"):
        linearize(flown(), "rotors_and_plant", lag="both")
    for sensors, names in (((), "x, y, z, phi, theta, psi, x_dot"), (("imu",), "x, y, z, x_dot, y_dot, z_dot")):
        blind = flown().model_copy(update={"sensors": sensors})
        with pytest.raises(InputError, match=rf"no measurement sees eigenvalue 1 \(\d+ times\) in {names}"):
            frozen_gain(blind)


@pytest.mark.parametrize("integrator", ["literal", "hold", "estimate"])
def test_plant_servo_and_estimator_in_a_loop_are_the_closed_loop(integrator: str) -> None:
    """Their matrices joined by hand, u = D_s [xhat; i; r], y = C x; Drake differentiates the joined diagram."""
    scenario = Scenario(estimator=FilterSettings(V=V, integrator=integrator))
    plant, servo, estimator, loop = (
        linearize(scenario, part) for part in ("sampled_plant", "servo", "estimator", "closed_loop")
    )
    C = scenario.measurement.layout.C
    p = len(C)
    assert estimator.states == (*(f"{name}_hat" for name in plant.states), "i_x", "i_y", "i_z")
    assert estimator.inputs == (*scenario.measurement.outputs, *plant.inputs, *loop.inputs)
    by_y, by_u, by_r = np.split(estimator.B, [p, p + 4], axis=1)
    by_estimate, feed = np.split(servo.D, [15], axis=1)
    A = np.block([[plant.A, plant.B @ by_estimate], [by_y @ C, estimator.A + by_u @ by_estimate]])
    B = np.vstack([plant.B @ feed, by_r + by_u @ feed])
    np.testing.assert_allclose(loop.A, A, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(loop.B, B, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(loop.frame("A").loc["x", "theta_hat"], loop.A[0, 16])


def test_everything_named_has_its_unit() -> None:
    units = linearize(load_scenario("imu_uwb"), "estimator").units
    expected = {
        "x_hat": "m", "theta_hat": "rad", "y_dot_hat": "m/s", "psi_dot_hat": "rad/s", "d_x_hat": "N", "f_z_hat": "N",
        "b_x_hat": "m/s^2", "n_y_hat": "N m", "c_z_hat": "rad/s", "bias_x_uwb_hat": "m", "i_x": "m", "z_uwb": "m",
        "psi_imu": "rad", "a_x": "m/s^2", "phi_dot_imu": "rad/s", "f_T": "N", "tau_x": "N m", "r_x_ddot": "m/s^2",
    }  # fmt: skip
    assert {name: units[name] for name in expected} == expected


def test_a_tight_filter_has_no_matrices_but_its_vehicle_has() -> None:
    tight = load_scenario("tight_imu_uwb")
    assert linearize(tight, "plant").A.shape == (12, 12)
    for part in ("estimator", "closed_loop"):
        with pytest.raises(InputError, match=r"^estimator\.kind: tight: must be intermittent"):
            linearize(tight, part)


def test_states_that_never_change_are_named_for_their_gain_does_not_settle() -> None:
    """W reaches none of them, and their eigenvalue is 1: Hautus' test says that no solution is stabilising."""
    scenario = load_scenario("unbiased_imu_uwb")
    loop = hover_loop(scenario)
    N = len(loop.names)
    assert np.linalg.matrix_rank(np.hstack([loop.Phi - np.eye(N), loop.W])) == N - 6
    with pytest.raises(InputError, match=r"^estimator\.walks: b_x, b_y, b_z, c_x, c_y, c_z never change"):
        linearize(scenario, "estimator")
    walking = ("estimator.walks.accelerometer_rate=1.0e-4", "estimator.walks.gyroscope_rate=1.0e-5")
    assert len(linearize(load_scenario(scenario, walking), "estimator").A) == N + 3


PHI, GAMMA = discretize(hover_A(), hover_B(M100), H)


def test_gramian_of_two_integrators_is_the_closed_form_sum() -> None:
    n = 50
    A, C = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    first, second = 0.1 * n * (n - 1) / 2, 0.01 * (n - 1) * n * (2 * n - 1) / 6
    np.testing.assert_allclose(gramian(A, C, n), [[n, first], [first, second]], rtol=1e-13)


def test_gramian_of_a_stable_pair_is_the_lyapunov_solution_less_its_tail() -> None:
    rng = np.random.default_rng(8)
    A = rng.normal(size=(5, 5))
    A *= 0.9 / np.max(np.abs(np.linalg.eigvals(A)))
    C = rng.normal(size=(2, 5))
    X = solve_discrete_lyapunov(A.T, C.T @ C)
    power = np.linalg.matrix_power(A, 17)
    np.testing.assert_allclose(gramian(A, C, 17), X - power.T @ X @ power, rtol=1e-9, atol=1e-9)


def test_gramians_of_the_vehicle_in_their_units() -> None:
    scenario, ticks = Scenario(), 60
    sensors = ("uwb", "imu")
    seen = np.vstack([output_C()[r] for r in (0, 1, 2, 6, 7, 8)])
    stacked = np.vstack([seen @ np.linalg.matrix_power(PHI, k) for k in range(ticks)])
    weights = np.tile(np.repeat([1.0, 0.1], 3), ticks)  # m, 0.1 rad
    scaled = stacked * STATE_UNITS / weights[:, None]
    by_outputs = observability_gramian(scenario, sensors, 2.0)
    s = np.linalg.svd(scaled, compute_uv=False)
    np.testing.assert_allclose(by_outputs.singular_values, s**2, rtol=1e-9)
    assert by_outputs.condition == pytest.approx((s[0] / s[-1]) ** 2, rel=1e-9)
    reached = np.hstack([np.linalg.matrix_power(PHI, k) @ GAMMA * CONTROL_UNITS for k in range(ticks)])
    s = np.linalg.svd(reached / STATE_UNITS[:, None], compute_uv=False)
    by_control = controllability_gramian(scenario, 2.0)
    np.testing.assert_allclose(by_control.singular_values, s**2, rtol=1e-8)
    assert np.isinf(observability_gramian(scenario, ("imu",), 2.0).condition)


def test_gramians_grow_with_the_horizon_without_end() -> None:
    def largest(sensors: tuple[str, ...], horizon: float) -> float:
        return float(observability_gramian(Scenario(), sensors, horizon).singular_values[0])

    assert largest(("uwb",), 800.0) / largest(("uwb",), 400.0) == pytest.approx(2.0**7, rel=0.02)
    assert largest(("imu",), 800.0) / largest(("imu",), 400.0) == pytest.approx(2.0**3, rel=0.02)


def test_a_horizon_below_a_tick_is_refused() -> None:
    for horizon in (0.0, -1.0, 0.01, np.nan, np.inf):
        with pytest.raises(InputError, match=r"horizon: .* must be at least a tick, 0\.0333333 s"):
            controllability_gramian(Scenario(), horizon)


@pytest.mark.long
@pytest.mark.parametrize("late", [0, 1])  # UWB is there on every third tick
@pytest.mark.parametrize(
    "settings",
    [
        (),
        ("estimator.integrator=estimate",),
        ("estimator.integrator=literal", "servo.form=paper"),
        ("servo.velocities=truth",),
        ("estimator.V.uwb=[0.05, 0.05, 0.05]", "multilateration.method=nearest_three"),
        ("estimator.force=thrust",),
        ("estimator.force=measured",),
        ("estimator.force=measured", "estimator.integrator=estimate", "servo.velocities=truth"),
        ("estimator.force=thrust", "servo.form=paper"),
        ("world.drag=[0.5, 1.5, 0.2]",),
        ("world.drag=[0.5, 1.5, 0.2]", "estimator.force=measured"),
    ],
    ids=[
        "hold",
        "estimate",
        "literal",
        "truth",
        "constant V",
        "thrust",
        "measured",
        "measured, truth",
        "thrust, paper",
        "drag",
        "drag, measured",
    ],
)
def test_the_matrices_are_those_of_the_diagram_that_flies(settings: tuple[str, ...], late: int) -> None:
    # The literal integrator throws the vehicle in the ticks without a fix: a fix far away has another covariance.
    thrown = "estimator.integrator=literal" in settings
    flown_tick = differentiate_closed_loop(load_scenario("nominal_imu_uwb", settings), late + (300 if thrown else 900))
    np.testing.assert_array_equal(flown_tick.delta[:3], [1.0 - late, 0.0, 1.0])
    assert np.max(np.abs(flown_tick.expected)) > 1.0
    assert np.max(np.abs(flown_tick.K)) > 0.1
    walks = any("force" in setting for setting in settings)  # whose covariance takes minutes to settle
    assert flown_tick.gain_change < (1e-2 if thrown or walks else 1e-10)
    assert flown_tick.largest_difference < (1e-9 if thrown else 1e-12)


@pytest.mark.long
@pytest.mark.parametrize("name", ["imu_uwb", "imu_uwb_yolo", "realistic_flow", "robust_imu_uwb", "robust_imu_uwb_yolo"])
def test_so_they_are_with_torque_and_biases_as_states(name: str) -> None:
    tick = differentiate_closed_loop(load_scenario(name), 300)
    loop = hover_loop(without_noise(load_scenario(name)))
    assert set(loop.names) >= {"n_x", "bias_z_uwb"}
    assert len(tick.A) == len(loop.state_names) == 15 + len(loop.names) + 3
    assert tick.largest_difference < 1e-12


@pytest.mark.family("measured")
@pytest.mark.parametrize("force", ["thrust", "measured"])
def test_the_flown_tick_tells_a_wrong_force(force: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", (f"estimator.force={force}",))
    tick, loop = differentiate_closed_loop(scenario, 300), hover_loop(scenario)
    without = loop.L.copy()
    without[:, loop.names.index("d_y")] = 0.0
    assert np.max(np.abs(closed_loop_matrix(loop._replace(L=without), tick.K, tick.delta) - tick.A)) > 1e-3


@pytest.mark.long
def test_the_flown_tick_tells_a_wrong_model() -> None:
    scenario = load_scenario("nominal_imu_uwb")
    tick = differentiate_closed_loop(scenario, 300)
    there = np.array([1.0, 0.0, 1.0])
    wrong_gain = closed_loop_matrix(hover_loop(scenario), 1.001 * tick.K, there)
    assert np.max(np.abs(wrong_gain - tick.A)) > 1e-5
    wrong_integrator = closed_loop_matrix(hover_loop(scenario)._replace(integrator="estimate"), tick.K, there)
    assert np.max(np.abs(wrong_integrator - tick.A)) > 0.9


def test_a_tick_before_a_period_of_the_sensors_is_refused() -> None:
    with pytest.raises(InputError, match="tick: 2: must be at least 3"):
        differentiate_closed_loop(load_scenario("nominal_imu_uwb"), 2)


@pytest.mark.long
def test_a_report_is_json_and_holds_the_must_shows() -> None:
    report = linearization_report(load_scenario("nominal_imu_uwb"))
    json.dumps(as_data(report), allow_nan=False)
    assert set(report.agreement) == {*DIFFERENTIATED, "rotors_and_plant (up)", "rotors_and_plant (down)"} - {
        "rotors_and_plant"
    }
    for part in ("plant", "sampled_plant", "closed_loop"):
        assert max(report.agreement[part].values()) < 1e-10
    assert set(report.flown) == {"uwb+imu", "imu"}
    assert max(report.flown.values()) < 1e-8
    assert {name: len(z) for name, z in report.eigenvalues.items()} == {
        "plant": 12, "sampled_plant": 12, "servo_loop": 15, "filter": 12, "closed_loop": 27,
    }  # fmt: skip
    radius = {name: max(abs(w) for w in z) for name, z in report.eigenvalues.items()}
    assert radius["plant"] == 0.0
    assert radius["closed_loop"] == pytest.approx(max(radius["servo_loop"], radius["filter"]), abs=1e-9)
    assert report.unobservable_states["uwb"] == ["psi", "psi_dot"]
    assert report.gramians.observability["imu"].condition == np.inf
    assert report.uncontrollable_modes == []


def test_a_report_without_sensors_is_refused() -> None:
    with pytest.raises(InputError, match=r"no measurement sees eigenvalue 1 \(12 times\) in x, y, z, phi"):
        linearization_report(Scenario(sensors=()))
