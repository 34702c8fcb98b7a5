"""The replay of one recorded motion: with and without imposed losses, calibrated and not, filtered and smoothed."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ortilo_drake.interop.recorded.map_file import Gaps, Map
from ortilo_drake.interop.recorded.recording import Imu, Ranges, Recording
from ortilo_drake.model.typed_yaml import InputError
from ortilo_drake.studies.recorded.at_rest import AtRest, at_rest, at_rest_text, standstill_doubts, tilt_disagreement
from ortilo_drake.studies.recorded.calibrate import Calibration, calibrate
from ortilo_drake.studies.recorded.doubted import doubts_of, stamp_doubts
from ortilo_drake.studies.recorded.doubts import of_failed, range_noise
from ortilo_drake.studies.recorded.filter_types import FilterSetup
from ortilo_drake.studies.recorded.filtered import TRIAL, Estimate, estimate
from ortilo_drake.studies.recorded.first_look import first_look
from ortilo_drake.studies.recorded.heading_doubts import heading_doubts
from ortilo_drake.studies.recorded.lever_fit import fit_lever
from ortilo_drake.studies.recorded.scores import Scores, score
from ortilo_drake.studies.recorded.setups import (
    SHORTEST,
    calibrated_level,
    calibrated_setup,
    given_level,
    judged_part,
    uncalibrated_setup,
    with_aids,
)
from ortilo_drake.studies.recorded.truth_path import truth_path

TILTED = np.radians(5.0)  # largest angle between the unit's own up and its specific force at rest [rad]
CV, CV_SMOOTH, CV_RAW = "constant velocity", "constant velocity, smoothed", "constant velocity, not calibrated"
AIDED, BOXED = "with IMU, range finder and flow", "with IMU and boxes"
WITH_IMU, SMOOTH, RAW = "with IMU", "with IMU, smoothed", "with IMU, not calibrated (biases online)"


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """The result of a replay.

    rows: scores by row; offset ... biases: the calibration's, None without one; residual, plain_residual: RMS of the
    ranges' errors after the calibration, and after the cheap fit with one bias for all ranges [m]; range_noise: the
    standard deviation of a range that the filter assumes [m]; doubts: in sentences; rest: the imu's means at rest.
    """

    name: str
    rows: dict[str, Scores]
    offset: float | None = None
    told_by: str | None = None
    heading: float | None = None
    shift: tuple[float, ...] | None = None
    lever: tuple[float, ...] | None = None
    biases: tuple[float, ...] | None = None
    anchors: tuple[tuple[float, ...], ...]
    judged_from: float
    rejected: dict[str, int]
    notes: list[str]
    residual: float | None = None
    plain_residual: float | None = None
    range_noise: float = 0.0
    doubts: tuple[str, ...] = ()
    rest: AtRest | None = None


# By row, the estimate and the true positions at its stamps (m, 3).
Drawn = dict[str, tuple[Estimate, np.ndarray | None]]


def aided_name(map_: Map) -> str | None:
    """Return the name of the row with range finder, flow and camera; None if the map has none of them."""
    down = map_.range_finder is not None or map_.flow is not None
    if map_.boxes is None:
        return AIDED if down else None
    return f"{AIDED}, and boxes" if down else BOXED


def _notes(recording: Recording, map_: Map, rest: AtRest | None) -> list[str]:
    notes, imu = list(recording.told), recording.imu
    if imu is not None and rest is not None:
        notes.append(at_rest_text(rest, imu, map_.start is not None and map_.start.rests))
    wrong = None if imu is None else tilt_disagreement(imu)
    if wrong is not None and wrong > TILTED:
        notes.append(
            f"imu: its attitude and its specific force disagree on up by {np.degrees(wrong):.0f}° at the start: "
            "wrong order of the quaternion, or wrong axes?"
        )
    return notes


def replay(recording: Recording, map_: Map, say: Callable[[str], None]) -> tuple[Replayed, Drawn]:
    """Replay a motion in every way that the map allows; `say` is called with the name of each row before it runs.

    Raises:
        InputError: if calibration or filter have too little data.
    """
    rest = at_rest(recording, map_)
    notes, drawn, rows = _notes(recording, map_, rest), {}, {}
    left_out: dict[str, str] = {}
    ranges, imu, truth, given = recording.ranges, recording.imu, recording.truth, given_level(map_)
    calibrates = map_.calibration.share > 0.0 or truth is None
    calibration = own = None
    look = first_look(recording, map_)
    if truth is not None:
        say("calibration")
        up = map_.airborne
        calibration = calibrate(recording, map_.calibration, level=given, airborne=up)
        near = calibration.offset
        own = calibrate(recording, map_.calibration, lever=False, near=near, level=given, airborne=up)
    try:
        t, first, judged = judged_part(recording, calibration, map_)
    except InputError as error:
        raise InputError("; ".join([str(error), *stamp_doubts(recording, map_)])) from None

    def true_at(t: np.ndarray, by: Calibration | None) -> np.ndarray | None:
        if truth is None or by is None:
            return None
        return by.position(truth_path(truth).at(t + by.offset)[0])

    def row(
        name: str,
        known: FilterSetup,
        by: Calibration | None,
        imu: Imu | None,
        heard: Ranges = ranges,
        smoothed: bool = False,
    ) -> None:
        say(name)
        try:
            found = estimate(heard, imu, known, map_.filter, t, smoothed)
        except InputError as error:
            left_out[name] = str(error)
            return
        if not len(found.t) or found.t[-1] - max(first, found.t[0]) < SHORTEST:
            left_out[name] = f"less than {SHORTEST:g} s are left to judge after the first range"
            return
        true = true_at(found.t, by)
        rows[name], drawn[name] = score(found, judged(found.t), true, map_.available), (found, true)

    anchors = np.asarray(recording.anchors) if calibration is None else calibration.anchors
    raw = FilterSetup(anchors, None, np.zeros(3), None, given, rest=rest, tags=recording.tags)
    plain = raw
    if own is not None:
        level = calibrated_level(map_, own, recording)
        plain = FilterSetup(own.anchors, own.biases, np.zeros(3), None, level, tags=recording.tags)
        row(CV, plain, own, None)
        row(CV_SMOOTH, plain, own, None, smoothed=True)
    if calibrates:
        row(CV_RAW, raw, own, None)
    if calibration is None:
        known = raw = with_lever(uncalibrated_setup(recording, map_, rest), recording, map_, notes)
        main = RAW if imu is not None else CV_RAW
    else:
        known = with_aids(calibrated_setup(calibration, recording, map_), recording, map_, False)
        main = WITH_IMU if imu is not None else CV
        if imu is not None:
            row(WITH_IMU, known, calibration, imu)
            row(SMOOTH, known, calibration, imu, smoothed=True)
        if (name := aided_name(map_)) is not None:
            aided = with_aids(known, recording, map_, True)
            row(name, aided, calibration, imu)
            row(f"{name}, smoothed", aided, calibration, imu, smoothed=True)
    if imu is not None and calibrates:
        if calibration is not None:
            raw = with_lever(raw, recording, map_, notes)
        row(RAW, raw, calibration, imu)
    by = own if imu is None else calibration
    if imu is None and own is not None:
        known = plain
    imposed = map_.imposed
    if imposed.lost:
        lost = lose_some(ranges, imposed.lost, imposed.seed)
        row(f"{main}, {imposed.lost:.0%} of the ranges lost", known, by, imu, lost)
    if imposed.gaps is not None:
        name = f"{main}, all ranges lost for {imposed.gaps.last:g} s every {imposed.gaps.every:g} s"
        ends = gap_ends(ranges, imposed.gaps, max(first, ranges.t[0]))
        if truth is not None and by is not None:
            ends = ends[ends + by.offset < truth.t[-1]]
        heard = lose_gaps(ranges, imposed.gaps, ends)
        row(name, known, by, imu, heard)
        if len(ends) and name in rows:
            at_end = estimate(heard, imu, known, map_.filter, ends - 1e-6)
            true = true_at(at_end.t, by)
            if true is not None:
                errors = np.linalg.norm(at_end.p - true, axis=1)
                rms, largest = float(np.sqrt(np.mean(errors**2))), float(errors.max())
                rows[name] = replace(rows[name], gap_end=rms, gap_end_largest=largest, gaps=len(errors))
    best = next((name for name in (WITH_IMU, CV, RAW, CV_RAW) if name in rows), None)
    if best is None:
        raise InputError(f"{recording.name}: {next(iter(left_out.values()))}")
    found, true = drawn[best]
    notes += of_failed(found.failed, found.drag)
    notes += [f"{name}: this row is left out: {why}" for name, why in left_out.items()]
    heading = []
    if imu is not None and main in drawn:
        turned = heading_doubts(recording, known, map_.filter, drawn[main][0].begin)
        heading = [f"{main}: {one.text()}" for one in turned]
    doubts = doubts_of(recording, map_, look, calibration, rows, (found.p, true), heading)
    result = Replayed(
        name=recording.name,
        rows=rows,
        **({} if calibration is None else _calibrated(calibration, recording)),
        anchors=tuple(tuple(a) for a in anchors.tolist()),
        judged_from=first,
        rejected=recording.rejected,
        notes=notes,
        plain_residual=None if look.fit is None else look.fit.left,
        range_noise=range_noise(map_.filter, imu is not None),
        doubts=(*doubts, *standstill_doubts(rest)),
        rest=rest,
    )
    return result, drawn


def with_lever(known: FilterSetup, recording: Recording, map_: Map, notes: list[str]) -> FilterSetup:
    """Return the settings with the map's lever, or else with the lever by the innovations, which is noted."""
    given, imu = map_.calibration.lever, recording.imu
    if given != "estimate":
        return known._replace(lever=np.array(given))
    try:
        found = None if imu is None else fit_lever(recording.ranges, imu, known, map_.filter)
    except InputError:  # the row that needs the lever says why
        found = None
    if found is None:
        if imu is not None:
            notes.append(
                f"{RAW}: the ranges' innovations tell no lever to the antenna (a body that hardly turns?): it is 0"
            )
        return known
    arm, sd = (", ".join(f"{v:.3f}" for v in vector) for vector in found)
    notes.append(f"{RAW}: the ranges' innovations in the first {TRIAL:g} s put the antenna at ({arm}) m, sd ({sd})")
    return known._replace(lever=found.arm)


