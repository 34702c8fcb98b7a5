"""Lost commands: second moments against closed forms, Kronecker products, SciPy and the very diagram that flies."""

import json
import math

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from scipy.linalg import block_diag, solve_discrete_lyapunov
from scipy.signal import cont2discrete

from ortilo_drake.diagrams.closed_loop import make_closed_loop
from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATOR_ESTIMATE, FilterModel, filter_step
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, servo_gain, weight_matrices
from ortilo_drake.scenario import CommandLink, GilbertElliottLoss, NoLoss, Scenario, ServoWeights, load_scenario
from ortilo_drake.scenario.loss_chain import loss_chain, loss_of, loss_parameters
from ortilo_drake.studies.command_link import command_report as module
from ortilo_drake.studies.command_link.command_loop import (
    CommandedLoop,
    behind_a_link,
    commanded_loop,
    periodic_predictor,
    schedule,
)
from ortilo_drake.studies.command_link.command_report import (
    acknowledged_loop,
    critical_delay,
    delay_growth,
    delayed_matrices,
    growth,
    largest_acknowledged_loss,
    largest_loss,
    lossy_loop,
)
from ortilo_drake.studies.loop.hover_loop import closed_loop_matrix, hover_loop, steady_predictor
from ortilo_drake.theory.jump_linear.jump_linear import JumpLinear, mean_square_radius, steady_second_moment
from ortilo_drake.theory.lossy_control.lossy_gain import acknowledged_gain
from ortilo_drake.world.noise import stream_id
from ortilo_drake.world.radio.command_link import is_lost

V = block_diag(np.diag([0.015, 0.018, 0.04]) ** 2, np.eye(3), 1e-4 * np.eye(3))
EVERY_TICK = np.array([[1.0, 0.0, 1.0]])
SCENARIO = load_scenario("nominal_imu_uwb")


def scalar_loop(a: float, b: float, gain: float) -> CommandedLoop:
    """x+ = a x + b u, u = -gain x, with noise of variance 1."""
    return CommandedLoop(a * np.ones((1, 1, 1)), b * np.ones((1, 1)), gain * np.ones((1, 1)), np.ones((1, 1, 1)))


def lossy(
    loop: CommandedLoop, share: float, when_lost: str = "hold", burst: float | None = None, delay: int = 0
) -> JumpLinear:
    return lossy_loop(loop, CommandLink(loss=loss_of(share, burst), when_lost=when_lost, delay=delay), 1.0 / 30.0)


def random_system(n: int, patterns: int, modes: int, period: int = 1, seed: int = 0) -> JumpLinear:
    rng = np.random.default_rng(seed)
    chance, transition = rng.random((modes, patterns)), rng.random((modes, modes))
    root = rng.normal(size=(period, n, n))
    return JumpLinear(
        rng.normal(size=(period, patterns, n, n)) / np.sqrt(3 * n),
        root @ root.transpose(0, 2, 1),
        chance / chance.sum(axis=1, keepdims=True),
        transition / transition.sum(axis=1, keepdims=True),
    )


def kronecker(system: JumpLinear) -> list[np.ndarray]:
    """The operator's matrix of each tick as Costa and others write it, (Pi^T kron I) diag(sum_p Pr A kron A)."""
    n = system.A.shape[-1]
    return [
        np.kron(system.transition.T, np.eye(n * n))
        @ block_diag(*[sum(c * np.kron(A, A) for c, A in zip(row, A_k, strict=True)) for row in system.chance])
        for A_k in system.A
    ]


# --- the operator ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n", "patterns", "modes", "period"), [(3, 2, 1, 1), (3, 2, 2, 2), (12, 2, 1, 1), (12, 3, 2, 3)]
)
@pytest.mark.parametrize("largest_dense", [0, 10_000])
def test_the_radius_is_that_of_the_kronecker_products(n, patterns, modes, period, largest_dense) -> None:
    if modes * n * (n + 1) // 2 <= 60:
        largest_dense = 10_000  # too few for ARPACK
    for seed in range(3):
        system = random_system(n, patterns, modes, period, seed)
        product = np.linalg.multi_dot([np.eye(modes * n * n), *kronecker(system)[::-1]])
        radius = np.max(np.abs(np.linalg.eigvals(product))) ** (1 / period)
        assert mean_square_radius(system, largest_dense) == pytest.approx(radius, rel=1e-8)


