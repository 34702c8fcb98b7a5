"""One recorded motion replayed: with its losses and without, calibrated and not, filtered and smoothed."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import Ranges, Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.aided import airborne, uncalibrated_setup, with_aids
from ortilo_drake.studies.recorded.at_rest import AtRest, at_rest, at_rest_text, level_source, standstill_doubts
from ortilo_drake.studies.recorded.calibrate import Calibration, calibrate, uncalibrated
from ortilo_drake.studies.recorded.doubted import doubts_of, stamp_doubts
from ortilo_drake.studies.recorded.doubts import of_failed, range_noise
from ortilo_drake.studies.recorded.filtered import Estimate, FilterSetup, estimate, first_tilt, tilt_disagreement
from ortilo_drake.studies.recorded.first_look import first_look
from ortilo_drake.studies.recorded.imposed import gap_ends, lose_gaps, lose_some
from ortilo_drake.studies.recorded.level import calibrated_level, given_level
from ortilo_drake.studies.recorded.scores import Scores, score
from ortilo_drake.studies.recorded.truth_path import truth_path

QUERY_RATE = 10.0  # of the estimates where there is no truth [Hz]
SHORTEST = 3.0  # a recording is judged on no less [s]
TILTED = np.radians(5.0)  # the unit's attitude and its specific force should agree better than this at rest
CV, CV_SMOOTH, CV_RAW = "constant velocity", "constant velocity, smoothed", "constant velocity, not calibrated"
AIDED, AIDED_SMOOTH = "with IMU, range finder and flow", "with IMU, range finder and flow, smoothed"
BOXED = "with IMU and boxes"
WITH_IMU, SMOOTH, RAW = "with IMU", "with IMU, smoothed", "with IMU, not calibrated (biases online)"


@dataclass(frozen=True)
class Replayed:
    """The result of a replay: scores by row; `drawn` holds estimates and the truth at their stamps, by row.

    residual: RMS of the ranges' errors that the calibration leaves [m]; plain_residual: with one bias for all ranges;
    range_noise: what the filter counts on [m]; doubts: what makes it doubtful, in sentences; rest: what the imu said
    while it stood still.
    """

    name: str
    rows: dict[str, Scores]
    offset: float | None
    told_by: str | None
    heading: float | None
    shift: tuple[float, ...] | None
    lever: tuple[float, ...] | None
    biases: tuple[float, ...] | None
    anchors: tuple[tuple[float, ...], ...]
    judged_from: float
    rejected: dict[str, int]
    notes: list[str]
    residual: float | None = None
    plain_residual: float | None = None
    range_noise: float = 0.0
    doubts: tuple[str, ...] = ()
    rest: AtRest | None = None


Drawn = dict[str, tuple[Estimate, np.ndarray | None]]


def _tuple(values: np.ndarray) -> tuple[float, ...]:
    return tuple(float(v) for v in values)


def calibrated_setup(calibration: Calibration, recording: Recording, map_: Map) -> FilterSetup:
    """Return the calibrated filter's settings."""
    heading = None
    truth, imu = recording.truth, recording.imu
    if imu is not None and truth is not None and truth.R is not None and calibration.mount is not None:
        at = np.array([max(imu.t[0], recording.ranges.t[0]) + calibration.offset])
        R = calibration.F @ truth_path(truth).at(np.clip(at, 0.0, None))[1][0] @ calibration.mount  # type: ignore[index]
        heading = float(np.arctan2(R[1, 0], R[0, 0]))
    biases = {"calibrated": calibration.biases, "online": None, "none": np.zeros(len(calibration.biases))}
    level, rest = calibrated_level(map_, calibration, recording), at_rest(recording, map_)
    own, anchors = biases[map_.calibration.biases], calibration.anchors
    return FilterSetup(anchors, own, calibration.lever, heading, level, rest=rest, tags=recording.tags)


