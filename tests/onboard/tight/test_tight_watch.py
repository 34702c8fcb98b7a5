"""The watch of the tight filter: what repeats itself, a silent imu, angles that lean, ranges that are off together."""

import numpy as np
import pytest

from ortilo_drake.flight.flight import FlightSimulator
from ortilo_drake.flight.metrics import loss_of
from ortilo_drake.loop.plain import plain_source
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.onboard.estimator.tight.inertial import quaternion_of
from ortilo_drake.onboard.estimator.tight.layout import (
    ACCEL,
    ADDITIVE,
    GYRO,
    N_INERTIAL,
    THETA,
    Q,
    make_layout,
    nominal_size,
)
from ortilo_drake.onboard.estimator.tight.model import aids_of, motion_of
from ortilo_drake.onboard.estimator.tight.ranges import take_ranges
from ortilo_drake.onboard.estimator.tight.tick import N_KEPT, Motion, propagate_to_now
from ortilo_drake.onboard.estimator.tight.watch import LAST, Watch, says_again, watch_angles, watch_ranges
from ortilo_drake.scenario import load_scenario

# As plain Python: the few steps here take less time than to compile them, and flights run them compiled.
propagate_to_now, take_ranges = plain_source(propagate_to_now), plain_source(take_ranges)
watch_angles, watch_ranges = plain_source(watch_angles), plain_source(watch_ranges)

SCENARIO = load_scenario("tight_imu_uwb")
H, T = SCENARIO.h, SCENARIO.estimator.watch.time
SHARE = 1.0 - np.exp(-H / T)
WATCH = Watch(SHARE, 1.0, 0.7, 4e-4, 1e-4, 1.0)
PLAIN = make_layout({}, 0)
RANGES = make_layout({"range_offset": 1}, 0)
HOVER = "planner={kind: hover, point: [8, 1, 1.5], duration: 15}"


def standing() -> tuple[np.ndarray, np.ndarray, np.ndarray, Motion]:
    """Return state, covariance, what is kept, and the motion of a vehicle that stands."""
    x, kept = np.zeros(nominal_size(PLAIN)), np.zeros(N_KEPT)
    x[Q], kept[5] = 1.0, 9.81
    return x, np.diag(np.full(PLAIN.n, 1e-4)), kept, motion_of(SCENARIO.estimator, PLAIN, SCENARIO)


def samples_at(now: float, rates: np.ndarray) -> np.ndarray:
    """Return a tick's samples with these body rates (n, 3), the last one now."""
    samples = np.zeros((len(rates), 11))
    samples[:, 0], samples[:, 10], samples[:, 5:8] = 1.0, 9.81, rates
    samples[:, 1] = now - H + H * np.arange(1, len(rates) + 1) / len(rates)
    return samples


def test_a_payload_is_said_again_if_it_is_the_last_one_bit_for_bit_and_not_empty() -> None:
    last = np.zeros(4)
    message = np.array([1.0, 0.1, 3.0, 4.0, 1.0, 1.0])
    assert not says_again(message, last)
    assert says_again(message, last)
    message[1] = 0.2  # the stamps of a stuck sensor go on
    assert says_again(message, last)
    message[2] = np.nextafter(3.0, 4.0)
    assert not says_again(message, last)
    blind = np.array([1.0, 0.3, -1.0, 0.0, -1.0, 0.0])
    assert not says_again(blind, last)
    assert not says_again(blind, last)  # a camera that sees nothing says so as often as it likes


def test_a_sample_that_repeats_the_last_is_none_unless_nothing_is_watched() -> None:
    x, C, kept, motion = standing()
    samples, residual = samples_at(H, np.array([[0.01, 0.0, 0.0], [0.01, 0.0, 0.0], [0.02, 0.0, 0.0]])), np.empty(3)
    assert propagate_to_now(x.copy(), C.copy(), kept.copy(), samples, H, motion, residual) == 2
    assert propagate_to_now(x, C, kept, samples, H, motion._replace(watches=False), residual) == 3


def test_a_silent_imus_biases_walk_at_the_rate_that_is_set_and_are_given_back() -> None:
    x, C, kept, motion = standing()
    rng, residual, now = np.random.default_rng(0), np.empty(3), 0.0
    x[ADDITIVE : ADDITIVE + 6] = 1e-3 * np.arange(1, 7)

    def tick(samples: np.ndarray) -> None:
        nonlocal now
        now += H
        propagate_to_now(x, C, kept, samples, now, motion, residual)

    for _ in range(5):
        tick(samples_at(now + H, 1e-3 * rng.normal(size=(8, 3))))
    before, variances = x[ADDITIVE : ADDITIVE + 6].copy(), np.diag(C)[GYRO:N_INERTIAL].copy()
    nothing = np.zeros((1, 11))
    for _ in range(30):
        tick(nothing)
    silent = 30 - 3  # the first 0.1 s are none
    walked = np.repeat(motion.silent, 3) * silent * H + motion.steps * 30 * H / H
    np.testing.assert_allclose(np.diag(C)[GYRO:N_INERTIAL] - variances, walked, rtol=1e-9)
    x[ADDITIVE : ADDITIVE + 6] += 0.1  # what ranges and boxes made of them
    tick(samples_at(now + H, 1e-3 * rng.normal(size=(8, 3))))
    np.testing.assert_array_equal(x[ADDITIVE : ADDITIVE + 6], before)
    at = slice(GYRO, N_INERTIAL)
    np.testing.assert_allclose(np.diag(C)[at], variances, rtol=1e-2)
    assert np.linalg.eigvalsh(C).min() > 0.0
    assert np.abs(C[GYRO:ACCEL, ACCEL:N_INERTIAL]).max() == 0.0


