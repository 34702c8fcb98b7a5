"""Other readings of the same files (units, axes, frames, clocks, anchors), each named by the key that sets it.

Each is tried by the cheap fit of plain_fit.py. One is reported only where it fits at least twice as well,
and about as well as the ranges' noise allows.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ortilo_drake.interop.recorded.map_file import Map
from ortilo_drake.interop.recorded.recording import ONE_TAG, Ranges, Recording, Truth, axes_matrix
from ortilo_drake.studies.recorded.plain_fit import PlainFit, plain_fit
from ortilo_drake.studies.recorded.truth_path import TruthPath, truth_path

UNITS = {"mm": 0.001, "cm": 0.01, "in": 0.0254, "ft": 0.3048, "km": 1000.0}
OF_RANGES = {"ns of flight": 0.299792458, "ticks of 15.65 ps": 0.299792458 / 63.8976}
BACK = {"m, not mm": 1000.0, "m, not cm": 100.0, "m, not ft": 1 / 0.3048}
UPS = {  # which of the axes so far are ours
    "y is up": ("x", "-z", "y"),
    "z is down": ("x", "-y", "-z"),
    "y is down": ("x", "z", "-y"),
    "x is up": ("y", "z", "x"),
    "x is down": ("-y", "z", "-x"),
}
BETTER = 2.0  # a reading is told where it leaves less by this factor
NEAR = 3.0  # and at most this many standard deviations of the ranges
ALIKE = 1.2  # of readings that leave this much more than the best, the first, which is the simplest, is told
FAR = 100.0  # clock offsets tried, at most [s]
LEAST_TIME, MEET = 5.0, 0.4  # truth and ranges meet for so long [s], and for this share of the shorter one
SPREADS = (0.05, 1.2)  # of an anchor's ranges, in the sizes of the path: what may be
ALL_HEADINGS = 8  # with more anchors, pairs that change places are tried from the frame found only


class Reading(NamedTuple):
    """A key of the map and its value, the files so read, and the offsets to start from [s], None as found."""

    key: str
    ranges: Ranges
    anchors: np.ndarray
    truth: Truth
    frame: str
    offsets: np.ndarray | None = None
    near: bool = False
    tags: np.ndarray = ONE_TAG


class Guess(NamedTuple):
    """The key that mends it, and the RMS of the ranges' errors with one bias for all, before and after [m]."""

    key: str
    before: float
    after: float


def readings(recording: Recording, map_: Map) -> Iterator[Reading]:
    """Yield other readings, the simplest first."""
    truth, ranges, anchors = recording.truth, recording.ranges, recording.anchors
    assert truth is not None
    assert map_.truth is not None
    assert map_.ranges is not None
    assert not isinstance(anchors, int)
    now = Reading("", ranges, anchors, truth, map_.calibration.frame, tags=recording.tags)
    for unit, by in {**UNITS, **BACK}.items():
        of_ranges = now._replace(ranges=ranges._replace(r=ranges.r * by))
        of_truth = now._replace(truth=truth._replace(p=truth.p * by))
        ranges_key = f"ranges: {{scale: {map_.ranges.scale * by:.6g}}}"
        truth_key = f"truth: {{scale: {map_.truth.scale * by:.6g}}}"
        anchors_key = f"anchors: in metres, those of the map times {by:.6g}"
        yield of_ranges._replace(key=f"{ranges_key} ({unit})")
        yield of_truth._replace(key=f"{truth_key} ({unit})")
        yield now._replace(key=f"{anchors_key} ({unit})", anchors=anchors * by)
        yield of_truth._replace(key=f"{truth_key}, {anchors_key} ({unit})", anchors=anchors * by)
        yield of_ranges._replace(key=f"{ranges_key}, {truth_key} ({unit})", truth=of_truth.truth)
        yield of_ranges._replace(key=f"{ranges_key}, {anchors_key} ({unit})", anchors=anchors * by)
    for unit, by in OF_RANGES.items():
        scaled = ranges._replace(r=ranges.r * by)
        yield now._replace(key=f"ranges: {{scale: {map_.ranges.scale * by:.6g}}} ({unit})", ranges=scaled)
    if now.frame == "same":
        now = now._replace(frame="yaw")
        yield now._replace(key="calibration: {frame: yaw}")
    for what, axes in UPS.items():
        A = axes_matrix(axes)
        turned = truth._replace(p=truth.p @ A.T, R=None if truth.R is None else A @ truth.R)
        names = _names(A @ axes_matrix(map_.truth.axes, "truth.axes"))
        key = f"truth: {{axes: {names}}}"
        yield now._replace(key=f"{key} ({what})", truth=turned)
        for unit, by in UNITS.items():
            small = turned._replace(p=turned.p * by)
            both = f"truth: {{axes: {names}, scale: {map_.truth.scale * by:.6g}}} ({what}, {unit})"
            yield now._replace(key=both, truth=small)
    if now.frame != "se3":
        yield now._replace(key="calibration: {frame: se3}", frame="se3")
    yield from _other_anchors(now)


