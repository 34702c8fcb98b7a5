"""The tube's recursion against published fixed points, SciPy and a Monte Carlo of the linear loop."""

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import same_color
from matplotlib.figure import Figure
from scipy.linalg import block_diag, solve_discrete_lyapunov
from scipy.stats import binom

from ortilo_drake.flight.flight import fly
from ortilo_drake.loop.plain import plain_source
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.signals import N_U
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.intermittent_filter import INTEGRATORS
from ortilo_drake.scenario import Scenario, load_scenario, with_seed
from ortilo_drake.studies.loop.hover_loop import HoverLoop, closed_loop_matrix, hover_loop, steady_predictor
from ortilo_drake.studies.tube.corridor import Corridor, corridor
from ortilo_drake.studies.tube.tube import NominalFlight, aim, nominal_flight, predict_tube
from ortilo_drake.studies.tube.tube_figures import (
    INSIDE,
    OUTSIDE,
    draw_deviations,
    draw_tube,
    fill_margins,
    plan_figure,
)
from ortilo_drake.studies.tube.tube_flights import (
    Flown,
    PointResult,
    at_burst,
    fly_point,
    interval,
    judge_point,
    within,
    worst_stretch,
)
from ortilo_drake.studies.tube.tube_map import MarginMap, arrivals_of_seed, with_rates
from ortilo_drake.studies.tube.tube_recursion import propagate

V_PRINTED = np.array([0.05 * np.eye(3), 0.08 * np.eye(3), 0.01 * np.eye(3)])
MEASUREMENT = make_measurement()
LAYOUT = tuple(MEASUREMENT.layout)
ALWAYS = np.zeros((3, 4))


def bernoulli(uwb: float, camera: float) -> np.ndarray:
    return np.array([[0.0, 0.0, 1.0 - uwb, 1.0 - uwb], [0.0, 0.0, 1.0 - camera, 1.0 - camera], [0.0] * 4])


