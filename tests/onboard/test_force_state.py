"""The filter with a force state against closed forms, Drake, SciPy, and a dense twin of its equations."""

from functools import lru_cache

import numpy as np
import pytest
from drake_box import PlayedBox
from numpy.linalg import matrix_power
from pydrake.systems.controllers import DiscreteTimeLinearQuadraticRegulator
from pydrake.systems.primitives import IsObservable, LinearSystem
from scipy.linalg import block_diag, solve_discrete_are

from ortilo_drake.loop.element import Values
from ortilo_drake.model.equations import rotation, translational_acceleration
from ortilo_drake.model.hover import discretize, hover_A, hover_B, hover_B_d
from ortilo_drake.model.measurement import PAPER, Measurement
from ortilo_drake.model.signals import N_X
from ortilo_drake.model.vehicle import GRAVITY, M100
from ortilo_drake.onboard.estimator.extra_states import Extra, augmented_rows, extra_states, gauss_markov
from ortilo_drake.onboard.estimator.filter_model import augmented_model, filter_model, initial_covariance
from ortilo_drake.onboard.estimator.imu_rows import with_imu_rows
from ortilo_drake.onboard.estimator.intermittent_filter import (
    INTEGRATORS,
    FilterModel,
    filter_gain,
    filter_step,
    intermittent_step,
    tilted_lift,
)
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.onboard.servo.lq_servo import servo_control
from ortilo_drake.scenario import Biases, DiagonalW, Imu, IntermittentFilter, LqServo, Walks
from ortilo_drake.theory.modes.modes import rescale, tick_scaling
from ortilo_drake.world.sensors.imu import imu_box

H = 1.0 / 30.0
M = M100.mass
PHI, GAMMA = discretize(hover_A(), hover_B(M100), H)
_, GAMMA_D = discretize(hover_A(), hover_B_d(M100), H)
HOVER = np.array([M100.hover_thrust, 0.0, 0.0, 0.0])
FORCES = ("thrust", "measured")
ALL = (*FORCES, "biases")  # the last is 'measured' with torque and gyroscope, and biases of both fixes and the imu
BIASES = Biases(uwb_sd=(0.05, 0.05, 0.12), camera_sd=(0.08,) * 3, level_sd=0.01, yaw_sd=0.03, imu_time=300.0)
V_OF = {"uwb": (0.05, 0.05, 0.08), "camera": (0.04, 0.03, 0.02), "imu": (0.01,) * 3, "accelerometer": (0.05,) * 3}
V_OF["gyroscope"] = (0.002, 0.001, 0.003)


def made(force: str, **settings: object) -> tuple[IntermittentFilter, tuple[Extra, ...], FilterModel, Measurement]:
    """Settings, extra states, model and measurement of a filter."""
    if force == "biases":
        walks = Walks(torque_sd=0.3, torque_rate=0.0007, gyroscope_sd=0.002, gyroscope_rate=0.00003)
        force, settings = "measured", {"rates": "measured", "biases": BIASES, "walks": walks, **settings}
    its = IntermittentFilter(force=force, **settings)
    extras = extra_states(its, M100, H)
    return its, extras, augmented_model(its, M100, its.integrator, H, extras), augmented_rows(PAPER, extras)


def all_V(measurement: Measurement) -> np.ndarray:
    return np.diag(np.concatenate([np.square(V_OF[s]) for s in measurement.sensors]))


def blocks(V: np.ndarray) -> np.ndarray:
    """The sensors' blocks, each row by row."""
    return np.concatenate([V[i : i + 3, i : i + 3].ravel() for i in range(0, len(V), 3)])