def _names(M: np.ndarray) -> str:
    rows = [("-" if row.sum() < 0 else "") + "xyz"[int(np.argmax(np.abs(row)))] for row in M]
    return f"[{', '.join(rows)}]"


def clocks(recording: Recording, map_: Map) -> Iterator[Reading]:
    """Yield the clock estimated, where the map gives it, and a wider search for it."""
    truth, ranges = recording.truth, recording.ranges
    assert truth is not None
    longest = min(FAR, max(ranges.t[-1], truth.t[-1]))
    wide = np.arange(-longest, longest + 1.0)
    meet = np.minimum(truth.t[-1], ranges.t[-1] + wide) - np.maximum(0.0, wide)
    wide = wide[meet > max(LEAST_TIME, MEET * min(truth.t[-1], ranges.t[-1]))]
    now = Reading("", ranges, np.asarray(recording.anchors), truth, map_.calibration.frame, wide, tags=recording.tags)
    few = wide[np.abs(wide) <= map_.calibration.search]
    if map_.calibration.clock != "estimate":
        yield now._replace(key="calibration: {clock: estimate}", offsets=few)
    if len(few) < len(wide):
        yield now._replace(key="calibration: {clock: estimate, search: SEARCH}")


def _other_anchors(now: Reading) -> Iterator[Reading]:
    """Yield anchors in another order: two that change places, all reversed, all moved on by one."""
    n = len(now.anchors)
    for i, j in combinations(range(n), 2):
        order = np.arange(n)
        order[[i, j]] = j, i
        key = f"anchors: entries {i + 1} and {j + 1} change places"
        yield now._replace(key=key, anchors=now.anchors[order], near=n > ALL_HEADINGS)
    others = {
        "in reverse order": now.anchors[::-1],
        "the first one last": np.roll(now.anchors, -1, axis=0),
        "the last one first": np.roll(now.anchors, 1, axis=0),
    }
    for what, anchors in others.items():
        yield now._replace(key=f"anchors: {what}", anchors=anchors)


def fit_of(
    reading: Reading, path: TruthPath, offsets: np.ndarray, moves: bool, near: PlainFit | None
) -> PlainFit | None:
    """Return the cheap fit of a reading, from offsets to start from [s], which it may move."""
    at = offsets if reading.offsets is None else reading.offsets
    moves = moves or reading.offsets is not None
    near = near if reading.near else None
    return plain_fit(
        reading.ranges, reading.anchors, path, at, frame=reading.frame, moves=moves, near=near, tags=reading.tags
    )


def better_reading(
    recording: Recording, map_: Map, offsets: np.ndarray, moves: bool, now: PlainFit, noise: float
) -> Guess | None:
    """Return the reading that is clearly better than the map's, if there is one.

    Args:
        recording: as the map says.
        map_: what it says.
        offsets: of the clocks, to start from [s].
        moves: whether the ranges tell the clock.
        now: the fit as the map says.
        noise: standard deviation of a range [m].
    """
    assert recording.truth is not None
    one_clock = recording.origin - recording.truth_origin
    for tried in (readings(recording, map_), clocks(recording, map_)):
        good: list[Guess] = []
        read, path = recording.truth, truth_path(recording.truth)
        for reading in tried:
            if not is_plausible(reading):
                continue
            if reading.truth is not read:
                read, path = reading.truth, truth_path(reading.truth)
            fit = fit_of(reading, path, offsets, moves, now)
            if fit is not None and _is_better(fit, reading, now, recording, noise):
                reach = np.ceil(min(abs(fit.offset), abs(fit.offset - one_clock)) + 1.0)
                good.append(Guess(reading.key.replace("SEARCH", f"{reach:g}"), now.left, fit.left))
                if fit.left <= noise:
                    break  # none can be told from it
        if good:
            least = min(one.after for one in good)
            return next(one for one in good if one.after <= ALIKE * least)
    return None


def is_plausible(reading: Reading) -> bool:
    """Return whether a reading is plausible: an anchor's ranges change about as much as the body moves.

    Ranges of one time also differ by no more than the anchors lie apart, and do not add up to far less.
    """
    r, anchor = reading.ranges.r, reading.ranges.anchor
    of_each = [r[anchor == i] for i in np.unique(anchor)]
    spread = max(float(np.ptp(np.percentile(one, [5, 95]))) for one in of_each)
    path, room = _size(np.percentile(reading.truth.p, [2, 98], axis=0)), _size(reading.anchors)
    middles = [float(np.median(one)) for one in of_each]
    apart = max(middles) - min(middles)
    return SPREADS[0] * path <= spread <= SPREADS[1] * path + 0.5 and apart <= 1.2 * room + 0.5 and r.max() > 0.3 * room


def _size(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.ptp(points, axis=0)))


def _is_better(fit: PlainFit, reading: Reading, now: PlainFit, recording: Recording, noise: float) -> bool:
    """Return whether a fit leaves clearly less, in metres and beside the ranges: what is made small fits well."""
    before, after = now.left / np.median(recording.ranges.r), fit.left / np.median(reading.ranges.r)
    return bool(fit.left <= NEAR * noise and BETTER * after <= before)
