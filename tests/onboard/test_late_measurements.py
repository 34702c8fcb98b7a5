"""Replay against the filter that got everything in order, against the joint Gaussian, and over many flights."""

import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from played_box import PlayedBox
from scipy.stats import chi2

from ortilo_drake.flight.flight import fly
from ortilo_drake.model.clock import history_ticks
from ortilo_drake.model.hover import discretize, disturbance_W, hover_A, hover_B, output_C
from ortilo_drake.model.measurement import make_measurement
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.model.vehicle import M100
from ortilo_drake.onboard.estimator.intermittent_filter import (
    INTEGRATOR_ESTIMATE,
    INTEGRATOR_HOLD,
    INTEGRATORS,
    FilterModel,
    filter_step,
    to_work_in,
)
from ortilo_drake.onboard.estimator.late_measurements import (
    Slot,
    empty_history,
    put_in,
    replay_in_place,
    row_of_past,
    slot_of,
    with_acted,
)
from ortilo_drake.onboard.estimator.replay_element import belief_at_stamp_box, kept_in
from ortilo_drake.scenario import load_scenario

H = 1.0 / 30.0
PHI, GAMMA = discretize(hover_A(), hover_B(M100), H)
C = output_C()
W = disturbance_W(M100, H, 0.27, 0.005)
P_0 = np.diag([*np.repeat(np.square([0.05, 0.02, 0.05, 0.05]), 3), 0.0, 0.0, 0.0])
V2 = np.array([np.diag([0.01, 0.02, 0.03]), np.diag([0.02, 0.01, 0.04]), np.diag([1e-4, 2e-4, 3e-4])])
MEASURED = make_measurement()
LAYOUT, SLOT = MEASURED.layout, slot_of(MEASURED)
Measured = tuple[np.ndarray, np.ndarray, np.ndarray]
TICKS = 24
LOST = 99
SHORT = ("planner={kind: waypoints, points: [[0, 0, 1.5], [2.2, 0.9, 1.5]]}", "uwb.link.blackouts=[]")


def replay_step(history: np.ndarray, slot: Slot, belief: np.ndarray, k: int, *others: Any) -> np.ndarray:
    """Return the belief of tick k + 1; arguments as replay_in_place."""
    after, layout = belief.copy(), others[-1]
    replay_in_place(*to_work_in(len(P_0), layout.first[-1]), history, slot, after, k, *others)
    return after


Given = dict[tuple[int, int], int]  # (tick, sensor) of a measurement -> tick of its arrival


class Data:
    """What is measured, commanded and asked for in each tick, at random; row k of ys is y_k with everything there."""

    def __init__(self, seed: int, ticks: int = TICKS):
        rng = np.random.default_rng(seed)
        self.ys, self.us, self.rs = (rng.normal(size=(ticks, n)) for n in (9, 4, 9))

    def measurement(self, rows: dict[int, int]) -> Measured:
        """The handler's y, delta and V2, each sensor's rows taken from the tick named."""
        y, delta = np.zeros(9), np.zeros(3)
        for sensor, j in rows.items():
            y[3 * sensor : 3 * sensor + 3], delta[sensor] = self.ys[j, 3 * sensor : 3 * sensor + 3], 1.0
        return y, delta, V2.ravel()


def in_order(data: Data, there: set[tuple[int, int]], k: int, integrator: int) -> np.ndarray:
    """xhat_{k+1|k} and P_{k+1} of the plain filter that has those measurements in their own ticks."""
    state = np.concatenate([np.zeros(15), P_0.ravel()])
    for j in range(k + 1):
        measurement = data.measurement({s: j for s in range(3) if (j, s) in there})
        model = FilterModel.of(PHI, GAMMA, W, integrator)
        state = filter_step(state, *measurement, data.us[j], data.rs[j], model, LAYOUT)
    return state


def delivered(delays: list[int]) -> Given:
    """Arrivals of the message of each tick and sensor; of two of a sensor in one tick the newer is delivered."""
    last: dict[tuple[int, int], int] = {}
    for n, d in enumerate(delays):
        j, s = divmod(n, 3)
        if d != LOST:
            last[j + d, s] = j
    return {(j, s): k for (k, s), j in last.items()}


