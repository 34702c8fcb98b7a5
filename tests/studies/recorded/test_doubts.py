"""What a replay doubts: files read wrongly in one way each, and the key that is named; right ones give no doubt."""

import re

import numpy as np
import pytest
from made_up_motion import ANCHORS, BIASES, GRAVITY, OFFSET, TABLE_MAP, made_up, write_tables
from scipy.spatial.transform import Rotation

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.range_rows import single_ranges
from ortilo_drake.interop.recorded.recording import Imu, Recording, Truth, read_recording
from ortilo_drake.interop.recorded.units import axes_matrix
from ortilo_drake.model.typed_yaml import InputError, parse_yaml, validate
from ortilo_drake.studies.recorded import doubts
from ortilo_drake.studies.recorded.calibrate import calibrate
from ortilo_drake.studies.recorded.doubted import doubts_of
from ortilo_drake.studies.recorded.first_look import CheapFit, first_look
from ortilo_drake.studies.recorded.imu_doubts import (
    attitude_doubts,
    axes_doubts,
    drift_doubts,
    force_doubts,
    rate_doubts,
)
from ortilo_drake.studies.recorded.level_doubts import level_doubts
from ortilo_drake.studies.recorded.replayed import replay
from ortilo_drake.studies.recorded.scores import Scores, by_evo

UP = np.array([0.0, 0.0, 1.0])


def as_map(text: str = "") -> Map:
    return validate(Map, parse_yaml(TABLE_MAP + text, "MAP.yaml"), "MAP.yaml")


@pytest.fixture(scope="module")
def recording() -> Recording:
    m = made_up(duration=40.0)
    t, first = m.t_r - m.t_r[0], m.t_truth[0]
    ranges = single_ranges(np.repeat(t, 6), np.tile(np.arange(6), len(t)), m.r.ravel())
    imu = Imu(m.t_imu - m.t_r[0], m.imu[:, :3], m.imu[:, 3:], None)
    truth = Truth(m.t_truth - first, m.p, m.R)
    return Recording("walk", ranges, imu, truth, ANCHORS, float(m.t_r[0]), float(first), [], {})


def with_truth(recording: Recording, **changes: np.ndarray) -> Recording:
    return recording._replace(truth=recording.truth._replace(**changes))


def doubted(recording: Recording, map_: Map) -> list[str]:
    look = first_look(recording, map_)
    calibration = calibrate(recording, map_.calibration)
    p = calibration.position(recording.truth.p)
    return doubts_of(recording, map_, look, calibration, {}, (p, p))


def test_a_body_that_would_hang_upside_down_is_told_with_the_axes_that_turn_it_up(recording) -> None:
    turned = recording.imu._replace(force=recording.imu.force * [1.0, -1.0, -1.0])  # frd read as flu
    (said,) = level_doubts(turned, as_map())
    assert ": imu: {axes: frd} turns it up, or imu: {force_unit: -1} if it reports gravity itself" in said
    assert level_doubts(recording.imu, as_map()) == []
    listed = as_map().model_copy(update={"imu": as_map().imu.model_copy(update={"axes": ("y", "-x", "z")})})
    assert "imu: {axes: [y, x, -z]} turns it up, or" in level_doubts(turned, listed)[0]  # a turn, no mirror


def test_a_clock_of_the_imu_that_is_late_by_a_tenth_of_a_second_is_told_with_the_key(recording) -> None:
    late = recording._replace(imu=recording.imu._replace(t=recording.imu.t + 0.1))
    said = re.fullmatch(r"imu: {late: (.*)}", first_look(late, as_map()).guess.key)
    assert float(said[1]) == pytest.approx(0.1, abs=0.01)
    held = as_map(f"calibration: {{clock: {OFFSET - 0.1}}}")
    said = re.fullmatch(r"calibration: {clock: (.*)}", first_look(recording, held).guess.key)
    assert float(said[1]) == pytest.approx(OFFSET, abs=0.01)


def test_rates_and_force_that_change_places_are_told(recording) -> None:
    imu = recording.imu._replace(rates=recording.imu.force, force=recording.imu.rates)
    assert "the columns of `rates` and `force` change places?" in force_doubts(imu, as_map())[0]


@pytest.mark.long
def test_a_recording_read_rightly_gives_no_doubt(recording) -> None:
    assert doubted(recording, as_map()) == []