@lru_cache
def dense(force: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Phi, Gamma, W over [x; e] and C of all sensors, written down here once more.

    d' = d + w_d; x' = Phi x + Gamma u + Gamma_d (d + w); f' = d + f_T e_z + w; b' = b + w_b; y_a = f / m + b;
    n' = n + w_n, of which x' takes Gamma_n n; c' = c + w_c and y_g = rpy_dot + c;
    s' = e^(-h/20) s + w_s and y_uwb = p + s, likewise the camera; beta' = e^(-h/300) beta + w, rpy_imu = rpy + beta.
    """
    o, eye, e_z = np.zeros((3, 3)), np.eye(3), np.eye(3, 4, k=0)[[1, 2, 0]] * [[0.0], [0.0], [1.0]]
    G, Q = GAMMA_D[:, :3], np.diag([0.27**2] * 3 + [0.005**2] * 3)
    C_x = np.kron([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], eye) @ np.eye(6, 12)
    if force == "thrust":
        Phi = np.block([[PHI, G], [np.zeros((3, 12)), eye]])
        W = block_diag(GAMMA_D @ Q @ GAMMA_D.T, (0.011**2 * H) * eye)
        return Phi, np.vstack([GAMMA, np.zeros((3, 4))]), W, np.hstack([C_x, np.zeros((9, 3))])
    no = np.zeros((3, 12))
    Phi = np.block(
        [[PHI, G, np.zeros((12, 6))], [no, eye, o, o], [no, eye, o, o], [no, o, o, eye]],
    )
    Gamma = np.vstack([GAMMA, np.zeros((3, 4)), e_z, np.zeros((3, 4))])
    by_force = np.vstack([GAMMA_D, np.zeros((3, 6)), np.eye(3, 6), np.zeros((3, 6))])
    W = by_force @ Q @ by_force.T + block_diag(np.zeros((12, 12)), (0.011**2 * H) * eye, o, (0.0005**2 * H) * eye)
    C = np.vstack([np.hstack([C_x, np.zeros((9, 9))]), np.hstack([no, o, eye / M, eye])])
    if force == "biases":
        keeps = np.exp(-H / np.repeat([20.0, 300.0], [6, 3]))
        sd = np.array([0.05, 0.05, 0.12, 0.08, 0.08, 0.08, 0.01, 0.01, 0.03])
        Phi, W = (
            block_diag(Phi, eye, eye, np.diag(keeps)),
            block_diag(W, (0.0007**2 * H) * eye, (0.00003**2 * H) * eye, np.diag(sd**2 * (1.0 - keeps**2))),
        )
        Phi[:12, 21:24] = GAMMA_D[:, 3:]
        Gamma = np.vstack([Gamma, np.zeros((15, 4))])
        C = np.vstack([np.hstack([C, np.zeros((12, 6)), np.eye(12, 9)]), np.zeros((3, 36))])
        C[12:, 9:12], C[12:, 24:27] = eye, eye
    return Phi, Gamma, W, C


@pytest.mark.parametrize("force", ALL)
def test_the_model_is_the_equations_of_the_force_state(force: str) -> None:
    _, _, model, measurement = made(force)
    for mine, expected in zip((model.Phi, model.Gamma, model.W, measurement.layout.C), dense(force), strict=True):
        np.testing.assert_allclose(mine, expected, rtol=1e-13, atol=1e-18)
    # Gamma_d = (h^2/2, h)/m on position and velocity
    np.testing.assert_allclose(model.Phi[:3, 12:15], H**2 / 2.0 / M * np.eye(3), rtol=1e-13)
    np.testing.assert_allclose(model.Phi[6:9, 12:15], H / M * np.eye(3), rtol=1e-13)


def test_without_a_force_the_model_is_the_papers() -> None:
    its, extras, model, measurement = made("none")
    paper = filter_model(its, M100, its.integrator, H)
    assert extras == ()
    assert len(model.Phi) == N_X
    assert measurement.outputs == Measurement(PAPER).outputs
    assert model.structure is not None
    assert paper.structure is not None
    for mine, papers in zip((*model[:-1], *model.structure), (*paper[:-1], *paper.structure), strict=True):
        np.testing.assert_array_equal(mine, papers)


@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize(
    ("sensors", "observable"),
    [(("uwb", "imu"), True), (("camera", "imu"), True), (("uwb", "camera", "imu"), True), (("imu",), False)],
)
def test_the_force_is_observable_with_fixes_and_not_without(
    force: str, sensors: tuple[str, ...], observable: bool
) -> None:
    _, _, model, measurement = made(force)
    seen = [j for s in (*sensors, *measurement.sensors[3:]) for j in range(*measurement.rows_of(s).indices(99))]
    # In units of ticks, the force as what it accelerates in one: Drake judges the rank by the entries' size.
    scale = np.concatenate([tick_scaling(H), np.full(len(model.Phi) - N_X, 1.0 / H**2)])
    Phi, C = rescale(model.Phi, measurement.layout.C[seen], scale)
    n, m = len(Phi), len(C)
    system = LinearSystem(Phi, np.zeros((n, 1)), C, np.zeros((m, 1)), H)
    assert IsObservable(system) == observable
    if not observable:  # position, velocity and force stay unknown in each axis; the accelerometer adds f/m + b alone
        rank = np.linalg.matrix_rank(np.vstack([C @ matrix_power(Phi, k) for k in range(n)]))
        assert rank == n - 9


@pytest.mark.parametrize("force", ALL)
def test_with_all_sensors_the_covariance_settles_at_the_solution_of_the_dare(force: str) -> None:
    walks = Walks(force_rate=0.11, accelerometer_rate=0.055, gyroscope_rate=0.01)
    times = {"uwb_time": 2.0, "camera_time": 2.0, "imu_time": 3.0}
    fast = {"biases": BIASES.model_copy(update=times)} if force == "biases" else {}
    its, extras, model, measurement = made(force, walks=walks, integrator="estimate", **fast)
    N = len(model.Phi)
    V, layout = all_V(measurement), measurement.layout
    belief = np.concatenate([np.zeros(N + 3), initial_covariance(its, extras).ravel()])
    y, delta = np.zeros(len(V)), np.ones(len(measurement.sensors))
    for _ in range(4000):
        belief = filter_step(belief, y, delta, blocks(V), np.zeros(4), np.zeros(3), model, layout)
    P = belief[N + 3 :].reshape(N + 3, N + 3)
    expected = solve_discrete_are(model.Phi.T, layout.C.T, model.W, V)
    sd = np.sqrt(np.diag(expected))
    np.testing.assert_allclose(P[:N, :N] / np.outer(sd, sd), expected / np.outer(sd, sd), rtol=0.0, atol=1e-7)
    # Drake's regulator is dual to the predictor; its check wants W definite.
    W = model.W + 1e-12 * np.eye(N)
    K = filter_gain(P, delta, blocks(V), model.Phi, model.integrator, layout)[:N]
    dual, _ = DiscreteTimeLinearQuadraticRegulator(model.Phi.T, layout.C.T, W, V)
    np.testing.assert_allclose(K, dual.T, rtol=0.0, atol=1e-4 * np.max(np.abs(K)))


def test_without_fixes_an_unknown_force_makes_the_position_uncertain_with_the_fourth_power_of_time() -> None:
    still = Walks(force_sd=0.5, force_rate=0.0)
    W = DiagonalW(kind="diagonal", position=0.0, angle=0.0, velocity=0.0, rate=0.0)
    its, extras, model, measurement = made("thrust", walks=still, W=W)
    P = initial_covariance(its, extras)
    P[:12] = 0.0
    belief = np.concatenate([np.zeros(18), P.ravel()])
    y, delta = np.zeros(9), np.zeros(3)
    for k in range(1, 343):
        given = np.zeros(4), np.zeros(3), model, measurement.layout
        belief = filter_step(belief, y, delta, np.zeros(27), *given)
        P, t = belief[18:].reshape(18, 18), k * H
        np.testing.assert_allclose(np.diag(P)[:3], (0.5 * t**2 / 2.0 / M) ** 2, rtol=1e-10)
        np.testing.assert_allclose(np.diag(P)[12:15], 0.25, rtol=1e-12)  # the force is held


def offset(force: str, integrator: str, integral: bool, told: bool = True) -> np.ndarray:
    """Where the position ends under a force of 0.3, -0.5 and 0.8 N, by simulation of servo and filter, and by the
    final value of the loop's matrices; the two are compared here."""
    d = np.array([0.3, -0.5, 0.8])
    walks = Walks(force_rate=0.1, accelerometer_rate=0.01)  # quick ones, to be at rest in 200 s
    its, extras, model, measurement = made(force, integrator=integrator, walks=walks)
    N, layout = len(model.Phi), measurement.layout
    L = servo_gain(M100, LqServo().weights, H)
    if not integral:
        L[:, 12:] = 0.0
    V, delta = blocks(all_V(measurement)), np.ones(len(measurement.sensors))
    paper = FilterModel.of(model.Phi, model.Gamma, model.W, model.integrator, 0.0 * model.Gamma_a)
    belief = np.concatenate([np.zeros(N + 3), initial_covariance(its, extras).ravel()])
    x, f = np.zeros(12), np.zeros(3)
    for _ in range(6000):
        xbar = np.concatenate([belief[:12], belief[N : N + 3]])
        known = belief[12:15] if extras and told else np.zeros(3)
        u = servo_control(xbar, np.zeros(9), L, M, 0.0, True, known) - HOVER
        y = measurement.layout.C[:, :12] @ x
        if force == "measured":
            y[9:] = f / M
        belief = filter_step(belief, y, delta, V, u, np.zeros(3), paper, layout)
        x, f = PHI @ x + GAMMA @ u + GAMMA_D[:, :3] @ d, d + u[0] * np.array([0.0, 0.0, 1.0])
    # z = [x; e_hat; i]: u = -L [xhat; i] - F dhat, and z' = A z + B d; at rest z = (I - A)^-1 B d
    P = belief[N + 3 :].reshape(N + 3, N + 3)
    if force != "measured":
        K = filter_gain(P, delta, V, model.Phi, model.integrator, layout)[:N]
        F = np.zeros((4, N))
        F[:, :12] = L[:, :12]
        if extras and told:  # the servo's tilt and lift against d: theta = -d_x / (m g), phi = d_y / (m g), f_T = -d_z
            tilt = np.zeros((12, 3))
            tilt[4, 0], tilt[3, 1] = -1.0 / (M * GRAVITY), 1.0 / (M * GRAVITY)
            F[:, 12:15] = -L[:, :12] @ tilt
            F[0, 14] += 1.0
        C, C_x = layout.C, layout.C[:, :12]
        p_hat, p = np.eye(3, N), np.eye(3, 12)
        i_rows = [np.zeros((3, 12)), -p_hat] if integrator == "estimate" else [-p, np.zeros((3, N))]
        A = np.block([
            [PHI, -GAMMA @ F, -GAMMA @ L[:, 12:]],
            [K @ C_x, model.Phi - K @ C - model.Gamma @ F, -model.Gamma @ L[:, 12:]],
            [*i_rows, np.eye(3)],
        ])  # fmt: skip
        if not integral:
            A = A[:-3, :-3]
        assert np.max(np.abs(np.linalg.eigvals(A))) < 1.0
        B = np.vstack([GAMMA_D[:, :3], np.zeros((len(A) - 12, 3))])
        final = np.linalg.solve(np.eye(len(A)) - A, B @ d)
        np.testing.assert_allclose(x, final[:12], rtol=0.0, atol=2e-6)
    return x[:3]


@pytest.mark.family
@pytest.mark.parametrize("force", FORCES)
@pytest.mark.parametrize(("integrator", "integral"), [("estimate", True), ("estimate", False), ("hold", True)])
def test_a_constant_force_leaves_no_offset(force: str, integrator: str, integral: bool) -> None:
    np.testing.assert_allclose(offset(force, integrator, integral), 0.0, atol=1e-6)


@pytest.mark.long
def test_a_constant_force_leaves_an_offset_where_it_is_not_known_or_not_countered() -> None:
    # Without a force state the estimate is off, and an integral of the estimate's error does not see that.
    assert np.all(np.abs(offset("none", "estimate", True)) > 5e-3)
    assert np.all(np.abs(offset("none", "estimate", False)) > 0.02)
    # The estimate alone does not help a servo without an integral.
    assert np.all(np.abs(offset("thrust", "estimate", False, told=False)) > 0.02)


def twin_step(
    xbar: np.ndarray, P: np.ndarray, y: np.ndarray, delta: np.ndarray, V: np.ndarray, u: np.ndarray, r: np.ndarray,
    force: str, integrator: str,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """The paper's filter over [x; e; i], at full size, with rows masked and the lift tilted."""
    Phi, Gamma, W, C = dense(force)
    N, p = len(Phi), len(C)
    Delta, E = np.diag(np.repeat(delta, 3)), np.zeros((3, p))
    if integrator != "estimate" and (delta[0] or delta[1]):
        first = 0 if delta[0] else 3
        E[:, first : first + 3] = np.eye(3)
    Phibar = np.block([[Phi, np.zeros((N, 3))], [-E @ C, np.eye(3)]])
    Ebar, V1 = block_diag(np.eye(N), -E), block_diag(W, V)
    V12 = np.vstack([np.zeros((N, p)), V])
    Hk = Delta @ np.hstack([C, np.zeros((p, 3))])
    cross = Hk @ P @ Phibar.T + V12.T @ Ebar.T
    K = np.linalg.solve(Hk @ P @ Hk.T + V, Delta @ cross).T
    P_next = Phibar @ P @ Phibar.T + Ebar @ V1 @ Ebar.T - K @ cross
    # a = (f_T + d_z) / m z_B - g, in place of the hover model's g theta, -g phi, u_0 / m + d_z / m
    a = (M * GRAVITY + u[0] + xbar[14]) / M * rotation(xbar[3:6])[:, 2]
    a = a - [GRAVITY * xbar[4], -GRAVITY * xbar[3], GRAVITY + (u[0] + xbar[14]) / M]
    tilt = np.concatenate([H**2 / 2.0 * a, np.zeros(3), H * a, np.zeros(N - 9 + 3)])
    step = Phibar @ xbar + np.concatenate([Gamma @ u, np.zeros(3)]) + tilt + K @ (Delta @ y - Hk @ xbar)
    if integrator == "estimate":
        step[N:] += r - xbar[:3]
    elif integrator == "literal" or E.any():
        step[N:] += r
    return step, (P_next + P_next.T) / 2.0


@pytest.mark.family
@pytest.mark.parametrize(
    ("steps", "integrator", "force"),
    [
        *((60, name, force) for name in INTEGRATORS for force in ALL),
        pytest.param(20_000, "hold", "biases", marks=pytest.mark.long),  # 'biases' has all the states
    ],
)
def test_a_dense_twin_over_thousands_of_random_steps(steps: int, integrator: str, force: str) -> None:
    # Each runs on its own values from first to last: the comparison never re-synchronises them.
    its, extras, model, measurement = made(force, integrator=integrator)
    rng, N, layout = np.random.default_rng(21), len(model.Phi), measurement.layout
    p, s, n = len(layout.C), len(measurement.sensors), N + 3
    P = initial_covariance(its, extras)
    xbar = np.concatenate([0.1 * rng.normal(size=N), np.zeros(3)])
    belief, x_lines, P_lines = np.concatenate([xbar, P.ravel()]), xbar, P
    rates, scale = np.array([0.3, 0.3, 0.8, 0.8, 0.8])[:s], np.repeat([0.3, 0.3, 0.05, 0.2, 0.1], 3)[:p]
    several = [block_diag(*[sd**2 * _spd(rng) for sd in (0.1, 0.15, 0.01, 0.05, 0.02)[:s]]) for _ in range(7)]
    V2 = [blocks(V) for V in several]
    for k in range(steps):
        delta, V = (rng.random(s) < rates).astype(float), several[k % 7]
        y, u, r = rng.normal(size=p) * scale, rng.normal(size=4) * [2.0, 0.01, 0.01, 0.01], 0.1 * rng.normal(size=3)
        given = y, delta, V2[k % 7], u, r, model, layout
        belief = filter_step(belief, *given)
        xbar, P = twin_step(xbar, P, y, delta, V, u, r, force, integrator)
        mine = belief[n:].reshape(n, n)
        assert np.max(np.abs(belief[:n] - xbar)) < 1e-8 * max(1.0, np.max(np.abs(xbar))), k
        assert np.max(np.abs(mine - P)) < 1e-9 * np.max(np.abs(P)), k
        assert np.max(np.abs(mine[N:])) < 1e-20, k  # the integral is known as before
        if k < 300:
            x_lines, P_lines, _ = intermittent_step(x_lines, P_lines, *given)
            np.testing.assert_allclose(belief[:n], x_lines, rtol=0.0, atol=1e-9 * max(1.0, np.abs(x_lines).max()))
            np.testing.assert_allclose(mine, P_lines, rtol=0.0, atol=1e-9 * np.abs(P_lines).max())
        if k % 50 == 0:
            assert np.array_equal(mine, mine.T)
            assert np.linalg.eigvalsh(mine)[0] > -1e-15 * np.max(mine), k
            gain = filter_gain(mine, delta, V2[k % 7], model.Phi, model.integrator, layout)
            E = np.zeros((3, p))
            if integrator != "estimate" and (delta[0] or delta[1]):
                E[:, :3] = np.eye(3) * delta[0]
                E[:, 3:6] = np.eye(3) * (1.0 - delta[0])
            np.testing.assert_allclose(gain[N:], -E, atol=1e-9)


def _spd(rng: np.random.Generator) -> np.ndarray:
    Q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    V = Q @ np.diag(rng.uniform(0.3, 3.0, 3)) @ Q.T
    return np.asarray((V + V.T) / 2.0)


def test_a_wrong_mass_is_a_vertical_force_whatever_the_tilt() -> None:
    """The lift of a vehicle 10 % heavier, thrust for thrust, is that of the believed mass with a force along z_B."""
    rng = np.random.default_rng(22)
    for _ in range(20):
        x, f_T, heavier = 0.3 * rng.normal(size=12), 26.0 + rng.normal(), 1.1 * M
        true = translational_acceleration(x, np.array([f_T, 0.0, 0.0, 0.0]), np.zeros(6), heavier)
        d_z = f_T * (M / heavier - 1.0)  # (f_T + d_z) / m = f_T / heavier
        xbar = np.concatenate([x, [0.0, 0.0, d_z], np.zeros(3)])
        u = np.array([f_T - M * GRAVITY, 0.0, 0.0, 0.0])
        yaw = rng.uniform(-np.pi, np.pi)
        hover = hover_A(yaw)[6:9] @ x + [0.0, 0.0, (u[0] + d_z) / M]
        np.testing.assert_allclose(hover + tilted_lift(xbar, u, M, yaw), true, atol=1e-12)


def imu_message(x: np.ndarray, u: np.ndarray, d: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """Return what an imu without noise says."""
    box = imu_box(Imu(angle_density=0.0, rate_density=0.0, specific_force_density=0.0), H, whole=True)
    v_dot = np.array(translational_acceleration(x, u, d, M))
    imu = PlayedBox(box, H, sent=np.zeros(1), state=x, acceleration=v_dot)
    imu.system.give(imu.context, {"imu": Values(tables={"bias": bias})})
    return imu.say(15)


def test_the_accelerometers_rows_are_the_force_less_the_hover_lift() -> None:
    rng, zero = np.random.default_rng(23), np.zeros(3)
    for tilt in (1e-3, 1e-2, 1e-1):
        x = np.concatenate([rng.normal(size=3), tilt * rng.normal(size=2), rng.normal(size=7)])
        force, b = 0.5 * rng.normal(size=3), 0.1 * rng.normal(size=3)
        u, bias = np.array([27.5, 0.0, 0.0, 0.0]), np.concatenate([np.zeros(6), b])
        imu = imu_message(x, u, np.concatenate([force, zero]), bias)
        y, delta, V2 = np.arange(9.0), np.array([0.0, 0.0, 1.0]), np.arange(27.0)
        y_all, delta_all, V2_all = with_imu_rows(y, delta, V2, imu, 2, np.array([1.0, 2.0, 3.0]))
        f = force + [0.0, 0.0, u[0] - M * GRAVITY]
        c, s = np.cos(x[5]), np.sin(x[5])
        expected = f / M + [c * b[0] - s * b[1], s * b[0] + c * b[1], b[2]]
        # To first order in the tilt; what is left is the force turned, and nothing of gravity or lift.
        np.testing.assert_allclose(y_all[9:], expected, rtol=0.0, atol=3.0 * tilt * np.abs(force).max() / M)
        np.testing.assert_array_equal(y_all[:9], y)
        np.testing.assert_array_equal(V2_all[27:].reshape(3, 3), np.diag([1.0, 2.0, 3.0]))
        assert delta_all.tolist() == [0.0, 0.0, 1.0, 1.0]
    _, delta_all, _ = with_imu_rows(y, np.array([1.0, 1.0, 0.0]), V2, imu, 2, np.ones(3))
    assert delta_all.tolist() == [1.0, 1.0, 0.0, 0.0]


def test_the_gyroscopes_rows_are_the_euler_rates_at_any_attitude() -> None:
    """R_WB' = R_WB [w]_x, by central differences of the rotation along the angles' motion; biases add as body rates."""
    rng = np.random.default_rng(29)
    for _ in range(20):
        x = np.concatenate([rng.normal(size=3), rng.uniform(-1.2, 1.2, 3), rng.normal(size=6)])
        step = 1e-6
        R_dot = (rotation(x[3:6] + step * x[9:12]) - rotation(x[3:6] - step * x[9:12])) / (2.0 * step)
        cross = rotation(x[3:6]).T @ R_dot
        w = np.array([cross[2, 1], cross[0, 2], cross[1, 0]])
        imu = imu_message(x, HOVER, np.zeros(6), np.zeros(9))
        np.testing.assert_allclose(imu[5:8], w, rtol=0.0, atol=1e-8)
        y, delta, V2 = np.arange(9.0), np.array([0.0, 0.0, 1.0]), np.arange(27.0)
        y_all, delta_all, V2_all = with_imu_rows(y, delta, V2, imu, 2, np.arange(1.0, 7.0))
        np.testing.assert_allclose(y_all[12:], x[9:12], rtol=0.0, atol=1e-12)
        np.testing.assert_array_equal(V2_all[36:].reshape(3, 3), np.diag([4.0, 5.0, 6.0]))
        assert delta_all.tolist() == [0.0, 0.0, 1.0, 1.0, 1.0]


@pytest.mark.parametrize(("sensor", "sd"), [("uwb", 0.05), ("camera", 0.08)])
def test_no_number_of_fixes_tells_the_position_better_than_their_bias(sensor: str, sd: float) -> None:
    """At rest, one constant bias and white noise: P_n = P_0 - P_0^2 / (P_0 + sd^2 + v^2 / n), all at once."""
    biases = Biases(**{f"{sensor}_sd": (sd,) * 3}, uwb_time=1e9, camera_time=1e9)
    W = DiagonalW(kind="diagonal", position=0.0, angle=0.0, velocity=0.0, rate=0.0)
    its, extras, model, measurement = made("thrust", biases=biases, W=W, walks=Walks(force_sd=0.0, force_rate=0.0))
    P_0, v, layout = 0.3**2, 0.1, measurement.layout
    P = initial_covariance(its, extras)
    P[:15, :15] = np.diag([P_0] * 3 + [0.0] * 12)
    n = len(P)
    delta = np.array([float(s == sensor) for s in measurement.sensors])
    V, belief = blocks(v**2 * np.eye(9)), np.concatenate([np.zeros(n), P.ravel()])
    for k in range(1, 501):
        belief = filter_step(belief, np.zeros(9), delta, V, np.zeros(4), np.zeros(3), model, layout)
        expected = P_0 - P_0**2 / (P_0 + sd**2 + v**2 / k)
        np.testing.assert_allclose(np.diag(belief[n:].reshape(n, n))[:3], expected, rtol=1e-6)
    assert expected > 0.9 * sd**2  # without the bias it would be v^2 / n, a tenth of that


def test_the_first_specific_force_is_shared_between_force_and_bias_by_their_variances() -> None:
    """A vehicle heavier than believed shows at once: y_a = d / m + b + v, of which b takes sd_b^2 / (sum of all)."""
    its, extras, model, measurement = made("measured", walks=Walks(force_sd=1.5, accelerometer_sd=0.2))
    P = initial_covariance(its, extras)
    np.testing.assert_array_equal(P[12:15, 15:18], 1.5**2 * np.eye(3))
    np.testing.assert_array_equal(P[15:18, 15:18], 1.5**2 * np.eye(3))
    n, y = len(P), np.array([0.0] * 9 + [0.1, -0.2, -0.89])
    given = np.array([0.0, 0.0, 0.0, 1.0]), blocks(all_V(measurement)), np.zeros(4), np.zeros(3)
    after = filter_step(np.concatenate([np.zeros(n), P.ravel()]), y, *given, model, measurement.layout)
    S = 0.2**2 + (1.5 / M) ** 2 + 0.05**2
    np.testing.assert_allclose(after[18:21], y[9:] * 0.2**2 / S, rtol=1e-9)
    np.testing.assert_allclose(after[12:15], y[9:] * 1.5**2 / M / S, rtol=1e-9)


def test_a_gauss_markov_process_keeps_its_variance() -> None:
    walk = gauss_markov(0.08, 20.0, H)
    np.testing.assert_allclose(walk.keeps**2 * walk.initial_sd**2 + walk.step_sd**2, 0.08**2, rtol=1e-12)
    np.testing.assert_allclose(walk.keeps ** (20.0 / H), np.exp(-1.0), rtol=1e-9)
