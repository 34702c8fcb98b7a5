"""A heading that accelerations and ranges contradict, beside the true one of a made-up motion."""

import numpy as np
import pytest
from live_messages import IMU, RANGES
from made_up_motion import ANCHORS, as_map, made_up, quick_place
from ortilo_flights import MAP, flight_folder
from scipy.spatial.transform import Rotation
from usd_logs import FLIGHTS, util_folder, util_map

from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording, read_recording
from ortilo_drake.loop.plain import plain_source
from ortilo_drake.onboard.estimator.tight.layout import ADDITIVE, Q
from ortilo_drake.studies.recorded.at_rest import at_rest
from ortilo_drake.studies.recorded.filter_types import FORCE, RANGE, RATES, Events, EventValues, State, setup_of
from ortilo_drake.studies.recorded.filtered import Begin, begin_of, events_of
from ortilo_drake.studies.recorded.heading_doubts import HeadingDoubt, MirrorDoubt, heading_doubts
from ortilo_drake.studies.recorded.setups import uncalibrated_setup
from ortilo_drake.studies.recorded.turn_filter import Ranging, follow, turn_filter, turn_found

TRUE = 0.5  # of the made-up motion at its start [rad]


def still_place(t):
    return np.tile([3.0, 4.0, 1.4], (len(t), 1))


def recorded(place, turned=0.0, duration=15.0) -> Recording:
    """Return a made-up motion whose imu is mounted turned about z."""
    m = made_up(duration, place=place)
    t = m.t_r - m.t_r[0]
    ranges = single_ranges(np.repeat(t, 6), np.tile(np.arange(6), len(t)), m.r.ravel())
    rates, force = (Rotation.from_euler("z", turned).inv().apply(part) for part in (m.imu[:, :3], m.imu[:, 3:]))
    return Recording(
        "made up", ranges, Imu(m.t_imu - m.t_r[0], rates, force, None), None, ANCHORS, m.t_r[0], 0.0, [], {}
    )


def doubted(recording, map_) -> list[HeadingDoubt]:
    known = uncalibrated_setup(recording, map_, at_rest(recording, map_))
    begin = Begin(known.heading, None)
    if known.heading is None:
        ranges, imu = recording.ranges, recording.imu
        events = events_of(ranges, imu, known, np.zeros(0), float(ranges.t[0]))
        begin = begin_of(ranges, imu, known, map_.filter, setup_of(known, map_.filter, True), *events)
    return heading_doubts(recording, known, map_.filter, begin)


def started(place, heading):
    return as_map(
        f"{RANGES}{IMU}start: {{position: {place(np.zeros(1))[0].tolist()}, position_sd: 0.1, heading: {heading}}}\n"
    )


@pytest.mark.long
@pytest.mark.parametrize("off", [np.pi / 4, -np.pi / 2, np.pi])
@pytest.mark.parametrize("turned", [False, True], ids=["heading", "imu"])
def test_a_wrong_heading_and_an_imu_turned_about_z_are_told_with_the_angle(off, turned) -> None:
    recording = recorded(quick_place, off if turned else 0.0)
    (found,) = doubted(recording, started(quick_place, TRUE if turned else TRUE + off))
    assert found.t < 6.0
    wrong = -off if turned else off  # the imu's forward is turned to the left of the nose: its heading is larger
    assert abs(np.angle(np.exp(1j * (found.off - wrong)))) < 3.0 * found.sd + 0.03
    assert abs(np.angle(np.exp(1j * (found.start - (TRUE + off if turned else TRUE))))) < 3.0 * found.sd + 0.03
    assert f"{np.degrees(found.off):+.0f}°" in found.text()


@pytest.mark.long
@pytest.mark.parametrize(
    ("mirror", "which"),
    [
        ([[0, 1, 0], [1, 0, 0], [0, 0, 1]], "of all anchors x and y exchanged?"),
        (np.diag([-1, 1, 1]), "of all anchors the sign of x wrong?"),
        (np.diag([1, -1, 1]), "of all anchors the sign of y wrong?"),
    ],
)
def test_a_mirror_image_of_the_room_is_named_though_the_ranges_fit_it(mirror, which) -> None:
    """Every range fits the mirrored path exactly as well: the imu alone tells, and no heading is right."""
    M = np.array(mirror, dtype=float)
    recording = recorded(quick_place)._replace(anchors=ANCHORS @ M.T)
    (found,) = doubted(recording, started(lambda t: quick_place(t) @ M.T, TRUE))
    assert isinstance(found, MirrorDoubt)
    assert found.t < 10.0
    assert which in found.text()


