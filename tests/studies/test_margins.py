import json
import math

import numpy as np
import pytest
from scipy.optimize import bisect, brentq

from ortilo_drake.model.as_data import as_data
from ortilo_drake.model.signals import CONTROL_NAMES
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.servo.lq_gain import augmented_pair, weight_matrices
from ortilo_drake.scenario import IntermittentFilter, Scenario, load_scenario
from ortilo_drake.studies.command_link.command_flights import hover_V
from ortilo_drake.studies.loop.hover_loop import (
    arrivals_of,
    closed_loop_matrix,
    filter_V,
    hover_loop,
    steady_predictor,
)
from ortilo_drake.studies.loop.margins import input_loop, loops_by_case, margins_report, steady_gain
from ortilo_drake.theory.margins.loop_margins import (
    OpenLoop,
    channel_margins,
    closed,
    joint_margins,
    one_channel,
    response,
    spectral_radius,
)
from ortilo_drake.theory.riccati.riccati import solve

V = np.diag([0.02] * 3 + [0.01] * 3 + [1e-4] * 3)
ALL = ("uwb", "camera", "imu")
SCENARIO = Scenario()
HOVER = hover_loop(SCENARIO)
LOOPS = loops_by_case(HOVER, V, ALL)


@pytest.fixture(scope="module")
def report():
    return margins_report(SCENARIO, V)


def flying_matrix(factors, sensors=ALL, delay=(0, 0, 0, 0)):
    """closed_loop_matrix with the plant's controls multiplied and delayed by whole ticks, the filter's model left."""
    loop = HOVER
    delta = arrivals_of(sensors)
    rows = np.repeat(delta, 3) > 0
    K = np.zeros((12, 9))
    K[:, rows] = steady_predictor(loop.Phi, loop.C[rows], loop.W, V[np.ix_(rows, rows)])[0]
    A = closed_loop_matrix(loop, K, delta)
    u = -loop.L @ np.hstack([np.zeros((15, 12)), np.eye(15)])
    A = A.astype(complex)
    A[:12, 12:] = 0
    for j in range(4):
        b = loop.Gamma[:, j] * factors[j]
        if delay[j] == 0:
            A[:12, :27] += np.outer(b, u[j])
            continue
        n = len(A)
        A = np.block([[A, np.zeros((n, delay[j]))], [np.zeros((delay[j], n + delay[j]))]])
        A[n, :27] = u[j]
        A[np.arange(n + 1, n + delay[j]), np.arange(n, n + delay[j] - 1)] = 1
        A[:12, -1] = b
    return A


def only(channel, value, others=1.0):
    return [value if name == channel else others for name in CONTROL_NAMES]


def test_closed_loop_is_the_one_of_hover_loop():
    K, _ = steady_predictor(HOVER.Phi, HOVER.C, HOVER.W, V)
    assert np.allclose(closed(LOOPS["nominal"].loop), closed_loop_matrix(HOVER, K, np.ones(3)), rtol=0, atol=1e-8)


@pytest.mark.family
@pytest.mark.parametrize("sensors", [ALL, ("camera", "imu"), ("uwb", "imu")])
@pytest.mark.parametrize("channel", CONTROL_NAMES)
def test_gain_margins_are_where_eigenvalues_cross(report, sensors, channel):
    lost = set(ALL) - set(sensors)
    margins = report[f"without {lost.pop()}" if lost else "nominal"].channels[channel]

    def excess(factor):
        return spectral_radius(flying_matrix(only(channel, factor), sensors)) - 1

    assert excess(1) < 0
    up = bisect(excess, 1, 1.5 * margins.gain_up, xtol=1e-8)
    assert up == pytest.approx(margins.gain_up, rel=1e-6)
    if margins.gain_down is not None:
        down = bisect(excess, 0.5 * margins.gain_down, 1, xtol=1e-8)
        assert down == pytest.approx(margins.gain_down, rel=1e-6)
    else:
        assert all(excess(factor) < 0 for factor in np.geomspace(1e-3, 1, 20))