def test_a_scalar_chain_has_the_two_by_two_matrix_of_costa() -> None:
    # Theorem: the radius of transition^T diag(a_i^2); here with roots of a quadratic.
    a, b, good, bad = 0.1, 0.4, 0.7, 1.3
    system = JumpLinear(
        np.array([[[[good]], [[bad]]]]), np.ones((1, 1, 1)), np.eye(2), np.array([[1 - a, a], [b, 1 - b]])
    )
    trace, determinant = (1 - a) * good**2 + (1 - b) * bad**2, (1 - a - b) * good**2 * bad**2
    assert mean_square_radius(system) == pytest.approx((trace + math.sqrt(trace**2 - 4 * determinant)) / 2, rel=1e-12)


@pytest.mark.family
@pytest.mark.parametrize(("modes", "period"), [(1, 1), (2, 1), (2, 3)])
def test_the_steady_moment_solves_the_linear_equations(modes: int, period: int) -> None:
    system = random_system(4, 2, modes, period, 7)
    assert mean_square_radius(system) < 0.9
    values, vectors = np.linalg.eig(system.transition.T)
    pi = np.real(vectors[:, np.argmax(values.real)])
    pi /= pi.sum()
    # One period lifted: s' = M s + m, m gathering the noise of each tick carried to the end.
    M, m = np.eye(16 * modes), np.zeros(16 * modes)
    for K, N in zip(kronecker(system), system.N, strict=True):
        M, m = K @ M, K @ m + np.kron(system.transition.T @ pi, N.ravel())
    S = np.linalg.solve(np.eye(len(m)) - M, m).reshape(modes, 4, 4).sum(axis=0)
    np.testing.assert_allclose(steady_second_moment(system)[0], S, rtol=1e-7)


def test_no_loss_is_scipys_lyapunov_equation() -> None:
    loop = commanded_loop(SCENARIO, V, EVERY_TICK)
    expected = solve_discrete_lyapunov(closed_loop_matrix_of(SCENARIO), loop.N[0])
    np.testing.assert_allclose(steady_second_moment(lossy(loop, 0.0, "zero"))[0], expected, rtol=1e-6, atol=1e-9)


# --- closed forms of a scalar loop -------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 1.0])
def test_zero_of_a_scalar_loop(share: float) -> None:
    a, b, gain = 1.2, 0.5, 1.8
    closed = a - b * gain
    rate = (1 - share) * closed**2 + share * a**2
    system = lossy(scalar_loop(a, b, gain), share, "zero")
    assert mean_square_radius(system) == pytest.approx(rate, rel=1e-12)
    if rate < 1:
        assert steady_second_moment(system)[0, 0, 0] == pytest.approx(1 / (1 - rate), rel=1e-8)
    else:
        with pytest.raises(InputError, match="second moment: grows"):
            steady_second_moment(system)


@pytest.mark.parametrize("delay", [0, 1])
@pytest.mark.parametrize("share", [0.0, 0.2, 0.7])
def test_hold_of_a_scalar_loop(share: float, delay: int) -> None:
    a, b, gain = 1.2, 0.5, 1.0
    if delay == 0:  # [x, last applied]
        there, gone = [[a - b * gain, 0], [-gain, 0]], [[a, b], [0, 1]]
    else:  # [x, last applied, last command]
        there, gone = [[a, 0, b], [0, 0, 1], [-gain, 0, 0]], [[a, b, 0], [0, 1, 0], [-gain, 0, 0]]
    matrix = (1 - share) * np.kron(there, there) + share * np.kron(gone, gone)
    radius = np.max(np.abs(np.linalg.eigvals(matrix)))
    assert mean_square_radius(lossy(scalar_loop(a, b, gain), share, "hold", delay=delay)) == pytest.approx(
        radius, rel=1e-9
    )


@pytest.mark.long
def test_bursts_of_their_own_mean_length_are_independent_losses() -> None:
    # A chain that loses in its bad state with a = 1 - b is memoryless.
    share = 0.3
    for when_lost in ("hold", "zero"):
        loop = scalar_loop(1.2, 0.5, 1.0)
        bursts = lossy(loop, share, when_lost, burst=1 / (1 - share))
        assert mean_square_radius(bursts) == pytest.approx(mean_square_radius(lossy(loop, share, when_lost)), rel=1e-9)
        moments = [steady_second_moment(s)[0] for s in (bursts, lossy(loop, share, when_lost))]
        np.testing.assert_allclose(*moments, rtol=1e-7)