def aided_name(map_: Map) -> str | None:
    """Return the name of the row with range finder, flow and camera; None if the map has none of them."""
    down = map_.range_finder is not None or map_.flow is not None
    if map_.boxes is None:
        return AIDED if down else None
    return f"{AIDED}, and boxes" if down else BOXED


def _notes(recording: Recording, map_: Map, rest: AtRest | None) -> list[str]:
    notes, imu = list(recording.told), recording.imu
    if imu is not None and rest is not None:
        rests = map_.start is not None and map_.start.rests
        R = np.eye(3) if rests else first_tilt(imu, rest)
        notes.append(at_rest_text(rest, R, level_source(imu, rests)))
    wrong = None if imu is None else tilt_disagreement(imu)
    if wrong is not None and wrong > TILTED:
        notes.append(
            f"imu: its attitude and its specific force disagree on up by {np.degrees(wrong):.0f}° at the start: "
            "wrong order of the quaternion, or wrong axes?"
        )
    return notes


def replay(recording: Recording, map_: Map, say: Callable[[str], None]) -> tuple[Replayed, Drawn]:
    """Replay a motion in every way that the map allows.

    Args:
        recording: what was read.
        map_: settings.
        say: called with the name of each row before it runs.

    Raises:
        InputError: if calibration or filter have too little to go by.
    """
    rest = at_rest(recording, map_)
    notes, drawn, rows = _notes(recording, map_, rest), {}, {}
    left_out: dict[str, str] = {}
    ranges, imu, truth = recording.ranges, recording.imu, recording.truth
    calibration = own = None
    given = given_level(map_)
    look = first_look(recording, map_)
    if truth is None:
        t = np.arange(ranges.t[0], ranges.t[-1], 1.0 / QUERY_RATE)
        first = t[0] + map_.calibration.share * (t[-1] - t[0])
    else:
        say("calibration")
        if map_.calibration.share == 0.0:
            calibration = uncalibrated(recording, map_.calibration, airborne=map_.airborne)
            own = uncalibrated(recording, map_.calibration, lever=False, airborne=map_.airborne)
        else:
            calibration = calibrate(recording, map_.calibration, level=given)
            own = calibrate(recording, map_.calibration, lever=False, near=calibration.offset, level=given)
        t = truth.t - calibration.offset
        t = t[(t >= ranges.t[0]) & (t <= ranges.t[-1])]
        first = calibration.end - calibration.offset

    judged = airborne(t, truth, calibration, map_)
    t_judged = t[judged(t) & (t > first)]
    if len(t_judged) < 2 or t_judged[-1] - t_judged[0] < SHORTEST:
        why = "".join(f"; {line}" for line in stamp_doubts(recording, map_))
        raise InputError(f"{recording.name}: less than {SHORTEST:g} s of the recording is left to judge{why}")

    def true_at(t: np.ndarray, by: Calibration | None) -> np.ndarray | None:
        if truth is None or by is None:
            return None
        return by.position(truth_path(truth).at(t + by.offset)[0])

    def row(
        name: str,
        known: FilterSetup,
        by: Calibration | None,
        with_imu: bool,
        heard: Ranges = ranges,
        smoothed: bool = False,
    ) -> None:
        say(name)
        try:
            found = estimate(heard, imu if with_imu else None, known, map_.filter, t, smoothed)
        except InputError as error:
            left_out[name] = str(error)
            return
        if not len(found.t) or found.t[-1] - max(first, found.t[0]) < SHORTEST:
            left_out[name] = f"less than {SHORTEST:g} s are left to judge after the first range"
            return
        true = true_at(found.t, by)
        rows[name], drawn[name] = score(found, (found.t > first) & judged(found.t), true, map_.available), (found, true)

    anchors = np.asarray(recording.anchors) if calibration is None else calibration.anchors
    raw = FilterSetup(anchors, None, np.zeros(3), None, given, rest=rest, tags=recording.tags)
    if own is not None:
        level = calibrated_level(map_, own, recording)
        plain = FilterSetup(own.anchors, own.biases, np.zeros(3), None, level, tags=recording.tags)
        row(CV, plain, own, False)
        row(CV_SMOOTH, plain, own, False, smoothed=True)
    if map_.calibration.share > 0.0 or truth is None:
        row(CV_RAW, raw, own, False)
    if calibration is not None:
        known = with_aids(calibrated_setup(calibration, recording, map_), recording, map_, False)
        main = WITH_IMU if imu is not None else CV
        if imu is not None:
            row(WITH_IMU, known, calibration, True)
            row(SMOOTH, known, calibration, True, smoothed=True)
        if (name := aided_name(map_)) is not None:
            aided = with_aids(known, recording, map_, True)
            row(name, aided, calibration, True)
            row(f"{name}, smoothed", aided, calibration, True, smoothed=True)
    else:
        known = raw = uncalibrated_setup(recording, map_, rest)
        main = RAW if imu is not None else CV_RAW
    if imu is not None and (map_.calibration.share > 0.0 or truth is None):
        given_lever = map_.calibration.lever
        known_lever = raw if given_lever == "estimate" else raw._replace(lever=np.array(given_lever))
        row(RAW, known_lever, calibration, True)
    if imu is None and own is not None:
        known = plain
    by = own if imu is None else calibration
    imposed = map_.imposed
    if imposed.lost:
        lost = lose_some(ranges, imposed.lost, imposed.seed)
        row(f"{main}, {imposed.lost:.0%} of the ranges lost", known, by, imu is not None, lost)
    if imposed.gaps is not None:
        name = f"{main}, all ranges lost for {imposed.gaps.last:g} s every {imposed.gaps.every:g} s"
        ends = gap_ends(ranges, imposed.gaps, max(first, ranges.t[0]))
        if truth is not None and by is not None:
            ends = ends[ends + by.offset < truth.t[-1]]
        row(name, known, by, imu is not None, lose_gaps(ranges, imposed.gaps, ends))
        if len(ends) and name in rows:
            heard = lose_gaps(ranges, imposed.gaps, ends)
            at_end = estimate(heard, imu if imu is not None else None, known, map_.filter, ends - 1e-6)
            true = true_at(at_end.t, by)
            if true is not None:
                errors = np.linalg.norm(at_end.p - true, axis=1)
                figures = {"gap_end": float(np.sqrt(np.mean(errors**2))), "gap_end_largest": float(errors.max())}
                rows[name] = Scores(**{**vars(rows[name]), **figures, "gaps": len(errors)})
    best = next((name for name in (WITH_IMU, CV, RAW, CV_RAW) if name in rows), None)
    if best is None:
        raise InputError(f"{recording.name}: {next(iter(left_out.values()))}")
    notes += of_failed(drawn[best][0].failed, drawn[best][0].drag)
    notes += [f"{name}: this row is left out: {why}" for name, why in left_out.items()]
    heading = shift = lever = biases = None
    if calibration is not None:
        heading = float(np.arctan2(calibration.F[1, 0], calibration.F[0, 0]))
        shift, lever, biases = _tuple(calibration.shift), _tuple(calibration.lever), _tuple(calibration.biases)
    p, true = drawn[best][0].p, drawn[best][1]
    doubts = doubts_of(recording, map_, look, calibration, rows, (p, true))
    of_files = recording.truth_origin - recording.origin
    result = Replayed(
        recording.name,
        rows,
        None if calibration is None else calibration.offset + of_files,
        None if calibration is None else calibration.told_by,
        heading,
        shift,
        lever,
        biases,
        tuple(_tuple(a) for a in anchors),
        float(first),
        recording.rejected,
        notes,
        None if calibration is None else calibration.left,
        None if look.fit is None else look.fit.left,
        range_noise(map_.filter, imu is not None),
        (*doubts, *standstill_doubts(rest)),
        rest,
    )
    return result, drawn