@pytest.mark.parametrize("channel", CONTROL_NAMES)
def test_phase_margin_is_where_an_eigenvalue_crosses(report, channel):
    phase = report["nominal"].channels[channel].phase
    radius = [spectral_radius(flying_matrix(only(channel, np.exp(-1j * phase * k)))) for k in (0.999, 1.0, 1.001)]
    assert radius[0] < 1 < radius[2]
    assert radius[1] == pytest.approx(1, abs=1e-8)


@pytest.mark.parametrize("channel", CONTROL_NAMES)
def test_loop_bears_the_whole_ticks_of_its_delay_margin_and_no_more(report, channel):
    margins = report["nominal"].channels[channel]
    ticks = math.floor(margins.delay_ticks)
    assert margins.delay == pytest.approx(margins.delay_ticks / 30)
    radius = [spectral_radius(flying_matrix([1] * 4, delay=only(channel, d, 0))) for d in (ticks, ticks + 1)]
    assert radius[0] < 1 < radius[1]


@pytest.mark.family
@pytest.mark.parametrize("channel", ["f_T", "tau_x"])
def test_delay_margin_of_exactly_two_ticks_puts_an_eigenvalue_on_the_circle(channel):
    k = CONTROL_NAMES.index(channel)
    A, B, C = one_channel(LOOPS["nominal"].loop, k)

    def ticks(gain):
        return channel_margins(OpenLoop(A, gain * B, C), HOVER.h).delay_ticks - 2

    high = 3.0 if channel == "f_T" else 1.4
    gain = brentq(ticks, 1.0, high, xtol=1e-10)
    radius = spectral_radius(flying_matrix(only(channel, gain), delay=only(channel, 2, 0)))
    assert radius == pytest.approx(1, abs=1e-7)


@pytest.mark.long
def test_disk_margin_is_reached_and_not_exceeded(report):
    for name in ("nominal", "without imu", "full state"):
        inner = LOOPS[name]
        for k, channel in enumerate(CONTROL_NAMES):
            margins = report[name].channels[channel]
            if margins is None:
                continue
            disk, loop = margins.disk, one_channel(inner.loop, k)
            L = response(loop, np.geomspace(1e-3, math.pi, 3001))[:, 0, 0]
            factor = -1 / L[abs((1 - L) / (1 + L)).argmax()]
            assert abs((factor - 1) / (factor + 1)) == pytest.approx(disk.alpha / 2, rel=1e-4)
            assert spectral_radius(closed(loop, factor)) == pytest.approx(1, abs=1e-7)
            assert disk.phase <= margins.phase + 1e-9
            assert disk.gain_high <= margins.gain_up + 1e-9
            assert disk.gain_low >= (margins.gain_down or 0) - 1e-9
            for angle in np.linspace(0, 2 * math.pi, 7):
                d = 0.98 * disk.alpha / 2 * np.exp(1j * angle)
                assert spectral_radius(closed(loop, (1 + d) / (1 - d))) < 1


def test_peaks_from_the_closed_loops_own_realisation(report):
    for name, inner in LOOPS.items():
        _, B, C = inner.loop
        omega = np.geomspace(1e-2, math.pi, 2001)
        r = np.sqrt(SCENARIO.servo.weights.control)
        T = response(OpenLoop(closed(inner.loop), B, C), omega) * r[:, None] / r
        joint = report[name].joint
        S_peak = np.linalg.norm(np.eye(4) - T, 2, axis=(1, 2)).max()
        T_peak = np.linalg.norm(T, 2, axis=(1, 2)).max()
        assert joint.sensitivity == pytest.approx(S_peak, rel=1e-5)
        assert joint.complementary == pytest.approx(T_peak, rel=1e-5)


@pytest.mark.long
def test_joint_margins_do_not_depend_on_the_units_of_the_controls():
    """With a V that couples the axes; torques in 0.1 N m and their weight to match."""
    rng = np.random.default_rng(3)
    G = rng.normal(size=(9, 9))
    coupled = input_loop(HOVER, 1e-3 * (G @ G.T) + np.diag(np.diag(V)), ALL).loop
    R, unit = np.array(SCENARIO.servo.weights.control), np.array([1.0, 0.1, 0.1, 0.1])
    other = OpenLoop(coupled.A, coupled.B * unit, coupled.C / unit[:, None])
    for key in ("sensitivity", "complementary"):
        here, there = (
            getattr(joint_margins(coupled, HOVER.h, R), key),
            getattr(joint_margins(other, HOVER.h, R * unit**2), key),
        )
        assert here == pytest.approx(there, rel=1e-9)
        in_other_units = getattr(joint_margins(other, HOVER.h, R), key)
        assert in_other_units != pytest.approx(here, rel=1e-5)  # R must be in the same units