@pytest.mark.long
def test_a_right_heading_and_a_body_that_does_not_accelerate_are_not_doubted() -> None:
    assert doubted(recorded(quick_place), started(quick_place, TRUE)) == []
    assert doubted(recorded(still_place), started(still_place, TRUE + np.pi / 2)) == []


@pytest.mark.long
@pytest.mark.parametrize("name", FLIGHTS)
def test_a_recorded_flight_is_not_doubted_but_turned_it_is_where_its_accelerometer_works(name) -> None:
    text = util_map(name)
    recording = read_recording(util_folder() / name, as_map(text))
    assert doubted(recording, as_map(text)) == []
    found = doubted(recording, as_map(text.replace("heading: 0,", "heading: 1.5708,")))
    if name in ("0425-traj20", "0426-traj9", "0426-traj12", "tdoa2-obs-log1"):
        assert np.degrees(found[0].off) == pytest.approx(90.0, abs=15.0)
    else:  # an axis fails
        assert found == []


@pytest.mark.long
@pytest.mark.parametrize("name", ["flight1", "flight2"])
def test_the_heading_that_trials_find_in_a_recorded_motion_is_not_doubted(name) -> None:
    map_ = as_map(MAP)
    assert doubted(read_recording(flight_folder(name), map_), map_) == []


def circle(psi):
    """Return a level body's start, events and values on a circle of 1 m, its force turned by psi, without any noise.

    The main filter's start is exact but for the turn.
    """
    h, w = 0.01, 2.0
    t = np.arange(0.0, 4.0, h)
    p = np.column_stack([3.0 + np.cos(w * t), 4.0 + np.sin(w * t), 1.0 + 0.0 * t])
    a = -(w**2) * (p - [3.0, 4.0, 1.0])
    force = Rotation.from_euler("z", psi).inv().apply(a) + [0.0, 0.0, 9.81]
    x = np.zeros(40)
    x[:6], x[Q] = [*p[0], 0.0, w, 0.0], 1.0
    start = State(0.0, x, np.eye(39), np.array([0.0, 0.0, 0.0, *force[0]]), np.zeros(14))
    n, m = len(t), len(ANCHORS)
    r = np.linalg.norm(p[:, None] - ANCHORS, axis=2)
    kind = np.tile([RATES, FORCE, *[RANGE] * m], n)
    which = np.column_stack([np.arange(n), np.arange(n), np.tile(np.arange(m), (n, 1))]).ravel()
    none = np.zeros(len(kind), np.int64)
    values = np.column_stack([np.zeros((n, 2)), r]).ravel()
    events = Events(np.repeat(t, 2 + m), kind, which, none - 1, values, none)
    return start, events, EventValues(np.zeros((n, 3)), force, np.zeros((0, 2)), np.zeros((0, 1, 1)))


RANGING = Ranging(ANCHORS, np.zeros(len(ANCHORS)), np.zeros((2, 3)), 0.1)


def test_the_turn_is_that_between_accelerations_and_ranges_without_any_noise() -> None:
    psi = np.radians(50.0)
    start, events, heard = circle(psi)
    beside = turn_filter(start)
    assert plain_source(follow)(beside, events, heard, RANGING)
    found = turn_found(beside)
    assert found.angle == pytest.approx(psi, abs=np.radians(2.0))
    assert found.length == pytest.approx(1.0, abs=0.1)
    assert found.sd < np.radians(10.0)
    assert start.x[Q:ADDITIVE].tolist() == [1.0, 0.0, 0.0, 0.0]  # the main filter's numbers stay


@pytest.mark.parametrize("silent", [RATES, RANGE])
def test_after_a_silence_it_says_that_it_must_begin_anew(silent) -> None:
    """Ranges that came back after ten seconds found it metres away, and turned a right heading by 80 degrees."""
    start, events, heard = circle(0.0)
    kept = (events.kind != silent) | (events.t < 1.0) | (events.t > 3.0)
    assert not plain_source(follow)(turn_filter(start), Events(*(part[kept] for part in events)), heard, RANGING)