@pytest.mark.parametrize("lean", [1.5, 3.0])
def test_angles_that_lean_open_the_gyroscopes_bias_when_their_mean_passes_the_threshold(lean: float) -> None:
    C, watched = np.zeros((PLAIN.n, PLAIN.n)), np.zeros(LAST)
    expected = int(np.ceil(np.log(1.0 - WATCH.leans / lean) / np.log(1.0 - SHARE)))  # of 1 - (1 - a)^k
    opened = [watch_angles(C, watched, np.array([0.0, -lean, 0.0]), WATCH) for _ in range(expected)]
    assert opened == [False] * (expected - 1) + [True]
    np.testing.assert_allclose(np.diag(C)[GYRO:ACCEL], WATCH.gyroscope)
    np.testing.assert_allclose(np.diag(C)[THETA:GYRO], WATCH.attitude)
    assert not watched.any()


def test_the_watch_keeps_still_over_innovations_of_a_filter_that_is_right() -> None:
    rng, C, watched = np.random.default_rng(1), np.zeros((PLAIN.n, PLAIN.n)), np.zeros(LAST)
    means = []
    for normalized in rng.normal(size=(50_000, 3)):
        assert not watch_angles(C, watched, normalized, WATCH)
        means.append(watched[:3].copy())
    np.testing.assert_allclose(np.std(means), np.sqrt(SHARE / (2.0 - SHARE)), rtol=0.03)


def test_ranges_refused_on_one_side_open_what_they_have_in_common() -> None:
    C, watched = np.zeros((RANGES.n, RANGES.n)), np.zeros(LAST)
    for _ in range(200):
        assert not watch_ranges(C, watched, RANGES, 6, 6, 6, WATCH)  # a storm: half of them too long
        assert not watch_ranges(C, watched, RANGES, 0, 12, 2, WATCH)  # bursts: to both sides
        assert not watch_ranges(C, watched, RANGES, 0, 2, 2, WATCH)  # two tell nothing
    watched[:] = 0.0
    expected = int(np.ceil(np.log(1.0 - WATCH.sided) / np.log(1.0 - SHARE)))
    opened = [watch_ranges(C, watched, RANGES, 0, 12, -12, WATCH) for _ in range(expected)]
    assert opened == [False] * (expected - 1) + [True]
    assert C[RANGES.range_offset, RANGES.range_offset] == WATCH.offset


def test_an_error_that_all_ranges_have_in_common_is_found_once_it_is_opened() -> None:
    anchors = np.ascontiguousarray(SCENARIO.load_room().anchor_positions)
    p = np.array([1.0, -0.5, 1.2])
    message = np.concatenate(([1.0, 0.0], np.linalg.norm(p - anchors, axis=1) + 0.5, np.ones(len(anchors))))
    found = []
    for variance in (0.0, 1.0):
        x, C = np.zeros(nominal_size(RANGES)), np.zeros((RANGES.n, RANGES.n))
        x[0:3], x[Q : Q + 4] = p, quaternion_of(np.zeros(3))
        C[0, 0] = C[1, 1] = C[2, 2] = 0.01
        C[RANGES.range_offset, RANGES.range_offset] = variance
        aids = aids_of(SCENARIO.estimator, SCENARIO.load_room(), SCENARIO)._replace(
            range_noise=np.array([0.01, 0.0]), differences=False, gates=np.full(3, 10.0), huber=1e9
        )
        used, refused, longer = take_ranges(x, C, RANGES, message, aids, -1)
        found.append((used, refused, longer))
        if variance:
            # The linear problem's weighted least squares, with the prior: gradient of each range and a column of ones.
            A = np.column_stack(((p - anchors) / np.linalg.norm(p - anchors, axis=1)[:, None], np.ones(len(anchors))))
            normal = A.T @ A / 0.01**2 + np.diag([100.0, 100.0, 100.0, 1.0])
            expected = np.linalg.solve(normal, A.T @ np.full(len(anchors), 0.5) / 0.01**2)
            at = [0, 1, 2, ADDITIVE + RANGES.range_offset - GYRO]
            np.testing.assert_allclose(x[at] - [*p, 0.0], expected, atol=2e-4)
    assert found == [(0, len(anchors), len(anchors)), (len(anchors), 0, 0)]


@pytest.mark.long
@pytest.mark.parametrize(
    "fault",
    [
        "{kind: stuck, sensor: imu, start: 5.0, end: 8.0}",
        "{kind: gyro_bias, start: 5.0}",
        "{kind: clock_jump, start: 5.0}",
    ],
)
def test_the_tight_filter_flies_on_through_a_fault_and_is_right_again(fault: str) -> None:
    plain = load_scenario("tight_imu_uwb_yolo", ["camera.kind=projected", HOVER])
    errors = []
    for scenario in (
        plain,
        load_scenario("tight_imu_uwb_yolo", ["camera.kind=projected", HOVER, f"faults=[{fault}]"]),
    ):
        flight = FlightSimulator(scenario).fly(0)
        assert loss_of(flight) is None
        e = (flight["estimate"].values[:, :3] - flight["truth"].values[:, :3])[flight["time"].values > 11.0]
        errors.append(np.sqrt(np.mean(np.sum(e**2, axis=1))))
    assert errors[1] <= 1.5 * errors[0]


def test_a_watch_of_no_time_is_refused() -> None:
    with pytest.raises(InputError, match=r"watch\.time"):
        load_scenario("tight_imu_uwb", ["estimator.watch.time=0"])