def run(
    loop: HoverLoop, n: int, V: np.ndarray, loss: np.ndarray, d: np.ndarray, r: np.ndarray, there: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    X_0 = block_diag(0.02 * np.eye(12), np.zeros((3, 3)))
    kind = INTEGRATORS[loop.integrator]
    mean, C, X = propagate(
        loop.Phi, loop.Gamma, loop.L, loop.W, np.tile(V, (n, 1, 1, 1)), there[..., None], loss[..., None],
        X_0, d, r, r, kind, LAYOUT, 12,
    )  # fmt: skip
    return mean[..., 0], C[..., 0], X[..., 0]


def at_rest(n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return np.zeros((n, 12)), np.zeros((n, 3)), np.ones((n, 3), dtype=bool)


@pytest.mark.long
@pytest.mark.parametrize(
    ("rates", "W", "P_xx", "P_zz"),
    [
        ((1.0, 0.0), 1e-4, 0.005744, 0.003656),
        ((0.5, 0.5), 1e-4, 0.006898, 0.004272),
        ((0.1, 0.0), 1e-4, 0.046706, 0.021684),
        ((1.0, 0.0), 1.0, 1.085270, 1.084872),
    ],
)
def test_error_settles_at_the_expected_riccati_fixed_point(
    rates: tuple[float, float], W: float, P_xx: float, P_zz: float
) -> None:
    # Values of the theory page, computed independently of this code.
    loop = hover_loop(Scenario())._replace(W=W * np.eye(12))
    _, _, X = run(loop, 3000, V_PRINTED, bernoulli(*rates), *at_rest(3000))
    assert X[-1, 0, 0] == pytest.approx(P_xx, abs=1e-6)
    assert X[-1, 2, 2] == pytest.approx(P_zz, abs=1e-6)


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["hold", "literal", "estimate"])
def test_without_losses_the_deviation_is_the_lyapunov_solution(integrator: str) -> None:
    loop = hover_loop(load_scenario("nominal_imu_uwb_yolo", (f"estimator.integrator={integrator}",)))
    n = 6000
    _, C, X = run(loop, n, V_PRINTED, ALWAYS, *at_rest(n))
    V = block_diag(*V_PRINTED)
    K, _ = steady_predictor(loop.Phi, loop.C, loop.W, V)
    everything = np.ones(3)
    A = closed_loop_matrix(loop, K, everything)
    noise = np.zeros((27, 9))  # how v enters [x; xhat; i]
    noise[12:24] = K
    if integrator != "estimate":
        noise[24:27] = -MEASUREMENT.selection_matrix(everything)
    Q = noise @ V @ noise.T
    Q[:12, :12] += loop.W
    expected = solve_discrete_lyapunov(A, Q)[:12, :12]
    np.testing.assert_allclose((X + C)[-1], expected, rtol=1e-6, atol=1e-9)


def as_printed(
    loop: HoverLoop, V: np.ndarray, there: np.ndarray, loss: np.ndarray, d: np.ndarray, r: np.ndarray, r_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean (15) and covariance (15 x 15) of s and X (12 x 12) of the last tick, pattern by pattern at full size."""
    modes = list(product((0, 1), repeat=3))  # whether the chain of uwb, camera and imu is bad
    X, M, m = ({i: np.zeros(shape) for i in modes} for shape in ((12, 12), (15, 15), 15))
    X[0, 0, 0], mu = 0.02 * np.eye(12), {i: float(i == (0, 0, 0)) for i in modes}
    GammaL = np.vstack([loop.Gamma @ loop.L, np.zeros((3, 15))])
    for k in range(len(d) - 1):
        mu_n, m_n, M_n, X_n = ({i: np.zeros_like(part[i]) for i in modes} for part in (mu, m, M, X))
        for i, p in product(modes, modes):
            lost = [loss[s, 2 + i[s]] if there[k, s] else 1.0 for s in range(3)]
            chance = mu[i] * np.prod([1.0 - lost[s] if p[s] else lost[s] for s in range(3)])
            rows = np.flatnonzero(np.repeat(p, 3))
            C, V_p = loop.C[rows], block_diag(*V[k])[np.ix_(rows, rows)]
            E = MEASUREMENT.selection_matrix(np.array(p, dtype=float))[:, rows]
            fix = p[0] or p[1]
            Phibar = np.eye(15)
            Phibar[:12, :12] = loop.Phi
            d_p = np.append(d[k], np.zeros(3))
            if loop.integrator == "estimate":
                Phibar[12:, :3] -= np.eye(3)
                E = 0.0 * E
            else:
                Phibar[12:, :12] -= E @ C
            if loop.integrator == "estimate" or fix:
                d_p[12:] = r[k] - r_s[k]
            elif loop.integrator == "literal":
                d_p[12:] = r[k]
            S = C @ X[i] @ C.T + V_p
            K = loop.Phi @ X[i] @ C.T @ np.linalg.inv(S)
            F, K_s, A = loop.Phi - K @ C, np.vstack([K, -E]), Phibar - GammaL
            z = A @ m[i] + d_p
            M_p = A @ (M[i] - np.outer(m[i], m[i])) @ A.T + np.outer(z, z) + K_s @ S @ K_s.T
            for j in modes:
                pi = [loss[s, 1] if i[s] else loss[s, 0] for s in range(3)]
                to_j = chance * np.prod([pi[s] if i[s] != j[s] else 1.0 - pi[s] for s in range(3)])
                mu_n[j] += to_j
                m_n[j] += to_j * z
                M_n[j] += to_j * M_p
                X_n[j] += to_j * (F @ X[i] @ F.T + loop.W + K @ V_p @ K.T)
        m, M, X = ({i: part[i] / max(mu_n[i], 1e-300) for i in modes} for part in (m_n, M_n, X_n))
        mu = mu_n
    mean, M_all, X_all = (sum(mu[i] * part[i] for i in modes) for part in (m, M, X))
    return mean, M_all - np.outer(mean, mean), X_all


@pytest.mark.parametrize("integrator", ["hold", "literal", "estimate"])
@pytest.mark.parametrize(
    ("recursion", "n", "cases"),
    [(plain_source(propagate), 3, slice(2, 3)), pytest.param(propagate, 25, slice(3), marks=pytest.mark.long)],
    ids=["plain", "compiled"],
)
def test_cases_side_by_side_are_the_recursion_as_printed(
    recursion: Callable[..., tuple[np.ndarray, ...]], n: int, cases: slice, integrator: str
) -> None:
    rng = np.random.default_rng(3)
    loop = hover_loop(load_scenario("nominal_imu_uwb_yolo", (f"estimator.integrator={integrator}",)))
    root = rng.normal(0.0, 0.1, (n, 3, 3, 3))
    V = root @ np.swapaxes(root, -1, -2) + 1e-4 * np.eye(3)
    bursts = [[0.2, 0.1, 0.1, 0.9], [0.3, 0.2, 0.0, 1.0], [0.1, 0.3, 0.1, 0.6]]
    losses = np.array([ALWAYS, bernoulli(0.3, 0.6), bursts])[cases]
    there = (rng.random((3, n, 3)) < [0.5, 0.6, 0.9])[cases]
    d, r = rng.normal(0.0, 1e-3, (n, 12)), rng.normal(0.0, 1.0, (n, 3))
    r_s = 0.5 * r
    found = recursion(
        loop.Phi, loop.Gamma, loop.L, loop.W, V, np.moveaxis(there, 0, -1).copy(), np.moveaxis(losses, 0, -1).copy(),
        block_diag(0.02 * np.eye(12), np.zeros((3, 3))), d, r, r_s, INTEGRATORS[integrator], LAYOUT, 15,
    )  # fmt: skip
    for q, (arrives, loss) in enumerate(zip(there, losses, strict=True)):
        for fast, plain in zip(found, as_printed(loop, V, arrives, loss, d, r, r_s), strict=True):
            np.testing.assert_allclose(fast[-1, ..., q], plain, rtol=1e-9, atol=1e-12 * np.abs(plain).max())


def riccati_gains(
    loop: HoverLoop, n: int, V: np.ndarray, there: np.ndarray, chain: np.ndarray, camera: float
) -> tuple[list[dict[tuple[int, int, int], np.ndarray]], np.ndarray]:
    """Gains K (12 x 9) for every tick, state of uwb's chain and arrivals of (uwb, camera), by full-size formulas."""
    X, mu = [0.02 * np.eye(12), 0.02 * np.eye(12)], np.array([1.0, 0.0])
    gains = []
    for k in range(n):
        of_tick, X_next, mu_next = {}, [np.zeros((12, 12)), np.zeros((12, 12))], mu @ chain
        for i in range(2):
            mixed = np.zeros((12, 12))
            for a in (0, 1):
                for b in (0, 1):
                    chance_a = float(a == (1 - i)) if there[k, 0] else float(a == 0)
                    chance_b = (camera if b else 1.0 - camera) if there[k, 1] else float(b == 0)
                    rows = np.flatnonzero(np.repeat([a, b, there[k, 2]], 3))
                    C, V_p = loop.C[rows], V[np.ix_(rows, rows)]
                    K = np.zeros((12, 9))
                    K[:, rows] = loop.Phi @ X[i] @ C.T @ np.linalg.inv(C @ X[i] @ C.T + V_p)
                    F = loop.Phi - K[:, rows] @ C
                    mixed += chance_a * chance_b * (F @ X[i] @ F.T + loop.W + K @ V @ K.T)
                    of_tick[i, a, b] = K
            for j in range(2):
                X_next[j] += mu[i] * chain[i, j] * mixed
        X = [X_next[j] / mu_next[j] if mu_next[j] > 0 else X_next[j] for j in range(2)]
        mu = mu_next
        gains.append(of_tick)
    return gains, mu


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["hold", "literal", "estimate"])
def test_recursion_agrees_with_a_monte_carlo_of_the_linear_loop(integrator: str) -> None:
    # uwb in bursts, camera lost independently and due every other tick, an imu; x, xhat and i flown by the equations.
    rng = np.random.default_rng(5)
    scenario = load_scenario("nominal_imu_uwb_yolo", (f"estimator.integrator={integrator}",))
    loop, n, runs, camera = hover_loop(scenario), 80, 6000, 0.4
    chain = np.array([[0.8, 0.2], [0.3, 0.7]])
    loss = np.array([[0.2, 0.3, 0.0, 1.0], [0.0, 0.0, 1.0 - camera, 1.0 - camera], [0.0] * 4])
    V = block_diag(*(0.01 * V_PRINTED))
    there = np.ones((n, 3), dtype=bool)
    there[1::2, 1] = False
    r = np.cumsum(rng.normal(0.0, 0.002, (n, 3)), axis=0)
    x_ref = np.hstack([r, np.zeros((n, 9))])
    d = np.vstack([x_ref[:-1] @ loop.Phi.T - x_ref[1:], np.zeros((1, 12))])

    gains, _ = riccati_gains(loop, n, V, there, chain, camera)
    W_root = np.linalg.cholesky(loop.W + 1e-18 * np.eye(12))
    xhat, i = np.zeros((runs, 12)), np.zeros((runs, 3))
    xhat[:, :3] = r[0]
    x = xhat + rng.normal(0.0, np.sqrt(0.02), (runs, 12))
    state = np.zeros(runs, dtype=int)
    for k in range(n - 1):
        deviation = x - x_ref[k]
        a, b = (state == 0) & there[k, 0], (rng.random(runs) < camera) & there[k, 1]
        y = x @ loop.C.T + rng.standard_normal((runs, 9)) * np.sqrt(np.diag(V))
        u = -np.hstack([xhat - x_ref[k], i]) @ loop.L.T
        x_next = x @ loop.Phi.T + u @ loop.Gamma.T + rng.standard_normal((runs, 12)) @ W_root.T
        xhat_next, i_next = np.empty_like(xhat), i.copy()
        for key, K in gains[k].items():
            who = (state == key[0]) & (a == key[1]) & (b == key[2])
            innovation = y[who] - xhat[who] @ loop.C.T
            xhat_next[who] = xhat[who] @ loop.Phi.T + u[who] @ loop.Gamma.T + innovation @ K.T
            delta = np.array([key[1], key[2], 1.0])
            if integrator == "estimate":
                i_next[who] += r[k] - xhat[who, :3]
            elif integrator == "literal" or key[1] or key[2]:
                i_next[who] += (
                    r[k] - y[who] @ (MEASUREMENT.selection_matrix(delta) @ MEASUREMENT.arrival_matrix(delta)).T
                )
        state = np.where(rng.random(runs) < chain[state, 1], 1, 0)
        x, xhat, i = x_next, xhat_next, i_next
    deviation = (x - x_ref[n - 1])[:, :9]

    means, C, X = run(loop, n, 0.01 * V_PRINTED, loss, d, r, there)
    mean = means[-1, :9]
    covariance = (X + C)[-1, :9, :9]
    sd = np.sqrt(np.diag(covariance))
    # Five standard errors; a variance's is sqrt((kurtosis - 1) / runs) of it, its kurtosis taken from the sample.
    np.testing.assert_allclose(deviation.mean(axis=0), mean, atol=float(5.0 * (sd / np.sqrt(runs)).max()))
    z = (deviation - mean) / sd
    allowed = 5.0 * np.sqrt((np.mean(z**4, axis=0) - 1.0) / runs)
    assert np.all(np.abs(np.mean(z**2, axis=0) - 1.0) < allowed)
    correlation = covariance / np.outer(sd, sd)
    assert np.all(np.abs(z.T @ z / runs - correlation) < 5.0 * np.sqrt(np.mean(z**4, axis=0).max() / runs))


@pytest.mark.long
def test_more_arrivals_never_widen_the_error() -> None:
    loop = hover_loop(Scenario())
    n = 400
    least = [run(loop, n, V_PRINTED, bernoulli(rate, 0.1), *at_rest(n))[2][-1] for rate in (0.0, 0.1, 0.5, 1.0)]
    for wide, narrow in pairwise(least):
        assert np.linalg.eigvalsh(wide - narrow).min() > -1e-12


def test_aim_is_what_the_servo_aims_at() -> None:
    scenario = Scenario()
    reference = np.array([[1.0, 2.0, 1.5, 0.3, 0.1, 0.0, 0.2, -0.1, 0.4]])
    x_ref, u_ff = aim(scenario, reference)
    g = 9.81
    np.testing.assert_allclose(x_ref[0], [1.0, 2.0, 1.5, 0.1 / g, 0.2 / g, 0.0, 0.3, 0.1, 0.0, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(u_ff[0], [scenario.vehicle.mass * 0.4, 0.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.long
def test_course_is_due_late_and_blacked_out() -> None:
    scenario = load_scenario(
        "nominal_imu_uwb_yolo",
        (
            "camera.kind=projected",
            "settle=0.0",
            "planner={kind: waypoints, points: [[0.0, 0.0, 1.5], [1.0, 0.6, 1.5]]}",
            "uwb.link.blackouts=[{kind: position, axis: x, start: 0.4, end: 0.6}]",
        ),
    )
    nominal = nominal_flight(scenario)
    ticks = np.arange(len(nominal.time))
    seen = (nominal.r[:, 0] < 0.4) | (nominal.r[:, 0] >= 0.6)
    np.testing.assert_array_equal(nominal.there[:, 0], (ticks % 3 == 0) & seen)
    assert not nominal.there[ticks % 3 != 1, 1].any()  # the camera's latency is a tick
    assert nominal.there[ticks % 3 == 1, 1].mean() > 0.9
    assert nominal.there[:, 2].all()


@pytest.mark.long
def test_tube_needs_a_servo_fed_by_the_filter_and_constant_delays() -> None:
    with pytest.raises(InputError, match=r"servo\.velocities"):
        predict_tube(load_scenario("paper_imu_uwb"))
    with pytest.raises(InputError, match="random_delay"):
        predict_tube(load_scenario("bursty_link"))


@pytest.mark.long
def test_paper_form_settles_at_the_reference() -> None:
    # u = -L [xhat; i] starts at rest at r with the integral that balances it; here i starts at 0, so it must settle.
    scenario = load_scenario("nominal_imu_uwb", ("servo.form=paper",))
    n = 9000
    r = np.tile([0.5, -0.3, 1.0], (n, 1))
    nominal = NominalFlight(
        np.arange(n) * scenario.h, r, np.zeros((n, 12)), np.zeros((n, N_U)),
        np.tile(0.01 * V_PRINTED, (n, 1, 1, 1)), np.ones((n, 3), dtype=bool),
    )  # fmt: skip
    tube = predict_tube(scenario, nominal)
    np.testing.assert_allclose(tube.mean[-1], 0.0, atol=1e-3)
    assert tube.radius[-1] < 0.3


PAIR = (0.3, 0.5)


@lru_cache(maxsize=1)
def short() -> tuple[Scenario, NominalFlight]:
    scenario = load_scenario(
        "nominal_imu_uwb_yolo",
        (
            "camera.kind=projected",
            "settle=0.5",
            "uwb.link.blackouts=[]",
            "planner={kind: waypoints, points: [[0.0, 0.0, 1.5], [0.8, 0.5, 1.5]]}",
        ),
    )
    return scenario, nominal_flight(scenario)


def straying(share: float, lost: float | None = None) -> list[Flown]:
    """Two flights that stray to that share of the tube's radius, to the north."""
    scenario, nominal = short()
    tube = predict_tube(with_rates(scenario, *PAIR), nominal)
    deviation = np.zeros((len(tube.radius), 3))
    deviation[:, 1] = share * tube.radius
    return [Flown(1, deviation, None), Flown(2, deviation, lost)]


def judge(flights: list[Flown]) -> PointResult:
    return judge_point(with_rates(short()[0], *PAIR), PAIR, flights, short()[1], others=range(50, 54))


@pytest.mark.long
def test_flights_inside_the_tube_hold() -> None:
    result = judge(straying(0.99))
    assert (result.contained, result.contained_low, result.contained_worst) == (1.0, 1.0, 1.0)
    assert result.holds
    assert result.breakdown == ""
    assert result.margin > 0.0


@pytest.mark.long
def test_flights_outside_the_tube_are_a_breakdown() -> None:
    result = judge(straying(1.01))
    assert result.contained == 0.0
    assert not result.holds
    assert result.breakdown


@pytest.mark.long
def test_a_flight_lost_though_the_tube_is_inside_is_a_breakdown() -> None:
    result = judge(straying(0.5, lost=3.0))
    assert (result.contained, result.lost, result.holds) == (1.0, 1, False)
    assert "1 lost" in result.breakdown


@pytest.mark.long
def test_flights_are_those_of_the_diagram_and_their_arrivals_the_expected_ones(tmp_path: Path) -> None:
    scenario, nominal = short()
    lossy = at_burst(scenario, (0.5, 0.3))
    flights = fly_point(lossy, [4, 7], tmp_path)
    flight = fly(with_seed(lossy, 7))
    expected = flight["truth"].values[:, :3] - flight["reference"].values
    np.testing.assert_allclose(flights[1].deviation, expected, rtol=0.0, atol=1e-9)
    assert [one.seed for one in flights] == [4, 7]
    np.testing.assert_array_equal(arrivals_of_seed(lossy, nominal, 7), flight["arrival"].values)


@pytest.mark.long
def test_what_the_engine_does_not_fly_drake_does_and_keeps(tmp_path: Path) -> None:
    scenario, _ = short()
    lossy = load_scenario(at_burst(scenario, (0.5, 0.3)), ("imu.link.rate=60",))
    flights = fly_point(lossy, [4], tmp_path)
    (file,) = tmp_path.rglob("*.nc")
    before = file.stat().st_mtime_ns
    (again,) = fly_point(lossy, [4], tmp_path)  # read, not flown
    assert file.stat().st_mtime_ns == before
    np.testing.assert_array_equal(flights[0].deviation, again.deviation)


@pytest.mark.long
def test_flown_deviations_are_of_the_predicted_size() -> None:
    # Over six flights the mean squared deviation differs from the predicted one by chance alone: a factor of two.
    scenario, nominal = short()
    lossy = with_rates(scenario, *PAIR)
    tube = predict_tube(lossy, nominal)
    flights = [fly(with_seed(lossy, seed)) for seed in range(11, 17)]
    flown = [flight["truth"].values[:, :3] - flight["reference"].values for flight in flights]
    predicted = np.trace(tube.covariance, axis1=1, axis2=2) + np.sum(tube.mean**2, axis=1)
    late = slice(30, None)
    ratio = np.mean([np.sum(d[late] ** 2, axis=1) for d in flown]) / np.mean(predicted[late])
    assert 0.5 < ratio < 2.0
    inside = np.concatenate([within(Flown(0, d, None), tube.radius) for d in flown])
    assert inside.mean() >= 0.99


def test_interval_of_independent_ticks_is_the_binomial_one() -> None:
    ok = np.random.default_rng(3).random(400) < 0.9
    low, high = interval([np.array([tick]) for tick in ok])
    expected = binom.ppf([0.025, 0.975], 400, ok.mean()) / 400
    np.testing.assert_allclose([low, high], expected, atol=0.006)


def test_worst_stretch_of_lost_flights_is_what_they_flew() -> None:
    whole, lost = np.ones(80, dtype=bool), np.ones(15, dtype=bool)
    lost[10:] = False
    assert worst_stretch([whole, lost], 80) == pytest.approx(10.0 / 15.0)


@pytest.mark.long
def test_the_tube_on_a_plan_is_orange_where_it_leaves_the_corridor() -> None:
    scenario, nominal = short()
    tube = predict_tube(with_rates(scenario, *PAIR), nominal)
    wide = tube.radius > np.median(tube.radius)
    about = Corridor(np.full(len(wide), np.median(tube.radius)), np.ones(len(wide)), np.zeros(len(wide), dtype=int))
    axes = Figure().subplots()
    draw_tube(axes, tube, about)
    for discs, part, color in zip(axes.collections, (~wide, wide), (INSIDE, OUTSIDE), strict=True):
        np.testing.assert_allclose(discs.get_offsets(), tube.r[part][::3, :2])
        np.testing.assert_allclose(discs.get_widths(), 2.0 * tube.radius[part][::3])
        assert same_color(discs.get_facecolor(), color)
    np.testing.assert_array_equal(axes.get_lines()[0].get_xydata(), tube.r[:, :2])
    assert axes.get_legend_handles_labels()[1] == ["planned", "tube in the corridor", "tube beyond it"]


@pytest.mark.long
def test_deviations_are_the_flights_horizontal_ones_and_a_lost_one_ends_in_a_cross() -> None:
    scenario, nominal = short()
    tube = predict_tube(with_rates(scenario, *PAIR), nominal)
    about = corridor(scenario.load_room(), scenario.vehicle, nominal.r)
    axes = Figure().subplots()
    draw_deviations(axes, tube, about, straying(0.9, lost=2.0))
    room, first, second, cross = axes.get_lines()
    np.testing.assert_array_equal(room.get_ydata(), about.radius)
    for line in (first, second):
        np.testing.assert_allclose(line.get_ydata(), 0.9 * tube.radius)
        np.testing.assert_array_equal(line.get_xdata(), tube.time)
    np.testing.assert_allclose(cross.get_ydata(), 0.9 * tube.radius[-1])
    assert axes.get_legend_handles_labels()[1] == ["tube", "corridor", "a flight", "lost"]
    assert axes.get_ylabel() == "deviation [m]"


def test_margins_are_filled_over_their_axes_and_0_is_drawn_for_both_paths() -> None:
    a = np.linspace(0.1, 1.0, 4)
    axes = Figure().subplots()
    fill_margins(axes, MarginMap(a, a, np.add.outer(a, 0.0 * a) - 0.5, np.add.outer(a, 0.0 * a) - 0.7))
    _, whole, guided = axes.collections
    for line, at in ((whole, 0.5), (guided, 0.7)):
        np.testing.assert_allclose(np.vstack([path.vertices for path in line.get_paths()])[:, 0], at)


@pytest.mark.long
def test_what_a_plan_shows_is_named(tmp_path: Path) -> None:
    plan = plan_figure(*short(), {PAIR: straying(0.9, lost=2.0)}, tmp_path / "plan.svg").read_text()
    for named in ("anchor", "landmark", "planned", "3-sigma tube", "a flight", "a lost flight"):
        assert f">{named}</text>" in plan, named
