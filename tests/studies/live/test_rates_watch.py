"""Body rates in another unit or of other signs are named by the ranges; those of recordings are not doubted."""

import numpy as np
import pytest
from live_messages import IMU, RANGES, START
from made_up_motion import ANCHORS, BIASES, LEVER, as_map, attitude, made_up, quick_place
from ortilo_flights import MAP, flight_folder
from plain_filter import run_plainly
from usd_logs import FLIGHTS, util_folder, util_map

from ortilo_drake.interop.recorded.live_rows import Block, parted
from ortilo_drake.interop.recorded.recording import Imu, read_recording
from ortilo_drake.studies.live import rates_watch
from ortilo_drake.studies.live.live_filter import LiveFilter
from ortilo_drake.studies.live.rates_watch import RatesWatch, rest_doubts
from ortilo_drake.studies.recorded.filter_types import FORCE, RANGE, RATES, Events, EventValues, State
from ortilo_drake.studies.recorded.imu_watch import watched_from
from ortilo_drake.studies.recorded.turn_filter import Ranging

RANGING = Ranging(ANCHORS, BIASES, np.tile(LEVER, (2, 1)), 0.1)
DEGREES = 180.0 / np.pi


def watched(monkeypatch, text: str, by: np.ndarray) -> str:
    """Return the doubt in 6 s of a made-up motion whose rates are multiplied by (3, 3), from its true start on."""
    run_plainly(monkeypatch, rates_watch, "follow")
    m, watch = made_up(6.0, place=quick_place), RatesWatch(as_map(RANGES + text))
    rates = m.imu[:, :3] @ by.T
    q = attitude(np.zeros(1)).as_quat()[0]
    x = np.zeros(40)
    x[:3], x[3:6] = quick_place(np.zeros(1))[0], (quick_place(np.full(1, 1e-4)) - quick_place(np.zeros(1)))[0] / 1e-4
    x[6:10] = q[[3, 0, 1, 2]]
    state = State(0.0, x, 0.01 * np.eye(39), np.concatenate((rates[0], m.imu[0, 3:])), watched_from(False))
    k, n = len(m.t_imu), m.r.shape[1]
    t = np.concatenate((np.repeat(m.t_imu, 2), np.repeat(m.t_r, n)))
    kind = np.concatenate((np.tile([RATES, FORCE], k), np.full(m.r.size, RANGE)))
    which = np.concatenate((np.repeat(np.arange(k), 2), np.tile(np.arange(n), len(m.t_r))))
    r, none = np.concatenate((np.zeros(2 * k), m.r.ravel())), np.zeros(len(t), np.int64)
    events = Events(*(column[np.argsort(t, kind="stable")] for column in (t, kind, which, none - 1, r, none)))
    heard = EventValues(rates, m.imu[:, 3:], np.zeros((0, 2)), np.zeros((0, 1, 1)))
    for begin in np.arange(0.0, 6.0, 0.1):
        now = (events.t >= begin - 1e-9) & (events.t < begin + 0.1 - 1e-9)
        part = Events(*(column[now] for column in events))
        watch.advance(part, heard, state._replace(t=begin + 0.1), RANGING, False)
    return watch.doubt


@pytest.mark.parametrize(
    ("text", "by", "said"),
    [
        (IMU, np.eye(3), ""),
        (IMU, DEGREES * np.eye(3), "{rate_unit: deg/s} fits"),
        (IMU.replace("/imu}", "/imu, rate_unit: deg/s}"), np.eye(3) / DEGREES, "{rate_unit: rad/s} fits"),
        (IMU, np.diag([1.0, 1.0, -1.0]), "{rate_axes: [x, y, -z]} fits"),
        (IMU, np.diag([-1.0, 1.0, 1.0]), "{rate_axes: [-x, y, z]} or anchors that are mirrored"),
        (IMU, np.diag([-1.0, -1.0, 1.0]), "{rate_axes: [-x, -y, z]} or a `heading`, or `axes`, turned by 180°"),
        (IMU.replace("/imu}", "/imu, axes: frd}"), np.diag([1.0, -1.0, -1.0]), "{rate_axes: [x, y, z]}"),
    ],
    ids=["right", "deg", "rad", "z", "x", "x and y", "flu for frd"],
)
def test_the_reading_of_the_rates_that_fits_is_named(monkeypatch, text, by, said) -> None:
    doubt = watched(monkeypatch, text, by)
    assert said in doubt
    assert bool(doubt) == bool(said)


@pytest.mark.parametrize(
    ("bias", "turns", "said"), [(0.3, 0.0, "rate_unit: deg/s} makes them 0.0052"), (0.3, 0.3, ""), (0.15, 0.0, "")]
)
def test_at_its_start_a_body_whose_rates_turn_it_but_not_its_force_is_refused(bias, turns, said) -> None:
    t = np.arange(0.0, 1.5, 0.01)
    force = 9.81 * np.column_stack([0.0 * t, np.sin(turns * t), np.cos(turns * t)])  # R' e_z of a body that rolls
    imu = Imu(t, np.tile([bias, 0.0, 0.0], (len(t), 1)), force, None)
    found = rest_doubts(imu, as_map(RANGES + IMU + START))
    assert len(found) == bool(said)
    assert said in "".join(found)
    assert rest_doubts(imu, as_map(RANGES + IMU.replace("/imu}", "/imu, standstill: 2}") + START)) == []


@pytest.mark.long
@pytest.mark.parametrize("name", [*FLIGHTS, "flight1", "flight2"])
def test_the_rates_of_a_recorded_flight_are_not_doubted(name) -> None:
    folder, map_ = (flight_folder(name), as_map(MAP)) if name.startswith("flight") else (util_folder() / name, None)
    map_ = map_ or as_map(util_map(name).replace("lands: true", "lands: false"))
    recording = read_recording(folder, map_)
    filter_, kept = (
        LiveFilter(map_, np.array(recording.anchors)),
        Block(recording.ranges, recording.imu, recording.looks),
    )
    for t in np.arange(0.5, recording.ranges.t[-1], 0.5):
        now, kept = parted(kept, t)
        filter_.advance(float(np.nextafter(t, np.inf)), now)
    assert filter_.begun
    assert filter_.rates is not None
    assert filter_.rates.doubt == ""