def replayed(data: Data, arrivals: Given, history: np.ndarray, integrator: int) -> list[np.ndarray]:
    """The replaying filter's [xhat, P] after each tick."""
    state, states = np.concatenate([np.zeros(15), P_0.ravel()]), []
    for k in range(TICKS):
        rows = {s: j for (j, s), when in arrivals.items() if when == k}
        stamps = np.array([rows.get(s, 0) * H for s in range(3)])
        state = replay_step(
            history, SLOT, state, k, *data.measurement(rows), stamps, H, data.us[k], data.rs[k],
            FilterModel.of(PHI, GAMMA, W, integrator), LAYOUT,
        )  # fmt: skip
        states.append(state)
    return states


@pytest.mark.long
@given(
    delays=st.lists(st.sampled_from([0, 0, 1, 2, 3, 5, 9, LOST]), min_size=3 * TICKS, max_size=3 * TICKS),
    integrator=st.sampled_from(sorted(INTEGRATORS.values())),
    kept=st.sampled_from([1, 2, 4, 7, 30]),
    seed=st.integers(0, 1000),
)
@settings(max_examples=60, deadline=None)
def test_after_every_tick_replay_is_the_filter_that_got_it_all_in_order(
    delays: list[int], integrator: int, kept: int, seed: int
) -> None:
    data, arrivals = Data(seed), delivered(delays)
    states = replayed(data, arrivals, empty_history(kept, SLOT), integrator)
    for k in (*range(0, TICKS, 5), TICKS - 1):
        in_time = {(j, s) for (j, s), when in arrivals.items() if when <= k and when - j < kept}
        np.testing.assert_array_equal(states[k], in_order(data, in_time, k, integrator))  # bit for bit


@pytest.mark.parametrize("stamped", [2, 8, 9])
def test_what_was_measured_before_a_restart_is_not_used(stamped: int) -> None:
    """Ticks 10 to 15 were never flown: through them the filter cannot be run again."""
    data, history = Data(7), empty_history(20, SLOT)
    state = np.concatenate([np.zeros(15), P_0.ravel()])

    def step(k: int, rows: dict[int, int], into: np.ndarray) -> np.ndarray:
        stamps = np.array([rows.get(s, 0) * H for s in range(3)])
        given = *data.measurement(rows), stamps, H, data.us[k], data.rs[k]
        return replay_step(into, SLOT, state, k, *given, FilterModel.of(PHI, GAMMA, W, INTEGRATOR_HOLD), LAYOUT)

    for k in range(10):
        state = step(k, {0: k, 2: k} if k != stamped else {2: k}, history)
    for k in (16, 17):
        without = step(k, {}, history.copy())
        np.testing.assert_array_equal(step(k, {0: stamped}, history.copy()), without)
        assert np.any(step(k, {0: 16}, history.copy()) != without)
        state = step(k, {}, history)