def test_a_chain_that_never_turns_bad_is_independent_loss() -> None:
    transition, lost = loss_chain(
        GilbertElliottLoss(kind="gilbert_elliott", good_to_bad=0.0, bad_to_good=0.2, loss_good=0.1),
        1.0 / 30.0,
    )
    np.testing.assert_allclose(lost, [0.1])
    np.testing.assert_allclose(transition, [[1.0]])
    np.testing.assert_allclose(loss_chain(NoLoss(), 1.0 / 30.0)[1], [0.0])


# --- the flying loop ---------------------------------------------------------------------------------------------


def closed_loop_matrix_of(scenario: Scenario) -> np.ndarray:
    loop = hover_loop(scenario)
    seen = [0, 1, 2, 6, 7, 8]
    K = np.zeros((12, 9))
    K[:, seen], _ = steady_predictor(loop.Phi, loop.C[seen], loop.W, V[np.ix_(seen, seen)])
    return closed_loop_matrix(loop, K, EVERY_TICK[0])


@pytest.mark.parametrize("integrator", ["hold", "literal", "estimate"])
def test_with_a_perfect_link_it_is_the_closed_loop(integrator: str) -> None:
    scenario = load_scenario("nominal_imu_uwb", (f"estimator.integrator={integrator}",))
    A, _ = behind_a_link(commanded_loop(scenario, V, EVERY_TICK), "zero")
    np.testing.assert_allclose(A[0, 0], closed_loop_matrix_of(scenario), rtol=1e-7, atol=1e-12)


def test_borrowed_velocities_close_the_loop_past_the_filter() -> None:
    scenario = load_scenario("nominal_imu_uwb", ("servo.velocities=truth",))
    loop = hover_loop(scenario)
    A, _ = behind_a_link(commanded_loop(scenario, V, EVERY_TICK), "zero")
    x, xhat, i = np.random.default_rng(2).normal(size=27)[:12], np.arange(12.0), np.ones(3)
    u = -loop.L @ np.concatenate([xhat[:6], x[6:], i])
    after = A[0, 0] @ np.concatenate([x, xhat, i])
    np.testing.assert_allclose(after[:12], loop.Phi @ x + loop.Gamma @ u, rtol=1e-9, atol=1e-9)
    without = closed_loop_matrix_of(load_scenario("nominal_imu_uwb"))[12:24] @ np.concatenate([x, xhat, i])
    believed = without + loop.Gamma @ (u + loop.L @ np.concatenate([xhat, i]))
    np.testing.assert_allclose(after[12:24], believed, rtol=1e-7, atol=1e-7)


def test_the_periodic_filter_is_the_one_that_flies() -> None:
    loop, deltas = hover_loop(SCENARIO), schedule(SCENARIO)
    np.testing.assert_array_equal(deltas, [[1, 0, 1], [0, 0, 1], [0, 0, 1]])
    _, Ps = periodic_predictor(loop.Phi, loop.C, loop.W, V, np.repeat(deltas, 3, axis=1))
    belief = np.concatenate([np.zeros(15), np.diag([0.01] * 12 + [0.0] * 3).ravel()])
    model = FilterModel.of(loop.Phi, loop.Gamma, loop.W, INTEGRATOR_ESTIMATE)
    V2 = np.concatenate([V[j : j + 3, j : j + 3].ravel() for j in (0, 3, 6)])
    flown = []
    for k in range(3003):
        flown.append(belief[15:].reshape(15, 15)[:12, :12])
        given = np.zeros(9), deltas[k % 3], V2, np.zeros(4), np.zeros(3)
        belief = filter_step(belief, *given, model, loop.measurement.layout)
    for k in range(3):
        np.testing.assert_allclose(Ps[k], flown[3000 + k], rtol=1e-8, atol=1e-14)


CALM = (
    "world.kinematics=linear",
    "world.disturbance={force_density: 0, torque_density: 0}",
    "imu={angle_density: 0, rate_density: 0, specific_force_density: 0}",
    "uwb.noise={kind: proportional, fraction: 0}",
    "planner={kind: hover, point: [8, 1, 1.5], duration: 3}",
)


