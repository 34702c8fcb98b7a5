"""Delayed commands: closed forms, a finely sampled plant, and the lossless case of the jump-linear matrices."""

import math

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

from ortilo_drake.model.hover import discretize, hover_A, hover_B
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.servo.lq_gain import servo_gain
from ortilo_drake.scenario import ServoWeights, load_scenario
from ortilo_drake.studies.command_link.command_loop import CommandedLoop, behind_a_link, commanded_loop
from ortilo_drake.studies.command_link.command_report import critical_delay, delay_growth, delayed_matrices, growth

V = block_diag(np.diag([0.015, 0.018, 0.04]) ** 2, np.eye(3), 1e-4 * np.eye(3))
SCENARIO = load_scenario("nominal_imu_uwb")
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
