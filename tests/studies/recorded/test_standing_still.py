"""An IMU that stands still before a recorded motion: what is found of its biases, against those that were made."""

import numpy as np
import pytest
from made_up_motion import ANCHORS, GRAVITY, TABLE_MAP, made_up, write_tables
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import FilterSettings, Map
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording, read_recording
from ortilo_drake.model.typed_yaml import InputError, parse_yaml, validate
from ortilo_drake.onboard.estimator.tight.layout import ACCEL, GYRO, THETA, Q
from ortilo_drake.studies.recorded.at_rest import at_rest, correct_by_rest, standstill_doubts, unlevel
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import estimate
from ortilo_drake.studies.recorded.replayed import replay

T, RATE, LASTS = 10.0, 100.0, 40.0
GYRO_BIAS, FORCE_BIAS = np.array([0.004, -0.002, 0.003]), np.array([0.15, -0.1, 0.2])
GYRO_SD, FORCE_SD = 0.002, 0.03
WALKS = (1e-5, 1e-4)  # of the biases that the filter believes


def as_map(extra="standstill: 10") -> Map:
    text = TABLE_MAP.replace("force: [fx, fy, fz]}", f"force: [fx, fy, fz], {extra}}}")
    filter_ = f"filter: {{rotation_bias: {WALKS[0]:f}, acceleration_bias: {WALKS[1]:f}}}"
    return validate(Map, parse_yaml(text + filter_, "MAP.yaml"), "MAP.yaml")


def place(t):
    """Stand still for T seconds and 1 s more, then go around."""
    s = np.clip((t - T - 1.0) / 4.0, 0.0, None)
    s = 4.0 * np.where(s < 1.0, s**3 * (1.0 - 0.5 * s), s - 0.5)  # acceleration rises from 0 and is continuous
    return np.column_stack([3 + 1.8 * np.sin(0.5 * s), 4 + 2.5 * np.sin(0.37 * s), 1.4 + 0.6 * np.sin(0.61 * s)])


def standing(seed=0, tilt=(0.0, 0.0, 0.0), attitude=None) -> Recording:
    """Return ranges and imu of that motion, whose body keeps one tilt; its unit says `attitude`, or none."""
    rng, R = np.random.default_rng(seed), Rotation.from_rotvec(tilt)
    t, t_r, h = np.arange(0.0, LASTS, 1.0 / RATE), np.arange(0.05, LASTS, 0.05), 1e-3
    a = (place(t + h) - 2.0 * place(t) + place(t - h)) / h**2
    force = R.inv().apply(a + [0, 0, GRAVITY]) + FORCE_BIAS + FORCE_SD * rng.standard_normal((len(t), 3))
    rates = np.tile(GYRO_BIAS, (len(t), 1)) + GYRO_SD * rng.standard_normal((len(t), 3))
    said = None if attitude is None else np.tile(attitude, (len(t), 1, 1))
    r = np.linalg.norm(place(t_r)[:, None] - ANCHORS, axis=2) + 0.03 * rng.standard_normal((len(t_r), len(ANCHORS)))
    every = np.arange(len(ANCHORS))
    ranges = single_ranges(np.repeat(t_r, len(every)), np.tile(every, len(t_r)), r.ravel())
    return Recording("standing", ranges, Imu(t, rates, force, said), None, ANCHORS, 0.0, 0.0, [], {})


def test_the_gyros_bias_and_bias_and_level_together_are_found() -> None:
    """Many seeds: errors are those of a mean of T RATE white samples, and of a walk's mean, whose end is the bias."""
    e = []
    level = Rotation.from_euler("YX", [0.01, -0.02])  # of the body; the unit says that it is level
    of_gravity = level.inv().apply([0, 0, GRAVITY]) - [0, 0, GRAVITY]
    for seed in range(60):
        rest = at_rest(standing(seed, level.as_rotvec(), np.eye(3)), as_map())
        assert rest is not None
        e.append(np.append(rest.rates - GYRO_BIAS, unlevel(rest, np.eye(3)) - FORCE_BIAS - of_gravity))
    white = np.repeat([GYRO_SD, FORCE_SD], 3) / np.sqrt(T * RATE)
    np.testing.assert_allclose(np.std(e, axis=0), white, rtol=0.4)
    assert (np.abs(np.mean(e, axis=0)) < 4.0 * white / np.sqrt(60)).all()
    walks = np.repeat(WALKS, 3) * np.sqrt(T / 3.0)
    np.testing.assert_allclose([*rest.rates_sd, *rest.force_sd], np.hypot(white, walks), rtol=0.6)


