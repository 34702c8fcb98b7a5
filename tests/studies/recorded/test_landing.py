"""Landings are found by the IMU of made-up flights whose height is given, and not where there are none."""

import tracemalloc

import numpy as np
import pytest

from ortilo_drake.interop.recorded.map_file import FilterSettings, Map
from ortilo_drake.interop.recorded.recording import Imu
from ortilo_drake.model.typed_yaml import InputError, validate
from ortilo_drake.onboard.estimator.tight.layout import Q, V
from ortilo_drake.studies.recorded.filter_types import NO_AIDS, noise_of, nominal, states
from ortilo_drake.studies.recorded.imu_watch import RESTS
from ortilo_drake.studies.recorded.landing import TOUCHES, landings
from ortilo_drake.studies.recorded.passing import accumulate, empty_passing

STEP, FALLS = 1e-3, 2.5
END = 9.0


def height(t):
    """Return the height of a flight of END: on the floor to 1 s and from 7 s on, at 1.5 m from 3 to 4.5 s."""
    up, down = np.clip((t - 1.0) / 2.0, 0.0, 1.0), np.clip((t - 4.5) / FALLS, 0.0, 1.0)
    smooth = [u**3 * (10.0 - 15.0 * u + 6.0 * u**2) for u in (up, down)]  # speed and acceleration are 0 at both ends
    return 1.5 * (smooth[0] - smooth[1])


def flown(flights=1, lands=True, jolt=True, shaking=0.05) -> Imu:
    """Return the IMU of flights one after the other, with a motor's shaking while it runs, from 0.5 to 7.6 s."""
    rng = np.random.default_rng(2)
    t = np.arange(0.0, END, STEP)
    z = height(t) if lands else height(np.minimum(t, 4.0))
    runs = (t > 0.5) & (t < (7.6 if lands else np.inf))
    force = np.zeros((len(t), 3))
    force[:, 2] = 9.81 + np.gradient(np.gradient(z, t), t) + np.where(runs, 0.1, 0.01) * rng.standard_normal(len(t))
    rates = np.where(runs, shaking, 0.002)[:, None] * rng.standard_normal((len(t), 3))
    if jolt:
        force[(t > 7.2) & (t < 7.205), 2] += 8.0
        force[(t > 7.205) & (t < 7.21), 2] -= 8.0
    times = np.concatenate([t + k * END for k in range(flights)])
    return Imu(times, np.tile(rates, (flights, 1)), np.tile(force, (flights, 1)), None)


@pytest.mark.family
@pytest.mark.parametrize("flights", [1, 2])
def test_each_landing_is_found_when_the_floor_is_touched(flights) -> None:
    found = landings(flown(flights))
    t = np.arange(4.5, END, STEP)
    touched = t[np.flatnonzero(height(t) > TOUCHES)[-1]]
    assert len(found) == flights
    for k, one in enumerate(found):
        assert one.touched - k * END == pytest.approx(touched, abs=0.1)
        assert 7.6 < one.rests - k * END < 8.0


def test_a_hover_and_a_rest_without_a_flight_are_no_landings() -> None:
    assert landings(flown(lands=False, shaking=0.03)) == []
    imu = flown()
    floor = imu.t > 7.1  # jolted on the floor, and it never flew
    assert landings(Imu(imu.t[floor], imu.rates[floor], imu.force[floor], None)) == []
    assert landings(flown(jolt=False)) == []


def test_one_that_lands_must_have_rested() -> None:
    of = {
        "ranges": {"file": "r.csv", "time": "t", "values": ["a", "b", "c"]},
        "anchors": [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
        "start": {"position": [0, 0, 0], "lands": True},
    }
    with pytest.raises(InputError, match=r"lands: needs `rests: true`"):
        validate(Map, of, "MAP.yaml")


def test_long_recordings_take_no_more_room_than_a_few_copies_of_them() -> None:
    imu = flown(flights=4)
    tracemalloc.start()
    try:
        landings(imu)
        most = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert most < 10 * (imu.rates.nbytes + imu.force.nbytes)


def test_what_rests_stays_where_it_is_whatever_speed_was_left_of_the_landing() -> None:
    n = 4
    x = np.zeros(nominal(states(n)))
    x[:3], x[V : V + 3], x[Q] = [1.0, 2.0, 0.1], [0.02, -0.01, 0.03], 1.0
    before, watched, passing = x.copy(), np.array([1.0, 0.0, 0.0, 0.0, np.inf, np.inf, 0.0]), empty_passing(states(n))
    held = np.array([0.0, 0.0, 0.0, 0.3, -0.2, 9.7])
    accumulate(x, passing, 10.0, held, watched, 0.0, noise_of(FilterSettings(), True), NO_AIDS, False)
    np.testing.assert_array_equal(x[: V + 3], before[: V + 3])
    watched[RESTS] = 0.0
    accumulate(x, passing, 10.0, held, watched, 10.0, noise_of(FilterSettings(), True), NO_AIDS, False)
    assert np.abs(x[:3] - before[:3]).max() > 1.0