@pytest.mark.family
@pytest.mark.parametrize(("unit", "metres"), [("mm", 0.001), ("cm", 0.01), ("in", 0.0254)])
def test_lengths_that_are_no_metres_end_in_one_line_with_the_scale(recording, unit, metres) -> None:
    small = recording._replace(ranges=recording.ranges._replace(r=recording.ranges.r / metres))
    with pytest.raises(InputError, match=rf"ranges: {{scale: {metres:g}}} \({unit}\) fits: .* -> 0\.0"):
        first_look(small, as_map())
    with pytest.raises(InputError, match=rf"truth: {{scale: {metres:g}}} \({unit}\) fits: .* -> 0\.0"):
        first_look(with_truth(recording, p=recording.truth.p / metres), as_map())


def test_without_truth_ranges_in_mm_are_told_by_the_size_of_the_room(recording) -> None:
    small = recording._replace(ranges=recording.ranges._replace(r=recording.ranges.r * 1000.0), truth=None)
    with pytest.raises(InputError, match=r"m for anchors 10\.4 m apart: in mm\? ranges: {scale: 0\.001}"):
        first_look(small, as_map())


def read_otherwise(recording: Recording) -> dict[str, Recording]:
    """Return recordings that are wrong in one way, by the key that mends it."""
    truth, ranges = recording.truth, recording.ranges
    y_up, ned = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.diag([1.0, -1.0, -1.0])
    tilt = Rotation.from_rotvec([0.3, -0.2, 0.0]).as_matrix()
    left_handed = np.array([[0, -1.0, 0], [0, 0, 1], [1, 0, 0]])  # Unity's: right, up, forward
    mirrored = with_truth(recording, p=truth.p @ left_handed.T, R=left_handed @ truth.R @ left_handed.T)

    def ordered(*order: int) -> Recording:
        return recording._replace(anchors=ANCHORS[list(order)])

    def typed(i: int, *place: float) -> Recording:
        anchors = ANCHORS.copy()
        anchors[i] = place
        return recording._replace(anchors=anchors)

    return {
        "ranges: {scale: 0.3048} (ft)": recording._replace(ranges=ranges._replace(r=ranges.r / 0.3048)),
        "truth: {axes: [x, -z, y]} (y is up)": with_truth(recording, p=truth.p @ y_up.T, R=y_up @ truth.R),
        "truth: {axes: [x, -y, -z]} (z is down)": with_truth(recording, p=truth.p @ ned.T, R=ned @ truth.R),
        "truth: {axes: [x, -z, y], scale: 0.001} (y is up, mm)": with_truth(
            recording, p=1000 * truth.p @ y_up.T, R=y_up @ truth.R
        ),
        "calibration: {frame: se3}": with_truth(recording, p=truth.p @ tilt.T, R=tilt @ truth.R),
        "truth: {axes: [x, z, y]} (left-handed, y is up)": mirrored,
        "ranges: {scale: 0.5} (there and back)": recording._replace(ranges=ranges._replace(r=2.0 * ranges.r)),
        "anchors: entries 2 and 5 change places": ordered(0, 4, 2, 3, 1, 5),
        "anchors: entries 1 and 4, 2 and 6 change places": ordered(3, 5, 2, 0, 4, 1),
        "anchors: in the order 3, 1, 2, 4, 5, 6": ordered(1, 2, 0, 3, 4, 5),
        "anchors: in reverse order": ordered(5, 4, 3, 2, 1, 0),
        "anchors: the last one first": ordered(1, 2, 3, 4, 5, 0),
        "anchors: entry 3 at [6, 8, 0.2], not [8, 6, 0.2],": typed(2, 8.0, 6.0, 0.2),
        "anchors: entry 4 at [0, 8, 2.8], not [0, -8, 2.8],": typed(3, 0.0, -8.0, 2.8),
        LEFT_HANDED: recording._replace(anchors=ANCHORS[:, [1, 0, 2]]),
        "anchors: in metres, those of the map times 0.01 (cm)": recording._replace(anchors=ANCHORS * 100),
    }


LEFT_HANDED = "anchors: x and y of each change places, or truth: {axes: [x, -y, z]} (left-handed)"
KEYS = (
    "ranges: {scale: 0.3048} (ft)",
    "truth: {axes: [x, -z, y]} (y is up)",
    "truth: {axes: [x, -y, -z]} (z is down)",
    "calibration: {frame: se3}",
    "truth: {axes: [x, z, y]} (left-handed, y is up)",
    "ranges: {scale: 0.5} (there and back)",
    "anchors: entries 2 and 5 change places",
    "anchors: entries 1 and 4, 2 and 6 change places",
    "anchors: in the order 3, 1, 2, 4, 5, 6",
    "anchors: in reverse order",
    "anchors: the last one first",
    "anchors: entry 3 at [6, 8, 0.2], not [8, 6, 0.2],",
    "anchors: entry 4 at [0, 8, 2.8], not [0, -8, 2.8],",
    LEFT_HANDED,
)