@pytest.mark.family
@pytest.mark.parametrize(("when_lost", "delay"), [("hold", 0), ("zero", 0), ("hold", 2), ("zero", 1)])
def test_the_matrices_are_the_diagram_that_flies(when_lost: str, delay: int) -> None:
    link = ("command_link.loss={kind: bernoulli, probability: 0.4}", f"command_link.when_lost={when_lost}")
    scenario = load_scenario("nominal_imu_uwb", (*CALM, *link, f"command_link.delay={delay}"), seed=3)
    diagram = make_closed_loop(scenario)
    simulator = Simulator(diagram)
    context = simulator.get_mutable_context()
    x_0 = np.array([0.05, -0.04, 0.03, 0.01, -0.02, 0.01, 0.02, 0.01, -0.02, 0.02, 0.01, -0.01])
    r = np.concatenate([[8.0, 1.0, 1.5], np.zeros(9)])
    diagram.GetSubsystemByName("world").SetState(context, r + x_0)
    ticks = 90
    simulator.AdvanceTo((ticks - 0.5) * scenario.h)
    log = diagram.GetSubsystemByName("log").FindLog(context).data().T
    states, measurements = log[:, :12], log[:, 16:55]
    covariances = log[:, 55 + 15 : 55 + 15 + 225].reshape(-1, 15, 15)

    loop = hover_loop(scenario)
    calm = commanded_loop(scenario, V)
    loss, stream = loss_parameters(scenario.command_link.loss, scenario.h), stream_id("link/command")
    lost = [k < delay or is_lost(k - delay, False, loss, 3, stream) for k in range(ticks)]
    assert 20 < sum(lost) < 60
    A, _ = behind_a_link(calm, when_lost, delay)
    z = np.zeros(A.shape[-1])
    z[:12] = x_0
    for k in range(ticks):
        np.testing.assert_allclose(z[:12], states[k] - r, rtol=0, atol=2e-9)  # the solver of ranges stops at 1e-9
        delta, P = measurements[k, 9:12], covariances[k, :12, :12]
        there = np.repeat(delta, 3) > 0
        V_k = block_diag(*measurements[k, 12:].reshape(3, 3, 3))[np.ix_(there, there)]
        K, H = np.zeros((12, 9)), loop.C[there]
        K[:, there] = np.linalg.solve(H @ P @ H.T + V_k, H @ P @ loop.Phi.T).T  # the gain is not yet the steady one
        F = closed_loop_matrix(loop, K, delta) + calm.G @ calm.L
        A, _ = behind_a_link(calm._replace(F=F[np.newaxis], N=calm.N[:1]), when_lost, delay)
        z = A[0, int(lost[k])] @ z
    assert np.linalg.norm(states[-1] - r) > 1e-3


@pytest.mark.long
@pytest.mark.parametrize("when_lost", ["hold", "zero"])
def test_the_largest_loss_is_where_the_radius_crosses_one(when_lost: str) -> None:
    loop = commanded_loop(SCENARIO, V, EVERY_TICK)
    share = largest_loss(SCENARIO, V, when_lost, deltas=EVERY_TICK, tolerance=1e-3)
    assert 0.3 < share < 0.9
    assert (
        mean_square_radius(lossy(loop, share, when_lost)) < 1 < mean_square_radius(lossy(loop, share + 2e-3, when_lost))
    )
    near = np.linspace(share - 0.1, share + 0.1, 9)  # rising: there is one crossing
    radii = np.array([mean_square_radius(lossy(loop, p, when_lost)) for p in near])
    assert np.all(np.diff(radii) > -1e-6)
    moments = [np.trace(steady_second_moment(lossy(loop, p, when_lost))[0][:3, :3]) for p in (0.0, 0.15, 0.3)]
    assert moments[0] < moments[1] < moments[2]


def test_a_loop_unstable_without_loss_names_its_modes() -> None:
    with pytest.raises(InputError, match=r"unstable without any loss: .*(theta|phi) by 1\.\d+ a tick"):
        largest_loss(SCENARIO, V, "hold", delay=6)


@pytest.mark.parametrize(
    ("share", "burst", "named"),
    [(1.1, None, "loss: 1.1"), (-0.1, None, "loss: -0.1"), (math.nan, None, "loss: nan"), (0.2, 0.5, "burst: 0.5")]
    + [(0.9, 3.0, "at most 0.75"), (0.2, math.inf, "burst: inf")],
)
def test_losses_that_cannot_be_are_refused(share: float, burst: float | None, named: str) -> None:
    with pytest.raises(InputError, match=named):
        loss_of(share, burst)