def test_the_first_covariance_is_that_of_bias_and_level_given_their_sum() -> None:
    """Against the normal law conditioned on sums: b + g x theta = what was said, axis by axis where it is level."""
    rest = at_rest(standing(attitude=np.eye(3)), as_map())
    x, sd = np.zeros(17), np.repeat([1.0, 1.0, 0.05, 0.01, 0.3], 3)
    x[Q], C = 1.0, np.diag(sd**2)
    correct_by_rest(rest, x, C)
    nu = rest.force_sd[0]
    # f_x = b_x - g theta_y + nu
    prior, sums = np.diag([0.3**2, 0.05**2]), np.array([1.0, -GRAVITY])
    gain = prior @ sums / (sums @ prior @ sums + nu**2)
    both = [ACCEL, THETA + 1]
    np.testing.assert_allclose(C[np.ix_(both, both)], prior - np.outer(gain, sums @ prior), atol=1e-9)
    e = gain * rest.force[0]
    assert x[Q + 7] == pytest.approx(e[0], rel=1e-9)
    assert Rotation.from_quat(x[Q : Q + 4], scalar_first=True).as_rotvec()[1] == pytest.approx(e[1], rel=1e-3)
    known = 1.0 / (1.0 / 0.01**2 + 1.0 / np.square(rest.rates_sd))
    np.testing.assert_allclose(np.diag(C)[GYRO : GYRO + 3], known, rtol=1e-9)
    assert np.sqrt(sums @ C[np.ix_(both, both)] @ sums) == pytest.approx(nu, rel=1e-3)


@pytest.mark.long
@pytest.mark.parametrize("attitude", [None, np.eye(3)], ids=["level by the force", "level by the unit"])
def test_a_blackout_after_standing_still_is_flown_by_what_was_found(attitude) -> None:
    """Ranges begin when the body moves, and are gone again two seconds later, for six."""
    e = {extra: [] for extra in ("standstill: 0", "standstill: 10")}
    squares = []
    for seed in range(6):
        recording = standing(seed, (0.02, -0.01, 0.0), attitude)
        t = recording.ranges.t
        heard = recording.ranges.only(np.flatnonzero((t > T) & (t < T + 2.0)))
        for extra, errors in e.items():
            map_ = as_map(extra)
            known = FilterSetup(ANCHORS, np.zeros(len(ANCHORS)), np.zeros(3), 0.0, rest=at_rest(recording, map_))
            settings = FilterSettings(
                rotation=2e-4, acceleration=3e-3, rotation_bias=WALKS[0], acceleration_bias=WALKS[1]
            )
            found = estimate(heard, recording.imu, known, settings, np.array([T + 7.9]))
            errors.append(found.p[0] - place(found.t)[0])
        squares.append(errors[-1] @ np.linalg.solve(found.P[0], errors[-1]))
    before, after = (np.sqrt(np.mean(np.square(errors))) for errors in e.values())
    assert after < 0.5 * before
    assert np.mean(squares) < 3.0 + 4.0 * np.sqrt(6.0 / 6)


def test_what_moves_is_doubted_and_what_is_too_short_refused(tmp_path) -> None:
    assert standstill_doubts(at_rest(standing(), as_map())) == []
    said = standstill_doubts(at_rest(standing(), as_map("standstill: 30")))
    assert "does not stand still until 30.0 s" in said[0]
    with pytest.raises(InputError, match=r"imu.standstill: 60: there are no samples"):
        at_rest(standing(), as_map("standstill: 60"))
    with pytest.raises(InputError, match=r"standstill: 1: must be 0 or at least 2"):
        as_map("standstill: 1")


@pytest.mark.long
def test_a_replay_says_what_was_found_and_begins_after_it(tmp_path) -> None:
    motion = made_up(20.0, place=place)
    folder = write_tables(tmp_path / "standing", motion)
    found, drawn = replay(read_recording(folder, as_map("standstill: 2")), as_map("standstill: 2"), lambda _: None)
    note = next(note for note in found.notes if note.startswith("Standing still, 100 samples: gyro bias"))
    assert "level by the force itself" in note
    assert found.rest.end == pytest.approx(2.0 - 0.05)
    assert min(drawn["with IMU"][0].range_stamps) >= found.rest.end
    assert any("imu.standstill" in doubt for doubt in found.doubts)  # its attitude turns all the time