def test_full_state_loop_obeys_the_return_difference_equality():
    """(I + L)^H (R + B^T S B) (I + L) = R + G^H Q G, G = (z I - A)^-1 B (Kalman, in discrete time)."""
    A, B = augmented_pair(SCENARIO.vehicle, SCENARIO.h)
    Q, R = weight_matrices(SCENARIO.servo.weights)
    S = solve(A, B, Q, R)
    omega = np.geomspace(0.03, math.pi, 50)
    D = np.eye(4) + response(LOOPS["full state"].loop, omega)
    G = np.linalg.solve(np.exp(1j * omega)[:, None, None] * np.eye(15) - A, np.broadcast_to(B, (50, *B.shape)))
    left = D.conj().swapaxes(1, 2) @ (R + B.T @ S @ B) @ D
    right = R + G.conj().swapaxes(1, 2) @ Q @ G
    assert np.allclose(left, right, rtol=1e-7, atol=1e-7 * abs(right).max(axis=(1, 2), keepdims=True))


@pytest.mark.parametrize("c", [0.1, 0.5, 1.5])
def test_integrator_in_closed_form(c):
    """L = c / (z - 1): the closed loop's pole is 1 - k c, |L| = 1 at 2 asin(c / 2), |S| is largest at omega = pi."""
    margins = channel_margins(OpenLoop(np.eye(1), np.eye(1), np.array([[c]])), 0.1)
    crossover = 2 * math.asin(c / 2)
    phase = math.pi / 2 - crossover / 2
    assert margins.gain_up == pytest.approx(2 / c)
    assert margins.gain_up_at == pytest.approx(math.pi / 0.1)
    assert margins.gain_down is None
    assert margins.crossovers == pytest.approx([crossover / 0.1])
    assert margins.phase == pytest.approx(phase)
    assert margins.delay_ticks == pytest.approx(phase / crossover)
    assert margins.sensitivity == pytest.approx(2 / (2 - c))


def limit_of_the_gain(Phi, C, W, V_s, steps):
    """Return the gain after so many steps of the recursion, and its covariance."""
    P = 0.01 * np.eye(len(Phi))
    for _ in range(steps):
        F = np.linalg.solve(C @ P @ C.T + V_s, C @ P @ Phi.T)
        P = Phi @ P @ Phi.T + W - Phi @ P @ C.T @ F
        P = (P + P.T) / 2
    return F.T, P