@pytest.mark.family
@pytest.mark.parametrize("key", KEYS)
def test_the_key_that_mends_it_is_named_with_how_much_better_the_fit_is(recording, key) -> None:
    guess = first_look(read_otherwise(recording)[key], as_map()).guess
    assert guess.key == key
    assert guess.after < 0.1 < guess.before  # the biases differ by up to 0.15 m from their mean
    assert doubts.of_guess(guess)[0].startswith(f"{key} would fit better: range errors ")


def test_an_anchor_mistyped_by_a_metre_is_told_with_where_it_is(recording) -> None:
    """A metre in one coordinate; its bias of -0.2 m moves where its ranges have it by about as much."""
    anchors = ANCHORS + np.array([[0, 0, 0], [0, 0, 0], [0, 1, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    key = first_look(recording._replace(anchors=anchors), as_map()).guess.key
    found = re.fullmatch(r"anchors: entry 3 at about \[6, (.*), 0\.2\], not \[6, 9, 0\.2\],", key)
    assert float(found[1]) == pytest.approx(8.0, abs=0.25)


@pytest.mark.long
def test_an_anchor_whose_ranges_alone_are_too_long_is_not_moved(recording) -> None:
    """As behind metal: no place explains them; with a truth the bias is told, without one that they do not agree."""
    r = recording.ranges.r + 1.5 * (recording.ranges.anchor == 1)
    wrong = recording._replace(ranges=recording.ranges._replace(r=r))
    assert first_look(wrong, as_map()).guess is None
    alone = first_look(wrong._replace(truth=None), as_map())
    assert alone.guess is None
    assert "the ranges of one time fit no place: 0." in doubts.of_agreement(alone.fit.left, 0.058)[0]


@pytest.mark.family
@pytest.mark.parametrize("key", ["ranges: {scale: 0.3048} (ft)", "anchors: entries 2 and 5 change places"])
def test_without_truth_ranges_tell_by_one_another(recording, key) -> None:
    guess = first_look(read_otherwise(recording)[key]._replace(truth=None), as_map()).guess
    assert key in guess.key.split(" or ")  # feet and nanoseconds only a truth tells apart
    assert guess.after < 0.15 < 0.3 < guess.before
    assert first_look(recording._replace(truth=None), as_map()).guess is None


def test_lengths_that_are_all_in_mm_are_told_by_their_size(recording) -> None:
    ranges = recording.ranges._replace(r=1000.0 * recording.ranges.r)
    large = with_truth(recording._replace(ranges=ranges, anchors=1000.0 * ANCHORS), p=1000.0 * recording.truth.p)
    key = "ranges: {scale: 0.001}, truth: {scale: 0.001}, anchors: in metres, those of the map times 0.001 (mm)"
    assert first_look(large, as_map()).guess.key == key
    assert first_look(large._replace(truth=None), as_map()).guess.key == key


def test_stamps_in_another_unit_and_an_imu_that_covers_little_are_told(recording) -> None:
    slow, fast = (recording.ranges._replace(t=recording.ranges.t * by) for by in (1e3, 1e-3))
    assert "ranges: {unit: ms} would make it 0.05 s" in doubts.of_stamps(slow, "s")[0]
    assert "ranges: {unit: s} would make it 0.05 s" in doubts.of_stamps(fast, "ms")[0]
    assert doubts.of_stamps(recording.ranges, "s") == []
    days = recording.ranges._replace(t=recording.ranges.t / 86400.0)  # as Excel and MATLAB count
    assert "ranges: {unit: 86400} (days) would make it 0.05 s" in doubts.of_stamps(days, "s")[0]
    told = doubts_of(recording._replace(ranges=slow), as_map(), CheapFit(None, None), None, {}, (ANCHORS, None))
    assert told == doubts.of_stamps(slow, "s")  # nothing else means anything then
    late = recording.imu._replace(t=recording.imu.t + 18.0)  # GPS' time less UTC
    assert "cover 58% of the ranges" in doubts.of_cover(recording.ranges, late)[0]
    assert doubts.of_cover(recording.ranges, recording.imu) == []


@pytest.mark.family("anchors: in metres, those of the map times 0.01 (cm)")
@pytest.mark.parametrize(
    "key",
    ["truth: {axes: [x, -z, y], scale: 0.001} (y is up, mm)", "anchors: in metres, those of the map times 0.01 (cm)"],
)
def test_what_cannot_be_calibrated_ends_in_a_line_that_names_the_key(recording, key) -> None:
    with pytest.raises(InputError, match=re.escape(f"{key} fits: range errors ")):
        first_look(read_otherwise(recording)[key], as_map())


@pytest.mark.long
@pytest.mark.parametrize("later", [-20.0, 12.0])
def test_one_clock_is_tried_where_the_files_begin_far_apart(recording, later) -> None:
    """The truth began 20 s before the ranges, or 12 s after them; both files have one clock but for 0.73 s."""
    t = recording.truth.t
    if later < 0:
        extra = np.arange(-20.0, -0.01, 0.05)
        p = np.tile(recording.truth.p[0], (len(extra), 1)) + 0.001 * np.sin(extra)[:, None]
        R = np.tile(recording.truth.R[0], (len(extra), 1, 1))
        truth = Truth(
            np.concatenate([extra, t]) + 20.0, np.vstack([p, recording.truth.p]), np.vstack([R, recording.truth.R])
        )
    else:
        kept = t >= later
        truth = Truth(t[kept] - t[kept][0], recording.truth.p[kept], recording.truth.R[kept])
    first = recording.truth_origin + later
    found = calibrate(recording._replace(truth=truth, truth_origin=first), as_map().calibration)
    assert found.offset + first - recording.origin == pytest.approx(0.73, abs=0.03)
    assert found.left < 0.05


@pytest.mark.long
def test_a_clock_beyond_the_search_is_found_by_a_wider_one(recording) -> None:
    """The truth began 11 s after the ranges, by a clock of its own, and the map gives a wrong offset."""
    t = recording.truth.t
    kept = t >= 11.0
    truth = Truth(t[kept] - t[kept][0], recording.truth.p[kept], None)
    cut = recording._replace(truth=truth, truth_origin=recording.truth_origin + 300.0, imu=None)
    guess = first_look(cut, as_map("calibration: {clock: 305}")).guess
    assert guess.key == "calibration: {clock: estimate, search: 12}"
    assert guess.after < 0.15 < guess.before


@pytest.mark.parametrize(
    ("text", "metres", "unit"),
    [
        ("", GRAVITY, "g"),
        ("", 0.3048, "ft/s2"),
        ("", GRAVITY / 1000, "mg"),
        ("g", 1 / GRAVITY, "m/s2"),
        ("", GRAVITY / 16384, "0.0005"),  # counts of +-2 g in 16 bit
    ],
)
def test_a_force_in_another_unit_is_told_by_gravity(recording, text, metres, unit) -> None:
    map_ = validate(Map, parse_yaml(TABLE_MAP.replace("force: [", f"force_unit: {text or 'm/s2'}, force: ["), "M"), "M")
    imu = recording.imu._replace(force=recording.imu.force / metres)
    said = force_doubts(imu, map_)
    assert len(said) == 1
    assert f"imu: {{force_unit: {unit}" in said[0]
    assert re.search(r"makes it (9|10)\.", said[0])
    assert force_doubts(recording.imu._replace(force=recording.imu.force * 1.06), as_map()) == []  # a unit 6 % wrong
    gone = force_doubts(recording.imu._replace(force=recording.imu.force - [0, 0, GRAVITY]), as_map())
    assert "gravity was taken out" in gone[0]


@pytest.mark.long
def test_rates_in_degrees_are_told_with_and_without_the_truths_attitude(recording) -> None:
    imu = recording.imu._replace(rates=np.degrees(recording.imu.rates))
    offset = calibrate(recording, as_map().calibration).offset
    said = attitude_doubts(recording._replace(imu=imu), as_map(), offset, UP)
    assert len(said) == 1
    assert ": imu: {rate_unit: deg/s} leaves 0." in said[0]
    assert "imu: {rate_unit: deg/s}" in rate_doubts(imu, as_map())[0]
    assert rate_doubts(recording.imu, as_map()) == []
    assert attitude_doubts(recording, as_map(), offset, UP) == []
    radians = validate(Map, parse_yaml(TABLE_MAP.replace("rates: [", "rate_unit: deg/s, rates: ["), "M"), "M")
    slow = recording._replace(imu=recording.imu._replace(rates=np.radians(recording.imu.rates)))
    assert ": imu: {rate_unit: rad/s} leaves" in attitude_doubts(slow, radians, offset, UP)[0]
    counts = recording._replace(imu=recording.imu._replace(rates=recording.imu.rates / 1.064e-3))  # of 2000 deg/s
    said = attitude_doubts(counts, as_map(), offset, UP)[0]
    assert float(re.search(r": imu: {rate_unit: (.*)} leaves 0\.", said)[1]) == pytest.approx(1.064e-3, rel=0.01)
    turned = recording._replace(imu=recording.imu._replace(rates=-recording.imu.rates))
    assert ": imu: {rate_unit: -" in attitude_doubts(turned, as_map(), offset, UP)[0]
    sign = recording._replace(imu=recording.imu._replace(rates=recording.imu.rates * [1.0, 1.0, -1.0]))
    assert "other axes, one sign of them" in attitude_doubts(sign, as_map(), offset, UP)[0]  # no key of ours mends it


@pytest.mark.long
@pytest.mark.parametrize("level", [False, True])
def test_the_quaternions_order_and_sense_are_found(recording, level) -> None:
    """Also for a body that turns about z only: its inverse attitude is by the rates alone that of one upside down."""
    R = Rotation.from_matrix(recording.truth.R)
    offset = calibrate(recording, as_map().calibration).offset
    if level:
        yaw = R.as_euler("ZYX")[:, 0]
        R = Rotation.from_rotvec(yaw[:, None] * UP)
        imu_t = recording.imu.t + offset
        w = np.interp(imu_t, recording.truth.t, np.gradient(np.unwrap(yaw), recording.truth.t))
        imu = recording.imu._replace(
            rates=np.column_stack([0 * w, 0 * w, w]), force=np.tile([0, 0, GRAVITY], (len(w), 1))
        )
        recording = recording._replace(imu=imu)
    q = R.as_quat()
    wxyz = Rotation.from_quat(q[:, [3, 0, 1, 2]]).as_matrix()  # columns w x y z, read as x y z w
    said = attitude_doubts(with_truth(recording, R=wxyz), as_map(), offset, UP)
    assert len(said) == 1
    assert ": truth: {rotation: {order: wxyz}} leaves 0." in said[0]
    said = attitude_doubts(with_truth(recording, R=R.inv().as_matrix()), as_map(), offset, UP)
    assert ": truth: {rotation: {of: world}} leaves 0." in said[0]
    assert attitude_doubts(with_truth(recording, R=R.as_matrix()), as_map(), offset, UP) == []


@pytest.mark.long
def test_poses_that_freeze_are_told_and_a_body_at_rest_is_not(recording) -> None:
    truth, offset = recording.truth, calibrate(recording, as_map().calibration).offset
    p = truth.p.copy()
    p[100:160] = p[100]
    p[300:340] = p[300]
    found = doubts.freezes(truth._replace(p=p), recording.ranges, offset)
    np.testing.assert_allclose(found, [(truth.t[100], truth.t[159]), (truth.t[300], truth.t[339])])
    assert "2 times, 4.9 s in all" in doubts.of_freezes(found)[0]
    p = truth.p.copy()
    p[-80:] = p[-80]  # to the end: only the ranges tell
    assert len(doubts.freezes(truth._replace(p=p), recording.ranges, offset)) == 1
    rest = Truth(
        np.concatenate([truth.t, truth.t + 40.0]), np.vstack([truth.p[:1].repeat(len(truth.t), 0), truth.p]), None
    )
    still = recording.ranges._replace(r=recording.ranges.r[:6][recording.ranges.anchor])
    assert doubts.freezes(rest, still, offset) == []
    assert doubts.freezes(truth, recording.ranges, offset) == []


def test_anchors_in_a_plane_leave_a_mirror_image(recording) -> None:
    flat = np.column_stack([ANCHORS[:4, :2], np.full(4, 2.1)])
    p = np.array([[1.0, 2.0, 0.2], [2.0, 2.0, 0.2], [2.0, 3.0, 0.2]])
    said = doubts.of_plane(flat, p, p)
    assert "(2.0, 2.0, 0.2) and its mirror image (2.0, 2.0, 4.0)" in said[0]
    assert "the filter is in the mirror image" not in said[0]
    assert "3.80 m RMS from the truth, mirrored 0.00 m" in doubts.of_plane(flat, p + [0, 0, 3.8], p)[0]
    assert doubts.of_plane(ANCHORS, p, p) == []
    (in_the_plane,) = doubts.of_plane(flat, p + [0, 0, 1.9], None)
    assert "give `planar: true`" in in_the_plane


def test_numbers_of_calibration_and_rows_are_doubted_beyond_their_limits() -> None:
    small, large = np.full(3, 0.1), np.array([0.0, 0.6, -0.9])
    assert doubts.of_calibration(0.1, 0.05, small, small) == []
    said = doubts.of_calibration(0.5, 0.05, large, large)
    assert "10 times the range noise (0.050 m)" in said[0]
    assert "the antenna was found 1.08 m" in said[1]
    assert "+0.60 m (anchor 2), -0.90 m (anchor 3)" in said[2]
    assert doubts.of_offset(4.2, [0.0], 5.0, "ranges") == []
    assert "lies at the end of its search" in doubts.of_offset(-4.9, [0.0], 5.0, "ranges")[0]
    assert doubts.of_offset(-4.9, [0.0, -6.0], 5.0, "ranges") == []
    assert doubts.of_offset(9.0, [0.0], 5.0, "map") == []
    good = Scores(None, None, None, None, None, 1.0, 0.1, 1.0)
    bad, lost = Scores(*[None] * 5, 1.0, 0.3, 1.0), Scores(*[None] * 5, float("nan"), 1.0, 1.0)
    assert doubts.of_rows({"a": good, "b": bad, "c": lost}, ("a", "b", "c", "d")) == [
        "b: 30% of the ranges were refused",
        "c: the filter is lost: no range was taken in the judged part",
    ]


@pytest.mark.long
def test_a_body_that_stands_still_is_scored_and_one_whose_truth_was_lost_refused(recording) -> None:
    """No one turn aligns a single point: evo refuses that with an exception of its own."""
    t, still = np.arange(0.0, 10.0, 0.1), np.tile([1.0, 2.0, 0.5], (100, 1))
    assert by_evo(t, still + [0.3, 0.0, 0.4], still) == (pytest.approx(0.5), None, pytest.approx(0.0, abs=1e-12))
    with pytest.raises(InputError, match="the truth stands still, the ranges change"):
        first_look(with_truth(recording, p=np.tile(recording.truth.p[0], (len(recording.truth.t), 1))), as_map())


@pytest.mark.long
def test_attitudes_that_froze_with_the_positions_are_no_doubt_of_their_own(recording) -> None:
    right = calibrate(recording, as_map().calibration)
    p, R = recording.truth.p.copy(), recording.truth.R.copy()
    for a, b in ((150, 230), (400, 500)):
        p[a:b], R[a:b] = p[a], R[a]
    frozen = with_truth(recording, p=p, R=R)
    said = doubts_of(frozen, as_map(), first_look(recording, as_map()), right, {}, (p, None))
    assert len(said) == 1
    assert "truth: {drop_frozen: 0.5} drops these rows: range errors 0." in said[0]


def test_an_imu_by_another_clock_than_the_ranges_is_told_with_how_late_it_is(recording) -> None:
    late = recording._replace(imu=recording.imu._replace(t=recording.imu.t + 0.4))
    key = first_look(late, as_map()).guess.key
    assert float(re.fullmatch(r"imu: {late: (.*)}", key)[1]) == pytest.approx(0.4, abs=0.03)


@pytest.mark.long
def test_a_truth_in_utm_is_calibrated_as_one_in_the_room(recording) -> None:
    """Only its shift differs: p = F (p_T + far) + s - F far."""
    far = np.array([456_789.0, 5_412_345.0, 321.0])
    near, there = (
        calibrate(with_truth(recording, p=recording.truth.p + by), as_map().calibration) for by in (0.0 * far, far)
    )
    assert there.left == pytest.approx(near.left, rel=1e-3)
    np.testing.assert_allclose(there.lever, near.lever, atol=1e-3)
    moved = there.position(recording.truth.p + far)
    np.testing.assert_allclose(moved, near.position(recording.truth.p), atol=2e-3)
    assert first_look(with_truth(recording, p=recording.truth.p + far), as_map()).guess is None


@pytest.mark.long
@pytest.mark.filterwarnings("error")
def test_a_filter_that_diverges_leaves_its_row_out(recording) -> None:
    """Body rates in mrad/s, 300 rad/s of RMS: the key that mends it is told, and no warning of NumPy's."""
    imu = recording.imu._replace(rates=1000.0 * recording.imu.rates)
    found, drawn = replay(recording._replace(imu=imu), as_map("imposed: {lost: 0, gaps: null}"), lambda _: None)
    assert "with IMU" not in drawn
    assert any("with IMU: this row is left out: the filter diverged" in note for note in found.notes)
    assert any("imu: {rate_unit: mrad/s} leaves" in doubt for doubt in found.doubts)


def moved_by(recording: Recording, i: int, *by: float) -> Recording:
    anchors = ANCHORS.copy()
    anchors[i] += by
    return recording._replace(anchors=anchors)


@pytest.mark.family
@pytest.mark.parametrize(("i", "by"), [(2, (0.0, 0.0, 1.0)), (1, (0.5, 0.0, 0.0)), (3, (0.0, -0.5, 0.0))])
def test_an_anchor_that_is_a_little_off_is_told_by_its_own_ranges(recording, i, by) -> None:
    """It is hardly seen in the error of all ranges; where the ranges have it is known to about 0.3 m."""
    guess = first_look(moved_by(recording, i, *by), as_map()).guess
    found = re.fullmatch(rf"anchors: entry {i + 1} at about \[(.*)\], not .*,", guess.key)
    np.testing.assert_allclose([float(one) for one in found[1].split(",")], ANCHORS[i], atol=0.35)
    assert guess.of == "its range"
    assert guess.after < 0.05 < guess.before


@pytest.mark.long
def test_without_truth_an_anchor_a_metre_off_is_told(recording) -> None:
    key = first_look(moved_by(recording, 3, 0.0, 0.0, -1.0)._replace(truth=None), as_map()).guess.key
    assert key.startswith("anchors: entry 4 at about [0, 8, 2.")


@pytest.mark.long
def test_without_truth_the_constant_velocity_filter_tells_an_anchor_that_short_times_do_not(recording) -> None:
    """ANCHORS has entry 3 at (6, 8, 0.2); of 0.4 m the cheap fit leaves no more than ranges right to 5 cm do."""
    guess = first_look(moved_by(recording, 2, -0.4, 0.0, 0.0)._replace(truth=None), as_map()).guess
    assert guess.key == "anchors: entry 3 at about [6, 8, 0.2], not [5.6, 8, 0.2],"
    assert guess.of == "the constant-velocity filter's range"
    assert guess.after < guess.before
    assert first_look(recording._replace(truth=None), as_map()).guess is None


@pytest.mark.long
def test_a_clock_that_drifts_and_a_scale_are_told_with_what_mends_them(recording) -> None:
    def number(changed: Recording, key: str) -> float:
        return float(re.match(key, first_look(changed, as_map()).guess.key)[1])

    ranges, truth = recording.ranges, recording.truth
    fast = with_truth(recording, t=1.01 * truth.t)
    assert number(fast, r"truth: {unit: (.*)} \(its clock drifts\)") == pytest.approx(1 / 1.01, abs=5e-4)
    slow = recording._replace(ranges=ranges._replace(t=ranges.t / 1.01))
    assert number(slow, r"ranges: {unit: (.*)} \(its clock drifts\)") == pytest.approx(1.01, abs=5e-4)
    wide = recording._replace(ranges=ranges._replace(r=1.03 * ranges.r))
    assert number(wide, "ranges: {scale: (.*)}") == pytest.approx(1 / 1.03, abs=0.01)
    imu = recording.imu._replace(t=1.01 * recording.imu.t)
    offset = calibrate(recording, as_map().calibration).offset
    (said,) = drift_doubts(recording._replace(imu=imu), as_map(), offset)
    assert float(re.search("imu: {unit: (.*)}", said)[1]) == pytest.approx(1 / 1.01, abs=5e-4)
    assert drift_doubts(recording, as_map(), offset) == []


@pytest.mark.family
@pytest.mark.parametrize(
    ("what", "axes"),
    [("rates", "[x, -y, z]"), ("rates", "[z, x, y]"), ("rates", "[x, y, -z]"), ("force", "[-x, y, z]")],
)
def test_axes_of_the_rates_or_the_force_alone_are_told_with_the_key(recording, what, axes) -> None:
    """The wrong files are made by the inverse of what the key does; the truth's attitude is not used."""
    offset, blind = calibrate(recording, as_map().calibration).offset, with_truth(recording, R=None)
    M = axes_matrix(tuple(axes[1:-1].split(", ")), what, mirrors=True)
    imu = recording.imu._replace(**{what: getattr(recording.imu, what) @ M})
    (said,) = axes_doubts(blind._replace(imu=imu), as_map(), offset)
    assert f"imu: {{{what[:-1] if what == 'rates' else what}_axes: {axes}}} leaves 0.0" in said
    assert axes_doubts(blind, as_map(), offset) == []


def test_own_axes_of_rates_and_force_are_read(tmp_path) -> None:
    m = made_up(duration=10.0)
    text = TABLE_MAP.replace("force: [fx", "rate_axes: [x, y, -z], force_axes: [-y, x, z], force: [fx")
    imu = read_recording(write_tables(tmp_path / "walk", m), validate(Map, parse_yaml(text, "M"), "M")).imu
    np.testing.assert_allclose(imu.rates, m.imu[:, :3] * [1.0, 1.0, -1.0], atol=1e-8)
    np.testing.assert_allclose(imu.force, m.imu[:, [4, 3, 5]] * [-1.0, 1.0, 1.0], atol=1e-7)


def test_a_filter_that_does_worse_with_its_imu_is_doubted() -> None:
    def row(error: float, nis: float, nees: float = 9.0) -> Scores:
        return Scores((error, 0.0, 0.0), *[None] * 3, nees, nis, 0.0, 1.0)

    rows = {"a": row(0.5, 1.0), "b": row(0.2, 1.0), "c": row(0.1, 2.3), "d": row(0.1, 1.0), "e": row(0.1, 2.3, 1.1)}
    assert "a: 0.50 m RMS, without it 0.20 m: axes, signs, units" in doubts.of_imu(rows, "a", "b")[0]
    assert "NIS is 2.3, not 1" in doubts.of_imu(rows, "c", "b")[0]
    assert "`ortilo tune FOLDER --map MAP.yaml" in doubts.of_imu(rows, "c", "b")[0]
    assert doubts.of_noise(rows, "c", "b") == doubts.of_noise(rows, "d", "b") == []
    assert doubts.of_imu(rows, "e", "b") == []  # its errors are as it claims: only its noise does not fit
    assert "e: NIS is 2.3, not 1: the noise under `filter` is too small" in doubts.of_noise(rows, "e", "b")[0]
    assert doubts.of_imu(rows, "d", "b") == []
    assert doubts.of_imu({}, "d", "b") == []


def test_without_truth_noise_is_told_from_an_imu_that_predicts_the_ranges_worse_than_none() -> None:
    def row(nis: float, innovation: float, rejected: float = 0.0) -> Scores:
        return Scores(*[None] * 5, nis, rejected, 1.0, innovation=innovation)

    rows = {"noise": row(1.9, 0.0505), "imu": row(2.3, 0.056), "b": row(0.65, 0.05), "off": row(1.55, 0.09, 0.055)}
    assert doubts.of_imu(rows, "noise", "b") == []
    assert "noise: NIS is 1.9, not 1: the noise under `filter`" in doubts.of_noise(rows, "noise", "b")[0]
    assert "imu: its innovations are larger than it expects" in doubts.of_imu(rows, "imu", "b")[0]
    assert doubts.of_noise(rows, "noise", "off") == []  # ranges or anchors do not agree: nothing is cleared
    assert len(doubts.of_imu(rows, "noise", "off")) == 1


@pytest.mark.long
def test_without_truth_a_right_imu_with_small_noise_is_no_doubt_and_a_wrong_axis_is_one(recording) -> None:
    """The ranges err by 3 cm, the filter counts on 2: NIS is about 2 and only the noise is wrong."""
    small = as_map("filter: {range_white: 0.02, range_correlated: 0.001, acceleration: 0.02}\n")
    ranges = recording.ranges
    alone = recording._replace(truth=None, ranges=ranges._replace(r=ranges.r - BIASES[ranges.anchor]))
    found, _ = replay(alone, small, lambda _: None)
    assert found.doubts == ()
    turned = alone._replace(imu=alone.imu._replace(rates=alone.imu.rates * [-1.0, 1.0, 1.0]))
    assert "axes, signs, units or clock of the imu?" in replay(turned, small, lambda _: None)[0].doubts[0]


@pytest.mark.long
@pytest.mark.parametrize(("metres", "unit"), [(0.3048, "ft"), (0.299792458, "ns of flight")])
def test_feet_and_nanoseconds_are_told_apart_or_both_named(recording, metres, unit) -> None:
    """1.6 % of the ranges: the truth tells, ranges alone do not."""
    short = recording._replace(ranges=recording.ranges._replace(r=recording.ranges.r / metres))
    assert first_look(short, as_map()).guess.key == f"ranges: {{scale: {metres:.6g}}} ({unit})"
    alone = first_look(short._replace(truth=None), as_map()).guess.key
    assert f"ranges: {{scale: {metres:.6g}}} ({unit})" in alone.split(" or ")