@pytest.mark.parametrize(("when_lost", "delay"), [("fall", 0), ("hold", -1), ("hold", 1.5)])
def test_links_that_cannot_be_are_refused(when_lost: str, delay) -> None:
    with pytest.raises(InputError, match="must be"):
        behind_a_link(scalar_loop(1.0, 1.0, 0.5), when_lost, delay)


@pytest.mark.parametrize(
    ("sensors", "named"),
    [("[imu]", "imu: leave unseen .* of .*x.*y.*z"), ("[uwb]", "uwb: .*psi"), ("[]", "none: .*psi")],
)
def test_sensors_that_leave_a_state_unseen_are_refused(sensors: str, named: str) -> None:
    with pytest.raises(InputError, match=named):
        commanded_loop(load_scenario("nominal_imu_uwb", (f"sensors={sensors}",)), V)


def test_a_filter_that_does_not_settle_is_refused() -> None:
    with pytest.raises(InputError, match="does not settle"):
        periodic_predictor(1.1 * np.eye(1), np.zeros((1, 1)), np.eye(1), np.eye(1), np.ones((1, 1)))


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_acknowledged_losses_leave_estimator_and_servo_apart(share: float) -> None:
    """Separation: the second moment grows by the slower of the two, each by its own Kronecker products."""
    scenario = load_scenario("nominal_imu_uwb", ("estimator.integrator=estimate",))
    pair, weights = augmented_pair(scenario.vehicle, scenario.h), weight_matrices(scenario.servo.weights)
    L, _ = acknowledged_gain(*pair, *weights, 1.0 - share)
    closed = pair[0] - pair[1] @ L
    of_servo = share * np.kron(pair[0], pair[0]) + (1.0 - share) * np.kron(closed, closed)
    hover, deltas = hover_loop(scenario), schedule(scenario)
    there = hover.measurement.by_row(deltas)
    Ks, _ = periodic_predictor(hover.Phi, hover.C, hover.W, V, there)
    error = np.eye(len(hover.Phi))
    for K, arrived in zip(Ks, there, strict=True):
        error = (hover.Phi - K * arrived @ hover.C) @ error
    radii = [np.max(np.abs(np.linalg.eigvals(M))) for M in (of_servo, error)]
    expected = max(radii[0], radii[1] ** (2.0 / len(Ks)))
    assert mean_square_radius(acknowledged_loop(scenario, V, share)) == pytest.approx(expected, rel=1e-6)


def test_without_losses_acknowledgement_changes_nothing() -> None:
    own = steady_second_moment(lossy(commanded_loop(SCENARIO, V), 0.0, "zero"))
    found = steady_second_moment(acknowledged_loop(SCENARIO, V, 0.0))
    np.testing.assert_allclose(np.trace(found, axis1=1, axis2=2), np.trace(own, axis1=1, axis2=2), rtol=1e-6)
    assert largest_acknowledged_loss(SCENARIO) == 1.0


@pytest.mark.long
def test_the_report_is_plain_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "BURSTS", ())
    monkeypatch.setattr(module, "LOSSES", (0.0, 0.9))
    report = module.command_report(SCENARIO, V)
    data = as_data(report)
    assert json.loads(json.dumps(data, allow_nan=False)) == data
    assert report.growth < 1
    assert report.rms["hold"]["0"] == pytest.approx(report.own_link.rms, rel=1e-6)
    assert report.rms["zero"]["0.9"] is None
    assert report.acknowledged_rms["0"] == pytest.approx(report.rms["zero"]["0"], rel=1e-6)
    assert report.acknowledged_rms["0.9"] is not None
    assert 0 < report.largest_loss["zero"]["independent"] < report.largest_loss["hold"]["independent"] < 1


H = SCENARIO.h


@pytest.mark.parametrize("d", [0, 1, 2, 5, 20])
def test_a_delayed_integrator_is_stable_below_the_gain_of_levin_and_may(d: int) -> None:
    # x+ = x - k x_{k-d} is stable if and only if 0 < k < 2 sin(pi / (2 (2 d + 1))): Levin and May (1976).
    limit = 2 * math.sin(math.pi / (2 * (2 * d + 1)))

    def rate(gain: float) -> float:
        loop = CommandedLoop(np.ones((1, 1, 1)), np.ones((1, 1)), gain * np.ones((1, 1)), np.zeros((1, 1, 1)))
        return growth(delayed_matrices(loop, d))

    assert rate(limit) == pytest.approx(1.0, abs=1e-9)
    assert rate(0.98 * limit) < 1 < rate(1.02 * limit)