def test_replay_is_the_conditional_mean_of_the_joint_gaussian() -> None:
    """x_{k+1} given all measurements, by conditioning the joint Gaussian of all states at once."""
    k, rng = 9, np.random.default_rng(5)
    data = Data(5)
    arrivals = {(j, s): j + int(rng.integers(0, 4)) for j in range(k + 1) for s in range(3)}
    arrivals = {key: when for key, when in arrivals.items() if when <= k}
    arrivals = {(j, s): when for (when, s), j in {(w, s): j for (j, s), w in arrivals.items()}.items()}
    ours = replayed(data, arrivals, empty_history(20, SLOT), INTEGRATOR_ESTIMATE)[k]
    n = k + 2
    mean, cov = np.zeros((n, 12)), np.zeros((n, 12, n, 12))
    cov[0, :, 0] = P_0[:12, :12]
    for j in range(n - 1):
        mean[j + 1] = PHI @ mean[j] + GAMMA @ data.us[j]
        for i in range(j + 1):
            cov[j + 1, :, i] = PHI @ cov[j, :, i]
            cov[i, :, j + 1] = cov[j + 1, :, i].T
        cov[j + 1, :, j + 1] = PHI @ cov[j, :, j] @ PHI.T + W
    H_all = np.zeros((3 * len(arrivals), n, 12))
    y, R = np.zeros(len(H_all)), np.zeros((len(H_all), len(H_all)))
    for row, (j, s) in enumerate(arrivals):
        rows = slice(3 * row, 3 * row + 3)
        H_all[rows, j], y[rows], R[rows, rows] = C[3 * s : 3 * s + 3], data.ys[j, 3 * s : 3 * s + 3], V2[s]
    H_all, joint = H_all.reshape(len(y), -1), cov.reshape(12 * n, 12 * n)
    gain = np.linalg.solve(H_all @ joint @ H_all.T + R, H_all @ joint).T
    x = mean.ravel() + gain @ (y - H_all @ mean.ravel())
    P = joint - gain @ H_all @ joint
    assert len(arrivals) >= 15
    assert any(when > j for (j, _), when in arrivals.items())
    np.testing.assert_allclose(ours[:12], x[-12:], rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(ours[15:].reshape(15, 15)[:12, :12], P[-12:, -12:], rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("integrator", INTEGRATORS.values(), ids=INTEGRATORS)
def test_a_second_message_for_a_filled_tick_is_not_applied(integrator: int) -> None:
    data = Data(6)
    once, twice = ([np.concatenate([np.zeros(15), P_0.ravel()]), empty_history(10, SLOT)] for _ in range(2))
    for k in range(12):
        # The uwb of tick 4 comes in tick 5 and again, with another value, in ticks 6 and 7.
        for run, late in ((once, k == 5), (twice, k in (5, 6, 7))):
            measurement = data.measurement({2: k} | ({0: k - 1} if late else {}))
            stamps = np.array([4 * H, 0.0, k * H])
            state, history = run
            run[0] = replay_step(
                history, SLOT, state, k, *measurement, stamps, H, data.us[k], data.rs[k],
                FilterModel.of(PHI, GAMMA, W, integrator), LAYOUT,
            )  # fmt: skip
        np.testing.assert_array_equal(once[0], twice[0])
    y, _, blocks = data.measurement({0: 0, 2: 0})
    assert not put_in(once[1][7].copy(), SLOT, y, blocks, 2, LAYOUT.first, LAYOUT.block)
    assert put_in(once[1][7].copy(), SLOT, y, blocks, 0, LAYOUT.first, LAYOUT.block)


@pytest.mark.parametrize("stamp", [np.nan, np.inf, -np.inf, 1e300, -5.0, 9 * H])
def test_a_stamp_that_cannot_be_is_not_used(stamp: float) -> None:
    data, history = Data(7), empty_history(6, SLOT)
    state = np.concatenate([np.zeros(15), P_0.ravel()])
    for k in range(8):
        rows = {0: k} if k == 7 else {}
        stamps = np.array([stamp, 0.0, 0.0])
        state = replay_step(
            history, SLOT, state, k, *data.measurement(rows), stamps, H, data.us[k], data.rs[k],
            FilterModel.of(PHI, GAMMA, W, INTEGRATOR_HOLD), LAYOUT,
        )  # fmt: skip
    np.testing.assert_array_equal(state, in_order(data, set(), 7, INTEGRATOR_HOLD))


def test_the_history_is_as_long_as_the_horizon() -> None:
    assert [history_ticks(s, 1 / 30) for s in (0.5, 0.1, 1 / 30, 0.03, 1e-3)] == [16, 4, 2, 1, 1]
    assert history_ticks(0.5, 0.01) == 51


@pytest.mark.long
def test_flying_straight_with_late_measurements_only_replay_is_consistent() -> None:
    """The linear plant at 1 m/s, every message 1 to 3 ticks late: NEES of the position over independent flights."""
    runs, rng = 150, np.random.default_rng(8)
    size, axes = np.linalg.eigh(W)  # of rank 6
    root_W, root_P, root_V = axes * np.sqrt(np.maximum(size, 0.0)), np.sqrt(P_0[:12, :12]), np.sqrt(V2)
    nees = {"replay": np.zeros(runs), "ignore": np.zeros(runs)}
    for run in range(runs):
        start = np.zeros(15)
        start[6:8] = 1.0, 0.5
        x = start[:12] + root_P @ rng.normal(size=12)
        replay = ignore = np.concatenate([start, P_0.ravel()])
        history, data = empty_history(16, SLOT), Data(0, 60)
        data.us[:] = 0.0
        arrivals = delivered([int(d) for d in rng.integers(1, 4, 180)])
        for k in range(60):
            v = np.concatenate([root_V[s] @ rng.normal(size=3) for s in range(3)])
            data.ys[k] = C @ x + v
            rows = {s: j for (j, s), when in arrivals.items() if when == k}
            stamps = np.array([rows.get(s, 0) * H for s in range(3)])
            m, u, r = data.measurement(rows), data.us[k], data.rs[k]
            model = FilterModel.of(PHI, GAMMA, W, INTEGRATOR_ESTIMATE)
            replay = replay_step(history, SLOT, replay, k, *m, stamps, H, u, r, model, LAYOUT)
            ignore = filter_step(ignore, *m, u, r, model, LAYOUT)
            x = PHI @ x + root_W @ rng.normal(size=12)
        for mode, state in (("replay", replay), ("ignore", ignore)):
            e = state[:3] - x[:3]
            nees[mode][run] = e @ np.linalg.solve(state[15:].reshape(15, 15)[:3, :3], e)
    low, high = chi2.ppf([0.0005, 0.9995], 3 * runs) / runs
    assert low < nees["replay"].mean() < high
    assert nees["ignore"].mean() > 1.5 * high


@pytest.mark.long
def test_without_delay_a_flight_in_replay_is_the_flight_in_ignore() -> None:
    flights = [
        fly(load_scenario("nominal_imu_uwb", (*SHORT, f"estimator.delay={mode}"), 3))
        for mode in ("ignore", "replay", "drop")
    ]
    for name in ("truth", "estimate", "covariance", "control"):
        for other in flights[1:]:
            np.testing.assert_array_equal(flights[0][name].values, other[name].values)


@pytest.mark.long
def test_replay_knows_exactly_where_a_calm_linear_vehicle_is() -> None:
    """Everything two ticks late, nothing noisy: fixes and estimate are exact if all was put into its own tick."""
    calm = (
        *SHORT, "world={kinematics: linear, disturbance: {force_density: 0, torque_density: 0}}",
        "uwb.noise.fraction=0",
        "imu.angle_density=0", "uwb.link.delay=2", "imu.link.delay=2", "camera.kind=projected", "camera.link.delay=1",
        "camera.errors={kind: parametric, edge_sd: 0, miss_base: 0, miss_per_metre: 0, false_boxes: 0}",
    )  # fmt: skip
    worst = {}
    for mode in ("ignore", "replay"):
        flight = fly(load_scenario("nominal_imu_uwb_yolo", (*calm, f"estimator.delay={mode}"), 0))
        assert flight["arrival"].values.any(axis=0).all()
        worst[mode] = np.abs(flight["estimate"].values[:, :3] - flight["truth"].values[:, :3]).max()
    assert worst["replay"] < 1e-12
    assert worst["ignore"] > 0.01


def test_the_belief_of_a_message_is_that_of_the_tick_of_its_stamp() -> None:
    """Cases: arrived, tick of the stamp, tick whose belief is given; 99 stands for the present one."""
    past = PlayedBox(belief_at_stamp_box("camera_belief_at_stamp", MEASURED, 15, H), H)
    present = [np.full(15, 99.0), P_0.ravel()]
    history = empty_history(4, SLOT)
    for k in range(3, 7):
        history[k % 4, SLOT.tick], history[k % 4, SLOT.belief : SLOT.y] = k, k
    cases = [(1, 5, 5), (1, 6, 6), (1, 3, 3), (1, 0, 3), (1, 7, 99), (1, 8, 99), (0, 5, 99)]
    for kept, (arrived, j, found) in [*((history, c) for c in cases), (empty_history(4, SLOT), (1, 0, 99))]:
        memory = np.concatenate([*present, kept.ravel()])
        belief = past.say(message=np.array([arrived, j * H, 0.0, 0.0, 0.0]), memory=memory)
        np.testing.assert_array_equal(belief[:15], np.full(15, found))
        np.testing.assert_array_equal(belief[15:], P_0.ravel() if found == 99 else np.full(225, found))


@pytest.mark.parametrize(
    ("setting", "named"),
    [
        ("estimator.horizon=0", "estimator.horizon"),
        ("estimator.horizon=3", "estimator.horizon"),
        ("estimator.delay=later", "estimator.delay"),
    ],
)
def test_settings_that_cannot_be_are_refused(setting: str, named: str) -> None:
    with pytest.raises(InputError, match=named):
        load_scenario("nominal_imu_uwb", (setting,))


def test_the_row_of_a_tick_is_its_own_or_the_oldest_before_it_and_none_after() -> None:
    history = empty_history(4, SLOT)
    assert [row_of_past(history, j) for j in (-1, 0, 5)] == [-1, -1, -1]
    history[[0, 1, 2, 3], SLOT.tick] = [8, 9, 6, 7]  # tick j is in row j mod 4
    assert [row_of_past(history, j) for j in (6, 7, 8, 9)] == [2, 3, 0, 1]
    assert [row_of_past(history, j) for j in (5, 0, -3)] == [2, 2, 2]
    assert row_of_past(history, 10) == -1
    history[[0, 1, 2, 3], SLOT.tick] = [4, 5, 6, 7]
    assert row_of_past(history, 3) == 0


@pytest.mark.long
@given(
    delays=st.lists(st.sampled_from([0, 1, 2, 5, LOST]), min_size=3 * TICKS, max_size=3 * TICKS),
    late=st.integers(0, 4),
    heard=st.lists(st.integers(1, 6), min_size=TICKS, max_size=TICKS),
    seed=st.integers(0, 1000),
)
@settings(max_examples=30, deadline=None)
def test_once_it_is_known_what_acted_it_is_the_filter_that_knew(
    delays: list[int], late: int, heard: list[int], seed: int
) -> None:
    """Until then each tick goes by a guess: hovering. What acted in tick j is known from tick j + heard[j] on."""
    data, arrivals = Data(seed), delivered(delays)
    data.us[:] = 0.1 * data.us
    true = Data(seed)
    true.us = np.vstack([np.zeros((late, 4)), data.us])[:TICKS]  # a command acts so many ticks late
    history, model = empty_history(30, SLOT), FilterModel.of(PHI, GAMMA, W, INTEGRATOR_HOLD)
    state, hover = np.concatenate([np.zeros(15), P_0.ravel()]), np.zeros(4)
    for k in range(TICKS):
        known = [j for j in range(k) if j + heard[j] <= k]
        acts = np.array([true.us[j] if j in known else hover for j in range(k)]).reshape(-1, 4)
        timeline = np.vstack([[-1.0, *hover], np.column_stack([np.arange(k) * H, acts])])
        state = with_acted(history, SLOT, state, k, timeline, hover, H, model, LAYOUT)
        rows = {s: j for (j, s), when in arrivals.items() if when == k}
        stamps = np.array([rows.get(s, 0) * H for s in range(3)])
        last = k == TICKS - 1
        u = true.us[k] if last else hover
        measured = data.measurement(rows)
        if last:  # all is known by now
            timeline[1:, 1:] = true.us[:k]
            state = with_acted(history, SLOT, state, k, timeline, hover, H, model, LAYOUT)
        state = replay_step(history, SLOT, state, k, *measured, stamps, H, u, data.rs[k], model, LAYOUT)
    there = {(j, s) for (j, s), when in arrivals.items() if when < TICKS}
    expected = in_order(true, there, TICKS - 1, INTEGRATOR_HOLD)
    np.testing.assert_allclose(state, expected, rtol=1e-9, atol=1e-10)


def test_parts_of_a_memory_hold_it_also_once_compiled_for_code_that_counts_no_holders() -> None:
    """A helper that itself says _nrt=False, and returns arrays, leaves its caller with numbers that are freed."""

    @njit(_nrt=False)
    def uncounted(memory: np.ndarray, slot: Slot) -> float:
        belief, history = kept_in(memory, slot)
        return belief[0] + history[0, 0]

    @njit
    def counted(memory: np.ndarray, slot: Slot) -> tuple[np.ndarray, np.ndarray]:
        return kept_in(memory, slot)

    memory = np.arange(float(SLOT.y - SLOT.belief + 3 * SLOT.size))
    assert uncounted(memory, SLOT) == SLOT.y - SLOT.belief
    holders = sys.getrefcount(memory)
    belief, history = counted(memory, SLOT)
    assert sys.getrefcount(memory) > holders
    assert belief.size + history.size == memory.size