def _calibrated(by: Calibration, recording: Recording) -> dict[str, Any]:
    """Return the calibration's fields of Replayed; the offset is between the files' own stamps."""
    return {
        "offset": by.offset + (recording.truth_origin - recording.origin),
        "told_by": by.told_by,
        "heading": float(np.arctan2(by.F[1, 0], by.F[0, 0])),
        "shift": tuple(by.shift.tolist()),
        "lever": tuple(by.lever.tolist()),
        "biases": tuple(by.biases.tolist()),
        "residual": by.left,
    }


def lose_some(ranges: Ranges, share: float, seed: int) -> Ranges:
    """Return the ranges after random losses: each range is lost independently with probability `share`."""
    kept = np.random.Generator(np.random.Philox(seed)).random(len(ranges.t)) >= share
    return ranges.only(kept)


def gap_ends(ranges: Ranges, gaps: Gaps, first: float) -> np.ndarray:
    """Return the ends of the gaps [s]: the first gap begins at `first`, and the last one ends before the ranges do."""
    starts = np.arange(first, ranges.t[-1] - gaps.last, gaps.every)
    return starts + gaps.last


def lose_gaps(ranges: Ranges, gaps: Gaps, ends: np.ndarray) -> Ranges:
    """Return the ranges outside the gaps with these ends [s]."""
    lost = np.zeros(len(ranges.t), dtype=bool)
    for end in ends:
        lost |= (ranges.t >= end - gaps.last) & (ranges.t < end)
    return ranges.only(~lost)