@pytest.mark.parametrize("quarters", [1, 2, 3, 5, 8, 11])
def test_a_fraction_of_a_tick_is_what_a_plant_sampled_four_times_as_often_does(quarters: int) -> None:
    L = servo_gain(M100, ServoWeights(), H)[:, :12]
    Phi, Gamma = discretize(hover_A(), hover_B(M100), H)
    loop = CommandedLoop(Phi[np.newaxis], Gamma, L, np.zeros((1, 12, 12)))
    theta = math.ceil(quarters / 4) - quarters / 4
    _, G_late = discretize(hover_A(), hover_B(M100), theta * H)
    A = delayed_matrices(loop, quarters / 4, G_late)[0]
    fine_Phi, fine_Gamma, *_ = cont2discrete((hover_A(), hover_B(M100), np.eye(12), np.zeros((12, 4))), H / 4)
    z = np.zeros(len(A))
    z[:12] = x = np.random.default_rng(4).normal(size=12) * 0.01
    commands = {}
    for k in range(40):
        np.testing.assert_allclose(z[:12], x, rtol=1e-9, atol=1e-12)
        for j in range(4):
            if j == 0:
                commands[k] = -L @ x
            sent = (4 * k + j - quarters) // 4
            x = fine_Phi @ x + fine_Gamma @ commands.get(sent, np.zeros(4))
        z = A @ z


def test_whole_ticks_are_the_link_without_loss() -> None:
    loop = commanded_loop(SCENARIO, V)
    for d in (0, 1, 4):
        A, _ = behind_a_link(loop, "zero", d)
        product = np.linalg.multi_dot([A[2, 0], A[1, 0], A[0, 0]])
        radius = np.max(np.abs(np.linalg.eigvals(product)))
        assert delay_growth(SCENARIO, V, d) == pytest.approx(radius ** (1 / 3), rel=1e-9)


def test_the_critical_delay_is_where_growth_crosses_one() -> None:
    found = critical_delay(SCENARIO, V)
    assert found.delay == pytest.approx(found.ticks * H)
    assert found.whole_ticks == math.ceil(found.ticks)
    assert delay_growth(SCENARIO, V, found.ticks - 1e-3) < 1 < delay_growth(SCENARIO, V, found.ticks + 1e-3)
    assert "a tick" in found.modes
    rates = list(found.growth.values())
    assert [rate < 1 for rate in rates] == [True] * found.whole_ticks + [False] * 2
    for d in (1, 2):  # continuous in the delay, across the step in the state's size
        assert delay_growth(SCENARIO, V, d + 1e-9) == pytest.approx(delay_growth(SCENARIO, V, d), abs=1e-6)


@pytest.mark.long
def test_the_delay_margin_is_that_of_the_frequency_response() -> None:
    # With the sensors every tick the loop at hover splits by axis. Height and yaw are looped through one input each:
    # at the crossover |G(e^jw)| = 1 the delay that turns the phase to -180 degrees is phase margin / w.
    deltas = np.array([[1.0, 0.0, 1.0]])
    loop = commanded_loop(SCENARIO, V, deltas)
    A, B, C = loop.F[0], loop.G, loop.L
    w = np.geomspace(0.05, math.pi / 3, 4000)  # per tick
    margins = []
    for channel in range(4):
        others = [j for j in range(4) if j != channel]
        A_c = A - B[:, others] @ C[others]
        response = np.array(
            [(C[channel] @ np.linalg.solve(np.exp(1j * v) * np.eye(27) - A_c, B[:, channel])) for v in w]
        )
        for j in np.flatnonzero(np.diff(np.sign(np.abs(response) - 1))):
            margins.append(((np.angle(response[j]) + math.pi) % (2 * math.pi)) / w[j])
    # All four inputs delayed at once: the loops do not interact at hover, so the least margin decides.
    assert critical_delay(SCENARIO, V, deltas).ticks == pytest.approx(min(margins), rel=0.02)


@pytest.mark.parametrize("delay", [-0.5, math.nan, math.inf])
def test_delays_that_cannot_be_are_refused(delay: float) -> None:
    with pytest.raises(InputError, match=r"delay: .*must be 0 ticks or more"):
        delay_growth(SCENARIO, V, delay)