@pytest.mark.parametrize(("first", "lost"), [(6, (0, 1, 2, 6, 7, 8)), (0, (5, 11))])
def test_gain_has_a_limit_where_the_covariance_has_none(first, lost):
    rows = slice(6, 9) if first == 6 else slice(0, 6)
    Phi, C, W, V_s = HOVER.Phi, HOVER.C[rows], HOVER.W, V[rows, rows]
    K, P = limit_of_the_gain(Phi, C, W, V_s, 3000)
    assert P[lost[-1], lost[-1]] > 1e-3  # and growing
    assert np.allclose(K, steady_gain(Phi, C, W, V_s, HOVER.units), rtol=1e-6, atol=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("force", ["thrust", "measured"])
@pytest.mark.parametrize("sensors", [("uwb", "imu"), ("imu",)])
def test_a_filter_with_a_force_has_that_limit_too(force, sensors):
    """Without a fix the accelerometer tells d + m b and not d from b: no whole states are unseen."""
    scenario = load_scenario("nominal_imu_uwb", (f"estimator.force={force}",))
    loop = hover_loop(scenario)
    rows = loop.measurement.by_row(arrivals_of(sensors, loop.measurement)) > 0.0
    V_s = filter_V(scenario, hover_V(scenario))[np.ix_(rows, rows)]
    Phi, C, W = loop.Phi, loop.C[rows], loop.W
    K, _ = limit_of_the_gain(Phi, C, W, V_s, 20_000)
    found = steady_gain(Phi, C, W, V_s, loop.units)
    assert np.max(np.abs(found - K)) < 2e-4 * np.max(np.abs(K))
    if sensors == ("uwb", "imu"):
        np.testing.assert_allclose(found, limit_of_the_gain(Phi, C, W, V_s, 100_000)[0], rtol=1e-6, atol=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("force", ["thrust", "measured"])
def test_knowing_the_force_costs_margin_and_no_stability(force):
    scenario = load_scenario("nominal_imu_uwb", (f"estimator.force={force}",))
    found = margins_report(scenario, hover_V(scenario))
    nominal, full = found["nominal"], found["full state"]
    assert nominal.spectral_radius < 1
    assert full.spectral_radius == pytest.approx(margins_report(SCENARIO, V)["full state"].spectral_radius, abs=1e-9)
    loop = input_loop(hover_loop(scenario), filter_V(scenario, hover_V(scenario)), scenario.sensors).loop
    for k, channel in enumerate(CONTROL_NAMES):
        factor = np.ones(4)
        factor[k] = nominal.channels[channel].gain_up
        assert spectral_radius(closed(loop, factor)) == pytest.approx(1, abs=1e-7)
    without = found["without uwb"]
    if force == "thrust":  # what nothing tells apart from the position stays what it is, and the attitude is held
        assert without.spectral_radius < 1
        assert without.channels["f_T"] is None
    else:  # the accelerometer moves force and bias together, and nothing ever tells them apart
        assert without.spectral_radius == pytest.approx(1, abs=1e-9)
        assert "not stable" in without.note


@pytest.mark.long
def test_where_nothing_holds_the_filter_a_line_says_so():
    scenario = load_scenario("imu_uwb")
    without = margins_report(scenario, hover_V(scenario))["without imu"]
    assert without.spectral_radius is without.channels is without.joint is None
    assert without.note == "the filter has no steady gain with these sensors"


def test_lost_position_leaves_the_attitude_loops(report):
    row = report["without uwb and camera"]
    assert row.lost == ("x", "y", "z", "x_dot", "y_dot", "z_dot")
    assert "eigenvalue 1" in row.note
    assert "nothing is fed back to f_T" in row.note
    assert row.channels["f_T"] is None
    assert row.spectral_radius < 1
    assert report["without imu"].channels["tau_z"] is None
    loop = LOOPS["without uwb and camera"].loop
    for k, channel in enumerate(CONTROL_NAMES[1:], 1):
        up = row.channels[channel].gain_up
        factor = np.ones(4)
        factor[k] = up
        assert spectral_radius(closed(loop, factor)) == pytest.approx(1, abs=1e-7)


@pytest.mark.long
@pytest.mark.parametrize("integrator", ["literal", "hold", "estimate"])
def test_report_is_json_for_every_integrator(integrator):
    scenario = Scenario(estimator=IntermittentFilter(integrator=integrator), sensors=("uwb", "imu"))
    report = margins_report(scenario, V)
    json.dumps(as_data(report), allow_nan=False)
    assert set(report) == {"nominal", "without uwb", "without imu", "true velocities", "full state"}
    assert all(row.spectral_radius < 1 for row in report.values())
    assert all(row.channels is not None for row in report.values())


def test_losing_the_estimates_velocities_costs_margin(report):
    full, nominal = report["full state"].joint, report["nominal"].joint
    assert full.sensitivity < report["true velocities"].joint.sensitivity < nominal.sensitivity


def test_without_sensors_there_are_no_margins():
    with pytest.raises(InputError, match="sensors: none"):
        margins_report(Scenario(sensors=()), V)
    with pytest.raises(InputError, match=r"V: shape \(3, 3\): must be \(9, 9\)"):
        margins_report(SCENARIO, np.eye(3))
    with pytest.raises(InputError, match="sonar"):
        input_loop(HOVER, V, ("sonar",))
